"""A VecEnvWrapper that holds the VecEnv, or a part of it, under a name of its own meets the new one after a resume."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnvWrapper, VecNormalize, VecVideoRecorder

from sb3_bruno import RecurrentSAC
from sb3_bruno.resume import resume, save_checkpoint
from support.tiny_models import POINT, tiny


class Holding(VecEnvWrapper):
    """Holds parts of the VecEnv in many ways."""

    def __init__(self, venv):
        super().__init__(venv)
        self.outer, self.inner, self.envs = venv, venv.unwrapped, venv.unwrapped.envs
        self.nested = {"all": [venv], "first": self.envs[0], "bare": self.envs[0].unwrapped}
        self.act = venv.step_wait
        self.n_steps = 0

    def reset(self):
        return self.venv.reset()

    def step_wait(self):
        self.n_steps += 1
        return self.act()


def filmed(folder):
    env = DummyVecEnv([lambda: Monitor(gym.make(POINT, render_mode="rgb_array"), str(folder / "0"))])
    return VecVideoRecorder(env, str(folder), lambda step: step == 0, video_length=1_000)


def test_the_video_shows_the_new_envs(tmp_path):
    (tmp_path / "new").mkdir()
    model = RecurrentSAC("MlpPolicy", filmed(tmp_path), **tiny(RecurrentSAC)).learn(10)
    save_checkpoint(model, tmp_path / "checkpoint.pkl")
    resumed = resume(tmp_path / "checkpoint.pkl", filmed(tmp_path / "new"))
    recorder = resumed.env
    assert recorder.env is recorder.venv and recorder.step_id == model.env.step_id
    resumed.learn(3, reset_num_timesteps=False)
    *_, before, last = recorder.recorded_frames
    assert not np.array_equal(before, last), "the film is not frozen"
    recorder.recorded_frames, model.env.recorded_frames = [], []  # write no video


@pytest.mark.parametrize("outermost", [lambda env: env, VecNormalize])
def test_every_reference_to_a_part_is_to_the_new_part(tmp_path, outermost):
    def make_env():
        return outermost(Holding(Holding(DummyVecEnv([lambda: Monitor(gym.make(POINT))] * 2))))

    model = RecurrentSAC("MlpPolicy", make_env(), **tiny(RecurrentSAC)).learn(20)
    save_checkpoint(model, tmp_path / "checkpoint.pkl")
    wrapper = resume(tmp_path / "checkpoint.pkl", make_env()).env
    while wrapper is not wrapper.unwrapped:
        if isinstance(wrapper, Holding):
            assert wrapper.n_steps == 10 and wrapper.act.__self__ is wrapper.outer is wrapper.nested["all"][0]
            assert wrapper.outer is wrapper.venv and wrapper.inner is wrapper.unwrapped
            assert wrapper.envs is wrapper.unwrapped.envs
            assert wrapper.nested["first"] is wrapper.unwrapped.envs[0]
            assert wrapper.nested["bare"] is wrapper.unwrapped.envs[0].unwrapped
        wrapper = wrapper.venv

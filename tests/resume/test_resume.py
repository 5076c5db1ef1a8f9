"""Exact resume: the resumed run equals the uninterrupted one, bit for bit, whenever the process dies."""

import time
from contextlib import nullcontext

import gymnasium as gym
import numpy as np
import pytest
import torch as th
import zuko
from gymnasium.utils import EzPickle
from stable_baselines3 import PPO, SAC, HerReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.envs import BitFlippingEnv
from stable_baselines3.common.monitor import Monitor, load_results
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    SubprocVecEnv,
    VecCheckNan,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
)

from sb3_bruno import BrunoSAC, RecurrentCrossQ, RecurrentSAC
from sb3_bruno.resume.checkpoint import ResumeCallback, resume
from sb3_bruno_envs import MetaTask, TransitionObservation

STEPS = 240
COMMON = {
    "seed": 3,
    "learning_starts": 40,
    "gradient_steps": 1,
    "batch_size": 32,
    "buffer_size": 300,
    "policy_kwargs": {"net_arch": [16]},
}
SETTINGS = {
    **COMMON,
    "encoder_kwargs": {"flow_class": zuko.flows.MAF, "flow_kwargs": {"transforms": 2, "hidden_features": (16,)}},
    "encoder_batch_size": 4,
    "replay_buffer_kwargs": {"n_sequences": 4, "sequence_length": 16},
}
GRU = {"hidden_size": 8}
LSTM = {"hidden_size": 8, "cell": "lstm"}
RECURRENT = {**COMMON, "encoder_kwargs": GRU, "replay_buffer_kwargs": {"n_sequences": 4}}


def point(n_envs=3, **kwargs):
    return make_vec_env("sb3_bruno_envs:PointDir-v0", n_envs, seed=0, **kwargs)


def trials():
    return make_vec_env("sb3_bruno_envs:SparsePointGoal-v0", 3, seed=0)


def normalized():
    return VecNormalize(point(), gamma=0.9)


def watched():
    return VecMonitor(VecNormalize(DummyVecEnv([lambda: gym.make("sb3_bruno_envs:PointDir-v0")] * 3)))


class Die(BaseCallback):
    """Ends training in the middle of a rollout, as a kill would."""

    def __init__(self, after):
        super().__init__()
        self.after = after

    def _on_step(self):
        if self.num_timesteps >= self.after:
            raise KeyboardInterrupt
        return True


class EzPickled(gym.Wrapper, EzPickle):
    """Forgets its state when pickled."""

    def __init__(self, env):
        gym.Wrapper.__init__(self, env)
        EzPickle.__init__(self, env)


def fingerprint(model):
    tensors = [tensor for part in model.get_parameters().values() for tensor in _tensors(part)]
    arrays = [model.replay_buffer.observations, model.replay_buffer.rewards, *model._carried.pack()]
    return [tensor.detach().clone() for tensor in tensors] + [th.as_tensor(array).clone() for array in arrays]


def _tensors(part):
    if isinstance(part, th.Tensor):
        return [part.cpu()]  # Adam counts its steps there, unless it was loaded
    if isinstance(part, dict):
        return [tensor for value in part.values() for tensor in _tensors(value)]
    return []


def scramble_random_states():
    np.random.seed(99)  # noqa: NPY002  # what SB3 draws from
    th.manual_seed(98)


@pytest.mark.parametrize(
    "make_env",
    [point, trials, normalized, watched, lambda: point(1)],
    ids=["plain", "trials", "VecNormalize", "VecMonitor", "one env"],
)
@pytest.mark.parametrize("died_at", [75, 170])
def test_a_resumed_run_equals_the_uninterrupted_one(tmp_path, make_env, died_at):
    check_resumed_run(tmp_path / "checkpoint.pkl", BrunoSAC, make_env, SETTINGS, died_at)


RECURRENT_RUNS = {
    "gru": (RecurrentSAC, point, {}),
    "one env": (RecurrentSAC, lambda: point(1), {}),
    "lstm in trials": (RecurrentSAC, trials, {"encoder_kwargs": LSTM}),
    "target, VecNormalize": (RecurrentSAC, normalized, {"encoder_tau": 0.1}),
    "by the actor, in trials": (RecurrentSAC, trials, {"encoder_kwargs": {**GRU, "learns_from": "actor"}}),
    "CrossQ": (RecurrentCrossQ, point, {"encoder_tau": 0.1}),
    "buffer shorter than an episode": (RecurrentSAC, point, {"buffer_size": 60, "train_freq": 2}),
}


@pytest.mark.parametrize("run", RECURRENT_RUNS)
def test_a_resumed_recurrent_run_equals_the_uninterrupted_one(tmp_path, run):
    algorithm, make_env, settings = RECURRENT_RUNS[run]
    check_resumed_run(tmp_path / "checkpoint.pkl", algorithm, make_env, {**RECURRENT, **settings}, died_at=170)


def check_resumed_run(path, algorithm, make_env, settings, died_at):
    whole = algorithm("MlpPolicy", make_env(), **settings).learn(STEPS)
    with pytest.raises(KeyboardInterrupt):
        algorithm("MlpPolicy", make_env(), **settings).learn(STEPS, [ResumeCallback(path, 30), Die(died_at)])
    scramble_random_states()
    resumed = resume(path, make_env())
    assert 0 < resumed.num_timesteps <= died_at
    resumed.learn(STEPS - resumed.num_timesteps, reset_num_timesteps=False)
    assert resumed.num_timesteps == whole.num_timesteps and resumed._n_encoder_updates == whole._n_encoder_updates > 0
    for tensor, expected in zip(fingerprint(resumed), fingerprint(whole), strict=True):
        assert th.equal(tensor, expected)
    assert resumed.ep_info_buffer[-1]["r"] == whole.ep_info_buffer[-1]["r"]


def test_sb3s_own_algorithms_are_resumed_alike(tmp_path):
    def make_env():
        return point(env_kwargs={"observe": "task"})

    settings = {key: value for key, value in SETTINGS.items() if not key.startswith(("encoder", "replay"))}
    whole = SAC("MlpPolicy", make_env(), **settings).learn(STEPS)
    path = tmp_path / "checkpoint.pkl"
    with pytest.raises(KeyboardInterrupt):
        SAC("MlpPolicy", make_env(), **settings).learn(STEPS, [ResumeCallback(path, 30), Die(170)])
    scramble_random_states()
    resumed = resume(path, make_env())
    resumed.learn(STEPS - resumed.num_timesteps, reset_num_timesteps=False)
    for tensor, expected in zip(_tensors(resumed.get_parameters()), _tensors(whole.get_parameters()), strict=True):
        assert th.equal(tensor, expected)


def test_frames_are_stacked_on(tmp_path):
    def make_env():
        return VecFrameStack(point(env_kwargs={"observe": "plain"}), 3)

    settings = {key: value for key, value in SETTINGS.items() if not key.startswith(("encoder", "replay"))}
    whole = SAC("MlpPolicy", make_env(), **settings).learn(STEPS)
    SAC("MlpPolicy", make_env(), **settings).learn(170, ResumeCallback(tmp_path / "checkpoint.pkl", 160))
    resumed = resume(tmp_path / "checkpoint.pkl", make_env())
    resumed.learn(STEPS - resumed.num_timesteps, reset_num_timesteps=False)
    np.testing.assert_array_equal(whole.replay_buffer.observations, resumed.replay_buffer.observations)


@pytest.mark.parametrize("make_env", [normalized, point])
def test_a_vec_normalize_may_be_left_out_and_nothing_else(tmp_path, make_env):
    path = tmp_path / "checkpoint.pkl"
    model = BrunoSAC("MlpPolicy", normalized(), **SETTINGS).learn(90, ResumeCallback(path, 60))
    resumed = resume(path, make_env())
    assert resumed.get_vec_normalize_env().gamma == 0.9
    resumed.learn(model.num_timesteps - resumed.num_timesteps, reset_num_timesteps=False)
    np.testing.assert_array_equal(resumed.env.returns, model.env.returns)
    for wrong in (VecMonitor(point()), VecMonitor(normalized())):
        with pytest.raises(ValueError, match=r"wrapped in \['VecMonitor'.*, the checkpoint's in \['VecNormalize'\]"):
            resume(path, wrong)


def test_hindsight_goes_on(tmp_path):
    def make_env():
        return DummyVecEnv([lambda: Monitor(BitFlippingEnv(n_bits=2, continuous=True))])

    kwargs = {"learning_starts": 10, "batch_size": 8, "replay_buffer_class": HerReplayBuffer}
    SAC("MultiInputPolicy", make_env(), **kwargs).learn(60, ResumeCallback(tmp_path / "checkpoint.pkl", 40))
    resumed = resume(tmp_path / "checkpoint.pkl", make_env())
    assert resumed.learn(20, reset_num_timesteps=False).num_timesteps >= 60


def test_monitor_files_go_on_where_the_checkpoint_was_taken(tmp_path):
    def make_env(folder, **kwargs):
        return point(monitor_dir=str(tmp_path / folder), monitor_kwargs={"info_keywords": ("task_index",), **kwargs})

    def rows(folder):
        return [
            (row.r, row.l, row.task_index) for row in load_results(str(tmp_path / folder)).sort_values("r").itertuples()
        ]

    BrunoSAC("MlpPolicy", make_env("whole"), **SETTINGS).learn(STEPS)
    path = tmp_path / "checkpoint.pkl"
    with pytest.raises(KeyboardInterrupt):
        BrunoSAC("MlpPolicy", make_env("parts"), **SETTINGS).learn(STEPS, [ResumeCallback(path, 100), Die(195)])
    resumed = resume(path, make_env("parts", override_existing=False))
    assert resumed.num_timesteps < 180  # and two episodes of each env have been written since
    resumed.learn(STEPS - resumed.num_timesteps, reset_num_timesteps=False)
    assert rows("parts") == rows("whole")


@pytest.mark.mujoco
def test_the_cheetahs_physics_goes_on_where_it_was(tmp_path):
    def make_env():
        return make_vec_env("sb3_bruno_envs:CheetahDir-v0", 2, seed=0)

    whole = BrunoSAC("MlpPolicy", make_env(), **SETTINGS).learn(240)
    path = tmp_path / "checkpoint.pkl"
    with pytest.raises(KeyboardInterrupt):
        BrunoSAC("MlpPolicy", make_env(), **SETTINGS).learn(240, [ResumeCallback(path, 50), Die(150)])
    scramble_random_states()
    resumed = resume(path, make_env())
    resumed.learn(240 - resumed.num_timesteps, reset_num_timesteps=False)
    for tensor, expected in zip(fingerprint(resumed), fingerprint(whole), strict=True):
        assert th.equal(tensor, expected)


def test_envs_whose_state_is_lost_go_on_with_a_new_episode_and_say_so(tmp_path):
    path = tmp_path / "checkpoint.pkl"

    def in_processes():
        return point(2, vec_env_cls=SubprocVecEnv)

    env = in_processes()
    BrunoSAC("MlpPolicy", env, **SETTINGS).learn(150, ResumeCallback(path, 60))
    env.close()
    env = in_processes()
    with pytest.warns(UserWarning, match="new episode, because the state of envs inside SubprocVecEnv"):
        model = resume(path, env)
    steps = model.num_timesteps
    model.learn(60, reset_num_timesteps=False)
    assert model.num_timesteps == steps + 60
    env.close()


@pytest.mark.mujoco
def test_envs_that_are_moved_to_other_processes_go_on_with_a_new_episode_and_say_so(tmp_path):
    path = tmp_path / "checkpoint.pkl"
    BrunoSAC("MlpPolicy", point(2), **SETTINGS).learn(90, ResumeCallback(path, 40))
    with pytest.warns(UserWarning, match="new episode, because saved envs cannot be put into SubprocVecEnv"):
        model = resume(path, point(2, vec_env_cls=SubprocVecEnv))
    model.learn(20, reset_num_timesteps=False)
    model.env.close()


def test_an_env_that_forgets_its_state_when_pickled_is_found_out(tmp_path):
    def make_env():
        return TransitionObservation(MetaTask(gym.make("HalfCheetah-v5", max_episode_steps=50)))

    path = tmp_path / "checkpoint.pkl"
    BrunoSAC("MlpPolicy", make_env(), **SETTINGS).learn(90, ResumeCallback(path, 40))
    with pytest.warns(UserWarning, match="HalfCheetahEnv pickles its constructor's arguments"):
        resume(path, make_env())


def test_an_env_that_cannot_be_pickled_goes_on_with_new_episodes(tmp_path):
    class Stubborn(gym.Wrapper):
        def __getstate__(self):
            raise TypeError("no")

    def make_env():
        return Stubborn(gym.make("sb3_bruno_envs:PointDir-v0"))

    path = tmp_path / "checkpoint.pkl"
    first = BrunoSAC("MlpPolicy", make_env(), **SETTINGS).learn(90, ResumeCallback(path, 40))
    with pytest.warns(UserWarning, match="cannot be pickled"):
        model = resume(path, make_env())
    steps = model.num_timesteps
    model.learn(1, reset_num_timesteps=False)
    starts = [agent.replay_buffer.observations[row, 0] for agent, row in ((first, 0), (model, steps))]
    assert steps > 0 and not np.array_equal(*starts), "nor is it the run's first episode again"


def test_a_wrapper_that_cannot_be_pickled_has_new_episodes_begin(tmp_path):
    def make_env():
        env = VecCheckNan(point())
        env.unpicklable = (number for number in ())
        return env

    path = tmp_path / "checkpoint.pkl"
    BrunoSAC("MlpPolicy", make_env(), **SETTINGS).learn(90, ResumeCallback(path, 40))
    with pytest.warns(UserWarning, match="new episode, because VecCheckNan cannot be pickled"):
        resume(path, make_env()).learn(30, reset_num_timesteps=False)


@pytest.mark.parametrize("wrapper", [gym.Wrapper, EzPickled])
def test_the_time_between_kill_and_resumption_is_not_counted(tmp_path, monkeypatch, wrapper):
    def make_env():
        return DummyVecEnv([lambda: Monitor(wrapper(gym.make("sb3_bruno_envs:PointDir-v0")))])

    BrunoSAC("MlpPolicy", make_env(), **SETTINGS).learn(45, ResumeCallback(tmp_path / "checkpoint.pkl", 40))
    now = time.time
    monkeypatch.setattr(time, "time", lambda: now() + 1_000_000)
    with pytest.warns() if wrapper is EzPickled else nullcontext():
        model = resume(tmp_path / "checkpoint.pkl", make_env())
    assert 0 < time.time() - model.env.get_attr("t_start")[0] < 1_000


def test_mistakes_are_named(tmp_path):
    with pytest.raises(ValueError, match="off-policy"):
        PPO("MlpPolicy", point(env_kwargs={"observe": "plain"})).learn(1, ResumeCallback(tmp_path / "checkpoint.pkl"))
    for save_freq in (0, float("nan")):
        with pytest.raises(ValueError, match=f"save_freq={save_freq} is not positive"):
            ResumeCallback(tmp_path / "checkpoint.pkl", save_freq)
    with pytest.raises(FileNotFoundError):
        resume(tmp_path / "none.pkl", point())
    BrunoSAC("MlpPolicy", point(), **SETTINGS).learn(90, ResumeCallback(tmp_path / "checkpoint.pkl", 40))
    with pytest.raises(ValueError, match="2 envs, the checkpoint 3"):
        resume(tmp_path / "checkpoint.pkl", point(2))
    unmonitored = DummyVecEnv([lambda: gym.make("sb3_bruno_envs:PointDir-v0")] * 3)
    with pytest.raises(ValueError, match="0 Monitors, the checkpoint 3"):
        resume(tmp_path / "checkpoint.pkl", unmonitored)
    BrunoSAC("MlpPolicy", unmonitored, **SETTINGS).learn(90, ResumeCallback(tmp_path / "unmonitored.pkl", 40))
    with pytest.raises(ValueError, match="3 Monitors, the checkpoint 0"):
        resume(tmp_path / "unmonitored.pkl", point())

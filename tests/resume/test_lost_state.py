"""Envs whose state cannot be saved go on with new episodes, and a warning says so."""

import time
from contextlib import nullcontext

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils import EzPickle
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecCheckNan

from sb3_bruno import BrunoSAC
from sb3_bruno.resume import ResumeCallback, resume
from sb3_bruno_envs import MetaTask, TransitionObservation
from support.resumed_runs import SETTINGS, point


class EzPickled(gym.Wrapper, EzPickle):
    """Forgets its state when pickled."""

    def __init__(self, env):
        gym.Wrapper.__init__(self, env)
        EzPickle.__init__(self, env)


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


def test_envs_that_are_moved_to_other_processes_go_on_with_a_new_episode_and_say_so(tmp_path):
    path = tmp_path / "checkpoint.pkl"
    BrunoSAC("MlpPolicy", point(2), **SETTINGS).learn(90, ResumeCallback(path, 40))
    with pytest.warns(UserWarning, match="new episode, because saved envs cannot be put into SubprocVecEnv"):
        model = resume(path, point(2, vec_env_cls=SubprocVecEnv))
    model.learn(20, reset_num_timesteps=False)
    model.env.close()


@pytest.mark.mujoco
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

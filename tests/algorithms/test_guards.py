"""Envs that misbehave between two steps of learning: moved by others, with tasks that change, with NaN rewards."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno import BrunoSAC, RecurrentSAC
from sb3_bruno.algorithms.guards import has_moved
from support.tiny_models import POINT, TRIAL, tiny

EVALUATED = r"someone else has stepped or reset its env"


def make(env, algorithm=RecurrentSAC, **kwargs):
    return algorithm("MlpPolicy", env, **tiny(algorithm, **{"learning_starts": 1_000, **kwargs}))


@pytest.mark.parametrize("env_id", [POINT, TRIAL])
def test_after_an_evaluation_on_the_training_env_new_episodes_begin(env_id):
    model = make(make_vec_env(env_id, 2, seed=0)).learn(90)  # each env is in mid-episode
    evaluate_policy(model, model.get_env(), 2)
    with pytest.warns(UserWarning, match=EVALUATED):
        model.learn(20, reset_num_timesteps=False)
    buffer = model.replay_buffer
    assert buffer.episodes.lengths.tolist() == [10, 10]
    slots, _ = buffer.episodes.holding(np.array([90, 91]))
    assert slots[:, 0].tolist() == [90, 91]


def test_without_one_the_episode_goes_on():
    model = make(POINT).learn(45)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.learn(10, reset_num_timesteps=False)
    assert model.replay_buffer.episodes.lengths.tolist() == [25]


def test_of_an_agent_that_counted_no_steps_nothing_is_told():
    assert not has_moved(make_vec_env(POINT, 1), None)


class OtherTask(gym.Wrapper):
    """Tells another task from the 35th step on, which is the fifth of the second episode."""

    def __init__(self, env, change):
        super().__init__(env)
        self.change, self.n_steps = change, 0

    def step(self, action):
        *told, info = self.env.step(action)
        self.n_steps += 1
        return *told, {**info, "task": self.change(info["task"])} if self.n_steps >= 35 else info


@pytest.mark.filterwarnings("ignore:The tasks of")  # which come to the fault, too, before training does
@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            lambda task: -task,
            r"The task of env 0 changed from \[.*\] to \[.*\] within an episode, .*end the episode there",
        ),
        (lambda task: np.append(task, 5), r"The task of env 0 is \[.* 5.\], and the `task_space` has 2 numbers"),
        (lambda task: ["forward"], r"`info\['task'\] of env 0` is no array of numbers"),
    ],
    ids=["changed", "longer", "a word"],
)
def test_a_task_that_changes_within_an_episode_is_refused(change, told):
    model = make(OtherTask(gym.make(POINT), change))
    with pytest.raises(ValueError, match=told):
        model.learn(100)
    assert model.replay_buffer.size() == 34 and len(model.replay_buffer.tasks) <= 2


class OneNan(gym.Wrapper):
    """Its 10th reward, or the observation there, is NaN."""

    def __init__(self, env, kind):
        super().__init__(env)
        self.kind, self.n_steps = kind, 0

    def step(self, action):
        observation, reward, *told = self.env.step(action)
        self.n_steps += 1
        if self.n_steps == 10:
            reward = np.nan if self.kind == "reward" else reward
            observation["observation"][:] = np.nan if self.kind == "observation" else observation["observation"]
        return observation, reward, *told


@pytest.mark.filterwarnings("ignore:The tasks of")
@pytest.mark.parametrize("kind", ["reward", "observation"])
def test_one_nan_leaves_the_statistics_of_vec_normalize_as_they_were(kind):
    env = VecNormalize(make_vec_env(lambda: OneNan(gym.make(POINT), kind), 1, seed=0))
    model = make(env, BrunoSAC, learning_starts=5)
    with pytest.raises(ValueError, match="is nan in env 0"):
        model.learn(60)
    model.learn(60, reset_num_timesteps=False)
    assert np.isfinite([env.ret_rms.mean, env.ret_rms.var]).all()
    assert all(np.isfinite([moments.mean, moments.var]).all() for moments in env.obs_rms.values())
    assert np.isfinite(model.replay_buffer.sample(16, env).rewards).all()


def test_an_error_that_leaves_the_statistics_finite_takes_nothing_back():
    env = VecNormalize(make_vec_env(POINT, 1, seed=0))
    model = make(env, BrunoSAC)

    def stop(step, _):
        if step["self"].num_timesteps == 20:
            raise KeyboardInterrupt
        return True

    with pytest.raises(KeyboardInterrupt):
        model.learn(60, stop)
    assert env.ret_rms.count > 19

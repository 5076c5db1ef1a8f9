"""A task that is shown with an error of a given size: the same error in an episode, and the env's own course."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import FlattenObservation
from stable_baselines3.common.env_checker import check_env as sb3_check_env

from sb3_bruno_envs import NoisyTaskObservation, PointDirEnv

ID = "sb3_bruno_envs:PointDir-v0"


def make(std, **kwargs):
    return NoisyTaskObservation(gym.make(ID, observe="plain", **kwargs), std=std)


def errors(env, n_steps=4, **reset):
    observation, info = env.reset(**reset)
    found = [observation[2:] - info["task"]]
    for _ in range(n_steps):
        observation, *_, info = env.step(np.zeros(2))
        found.append(observation[2:] - info["task"])
    return np.array(found)


def test_an_error_keeps_its_direction_and_shrinks_as_told():
    found = errors(make([2.0, 1.0, 0.5]), seed=0)
    np.testing.assert_allclose(found, found[0] * np.array([[1.0], [0.5], [0.25], [0.25], [0.25]]), atol=1e-6)
    assert np.abs(found[0]).min() > 0


def test_errors_have_the_standard_deviation_that_was_asked_for_in_each_dimension():
    env = make([[0.5, 2.0]])
    env.reset(seed=0)
    found = np.array([errors(env, n_steps=0)[0] for _ in range(2_000)])
    np.testing.assert_allclose(found.std(axis=0), [0.5, 2.0], rtol=0.06)
    np.testing.assert_allclose(found.mean(axis=0), 0.0, atol=0.15)


def test_a_seed_gives_the_same_error_and_the_course_that_it_gives_without_one():
    one, other, oracle = make(0.3), make(0.3), gym.make(ID, observe="task")
    np.testing.assert_array_equal(errors(one, seed=5), errors(other, seed=5))
    np.testing.assert_array_equal(errors(one), errors(other))
    for _ in range(3):
        shown, info = one.reset(seed=7)
        expected, known = oracle.reset(seed=7)
        np.testing.assert_array_equal(shown[:2], expected[:2])
        np.testing.assert_array_equal(info["task"], known["task"])
        assert not np.array_equal(shown[2:], expected[2:])


def test_without_an_error_it_is_the_oracle():
    assert not errors(make(0.0), seed=0).any()


@pytest.mark.filterwarnings("ignore:We recommend you to use a symmetric")
def test_it_passes_sb3s_check_and_its_observations_are_in_their_space():
    env = make(100.0)
    sb3_check_env(env, skip_render_check=True)
    assert env.reset(seed=0)[0] in env.observation_space


@pytest.mark.parametrize("std", [-1.0, float("nan"), [], [[1.0, 2.0, 3.0]], [[[1.0, 2.0]]]])
def test_what_is_no_standard_deviation_is_refused(std):
    with pytest.raises(ValueError, match=r"std=.*: give"):
        make(std)


def test_it_needs_a_task():
    with pytest.raises(ValueError, match="wrap it in MetaTask"):
        NoisyTaskObservation(FlattenObservation(PointDirEnv()), 1.0)

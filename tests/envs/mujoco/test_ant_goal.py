"""Tests of the ant with a hidden goal: Ant-v5's physics to the bit, the reward by hand, no end, floors, goals."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box

from sb3_bruno_envs import ANT_GOAL_TASKS, AntGoalEnv
from support.robots import floor, rollout, torques

pytestmark = pytest.mark.mujoco


def make(**kwargs):
    return gym.make("sb3_bruno_envs:AntGoal-v0", observe="plain", **kwargs)


def test_the_physics_are_ant_v5s_to_the_bit():
    kwargs = {"exclude_current_positions_from_observation": False, "include_cfrc_ext_in_observation": False}
    ours, theirs = AntGoalEnv(), gym.make("Ant-v5", **kwargs).unwrapped
    assert ours.observation_space == theirs.observation_space == Box(-np.inf, np.inf, (29,), np.float64)
    np.testing.assert_array_equal(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    for action in torques(ours):
        np.testing.assert_array_equal(ours.step(action)[0], theirs.step(action)[0])


@pytest.mark.parametrize("goal", [[0.0, 0.0], [2.5, -1.0]])  # m
def test_the_reward_follows_from_positions_and_nothing_terminates(goal):
    env, fallen = make(), False
    env.reset(seed=0, options={"task": goal})
    for action in torques(env, 120):
        observation, reward, terminated, _, info = env.step(action)
        contact = 5e-4 * np.square(np.clip(env.unwrapped.data.cfrc_ext, -1.0, 1.0)).sum()
        distance = abs(observation[0] - goal[0]) + abs(observation[1] - goal[1])  # m
        expected = -distance - 0.1 * np.square(action, dtype=np.float64).sum() - contact
        assert reward == pytest.approx(expected, abs=1e-5)
        assert info["reward_goal"] == pytest.approx(-distance)
        assert not terminated
        fallen |= not 0.2 <= observation[2] <= 1.0
    assert fallen


def test_a_pickled_copy_continues_the_episode_to_the_bit():
    env = AntGoalEnv()
    env.set_task([1.0, 2.0])
    env.reset(seed=1)
    rollout(env, 10)
    copy = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(rollout(copy, 15), rollout(env, 15))
    np.testing.assert_array_equal(copy.reset()[0], env.reset()[0])
    assert copy.goal.tolist() == [1.0, 2.0]


def test_standing_still_and_random_torques_earn_what_they_are_known_to():
    """Random torques roll the ant far away, to returns of -370 to -1,720 in 200 steps, so fewer are compared."""
    env = make(tasks=[[0.0, 1.75]], max_episode_steps=40)
    assert floor(env, 2) == (pytest.approx(-40 * 1.85, rel=0.2), 40.0)
    assert floor(env, 4, random=True) == (pytest.approx(-98.0, rel=0.2), 40.0)


def test_the_goals_are_those_of_their_seed():
    train, test = ANT_GOAL_TASKS.tasks("train"), ANT_GOAL_TASKS.tasks("test")
    assert (train.shape, test.shape) == ((150, 2), (30, 2))
    expected = [[-0.1620, 2.1396], [1.2382, 1.9160], [-0.4849, 2.7152], [2.3391, -1.6974]]
    np.testing.assert_allclose(train[[0, 1, 2, -1]], expected, atol=1e-4)
    np.testing.assert_allclose(test[[0, -1]], [[-2.2253, -0.6972], [-1.7550, 1.6791]], atol=1e-4)
    assert ANT_GOAL_TASKS.space == Box(-3.0, 3.0, (2,))
    radii = np.linalg.norm(train, axis=1)  # m
    assert (radii < 3.0).all()
    assert (radii < 3.0 / np.sqrt(2.0)).mean() == pytest.approx(0.5, abs=0.1)  # half of the disc's area


def test_the_published_goals_leave_a_ring_out():
    tasks = make(tasks="tavt").get_wrapper_attr("task_distribution")
    radii = np.linalg.norm(tasks.tasks("train"), axis=1)  # m
    assert len(radii) == 150
    assert ((radii <= 1.0) | ((radii >= 2.5) & (radii <= 3.0))).all()
    assert (radii <= 1.0).mean() == pytest.approx(4.0 / 15.0, abs=0.1)
    assert tasks.tasks("test").tolist() == [[1.75, 0.0], [0.0, 1.75], [-1.75, 0.0], [0.0, -1.75]]

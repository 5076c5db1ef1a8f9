"""Tests of the point in a hidden wind: its motion, its reward, what knowing the wind is worth, its images."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box
from hypothesis import given
from hypothesis import strategies as st

from sb3_bruno_envs import WIND_TASKS, WindEnv

COORDINATE = st.floats(-2.0, 2.0, width=32)
BLOWS = st.floats(-0.08, 0.08)
GOAL = np.array([0.0, 1.0])


def episode(env, task, policy):
    """The return of an episode; ``policy`` maps position ``(2,)`` and wind ``(2,)`` to an action ``(2,)``."""
    position, _ = env.reset(options={"task": task})
    rewards, over = [], False
    while not over:
        position, reward, terminated, over, _ = env.step(policy(position, task).astype(np.float32))
        rewards.append(reward)
        assert not terminated
    assert len(rewards) == 75
    return sum(rewards)


def returns(policy, **kwargs):
    """The return of each test task."""
    env = gym.make("sb3_bruno_envs:Wind-v0", observe="plain", split="test", **kwargs)
    return np.array([episode(env, task, policy) for task in env.get_wrapper_attr("task_distribution").tasks("test")])


def to_the_goal(position, wind):
    """The action that leads to the goal, if it knows the wind."""
    return np.clip((GOAL - position - wind) / 0.1, -1.0, 1.0)


@given(x=COORDINATE, y=COORDINATE, wind=st.tuples(BLOWS, BLOWS), seed=st.integers(0, 99))
def test_the_motion_and_the_reward(x, y, wind, seed):
    env, rng, expected = WindEnv(), np.random.default_rng(seed), np.zeros(2)
    env.set_task(wind)
    np.testing.assert_array_equal(env.reset(seed=seed)[0], [0.0, 0.0])
    actions = np.float32([[x, y], *rng.uniform(-1.5, 1.5, (10, 2)), *([to_the_goal(np.zeros(2), np.array(wind))] * 12)])
    for action in actions:
        position, reward, terminated, truncated, _ = env.step(action)
        expected = expected + 0.1 * np.clip(action, -1.0, 1.0).astype(np.float64) + wind
        np.testing.assert_allclose(position, expected, atol=1e-6)
        distance = np.hypot(*(expected - GOAL))
        if abs(distance - 0.03) > 1e-6:
            assert reward == (1.0 if distance < 0.03 else 0.0)
        assert (terminated, truncated) == (False, False)
    assert position.dtype == np.float32


def test_the_winds_are_those_of_their_seed():
    train, test = WIND_TASKS.tasks("train"), WIND_TASKS.tasks("test")
    assert (train.shape, test.shape) == ((40, 2), (20, 2))
    first = [[-0.038076, -0.054611], [-0.035500, -0.006509], [-0.028640, 0.002943]]
    np.testing.assert_allclose(train[:3], first, atol=1e-6)
    np.testing.assert_allclose(train[-1], [0.046708, -0.001056], atol=1e-6)
    np.testing.assert_allclose(test[-1], [0.036091, 0.043594], atol=1e-6)
    assert WIND_TASKS.train_box == Box(-0.08, 0.08, (2,))
    assert WIND_TASKS.space == Box(-0.1, 0.1, (2,))
    assert len(np.unique(np.concatenate([train, test]), axis=0)) == 60


@pytest.mark.parametrize(("kwargs", "known"), [({}, 62.65), ({"tasks": "beyond"}, 66.35)])
def test_knowing_the_wind_pays_and_nothing_else_does(kwargs, known):
    rng = np.random.default_rng(0)
    told = returns(to_the_goal, **kwargs)
    assert told.mean() == pytest.approx(known, rel=0.2) and told.min() >= 25.0  # every wind can be cancelled
    assert returns(lambda position, wind: to_the_goal(position, np.zeros(2)), **kwargs).mean() < 0.2 * known
    assert returns(lambda position, wind: np.zeros(2), **kwargs).mean() < 0.2  # a standing point is blown away
    assert returns(lambda position, wind: rng.uniform(-1.0, 1.0, 2), **kwargs).mean() < 0.2


def test_one_transition_tells_the_wind():
    env, wind = WindEnv(), WIND_TASKS.tasks("test")[0]
    env.set_task(wind)
    before, _ = env.reset(seed=0)
    action = np.float32([0.3, -0.7])
    after = env.step(action)[0]
    np.testing.assert_allclose(after - before - 0.1 * action, wind, atol=1e-6)


def test_images_show_the_goal_the_wind_and_the_trail():
    env = WindEnv(render_mode="rgb_array")
    env.set_task([0.05, 0.0])
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.float32([1.0, 0.0]))
    image = env.render()
    rows, columns = np.nonzero((image == (40, 160, 70)).all(axis=2))
    assert (24, 64) in set(zip(rows, columns, strict=True))  # the goal, 40 pixels above the middle
    assert 64 + 18 <= columns.max() <= 64 + 20  # ten times the wind, to the right
    rows, columns = np.nonzero((image == (30, 80, 200)).all(axis=2))
    assert (abs(rows.mean() - 64) < 1, abs(columns.mean() - 94) < 1) == (True, True)  # 0.75 to the right


def test_a_pickled_copy_continues_the_episode():
    env = gym.make("sb3_bruno_envs:Wind-v0")
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.ones(2, np.float32))
    copy = pickle.loads(pickle.dumps(env))
    for _ in range(5):
        step, expected = copy.step(np.ones(2, np.float32)), env.step(np.ones(2, np.float32))
        np.testing.assert_array_equal(step[0]["observation"], expected[0]["observation"])
        assert step[1:4] == expected[1:4]
    np.testing.assert_array_equal(copy.reset()[1]["task"], env.reset()[1]["task"])

"""Tests of the point with a hidden goal: its motion, its reward, what knowing the goal is worth, its images."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sb3_bruno_envs import SPARSE_POINT_GOAL_TASKS, SparsePointGoalEnv

COORDINATE = st.floats(-2.0, 2.0, width=32)
GOALS = np.concatenate([SPARSE_POINT_GOAL_TASKS.tasks(split) for split in ("train", "test")])
ANGLES = np.linspace(0.15, np.pi - 0.15, 30)
SWEEP = 0.8 * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)  # sees the whole half circle as it goes


def episode(goal, knows_goal, seed=0):
    """The rewards of a scripted point: it sweeps until it is paid, then goes to the goal, or goes there at once."""
    env, rewards, places = SparsePointGoalEnv(), [], list(SWEEP)
    env.set_task(goal)
    position, _ = env.reset(seed=seed)
    over = False
    while not over:
        while len(places) > 1 and np.linalg.norm(places[0] - position) < 0.1:
            places.pop(0)
        way = (goal if knows_goal or any(rewards) else places[0]) - position
        position, reward, _, over, _ = env.step(way / max(0.15, np.abs(way).max()))
        rewards.append(reward)
    return rewards


@given(x=COORDINATE, y=COORDINATE, angle=st.floats(0.0, 3.14))
def test_the_motion_and_the_reward(x, y, angle):
    env, goal = SparsePointGoalEnv(), np.array([np.cos(angle), np.sin(angle)])
    env.set_task(goal)
    start, _ = env.reset(seed=0)
    for step in range(1, 21):
        position, reward, terminated, truncated, _ = env.step(np.float32([x, y]))
        assert (terminated, truncated) == (False, step == 20)
        expected = start + 0.15 * step * np.clip([x, y], -1.0, 1.0)
        np.testing.assert_allclose(position, expected, atol=1e-5)
        distance = np.hypot(*(expected - goal))
        if abs(distance - 0.5) > 1e-4:
            assert reward == pytest.approx(1.0 - distance if distance < 0.5 else 0.0, abs=1e-4)
    assert position.dtype == np.float32


def test_it_starts_near_the_origin_at_a_place_that_the_seed_decides():
    env = SparsePointGoalEnv()
    starts = np.stack([env.reset(seed=seed)[0] for seed in range(300)])
    assert starts.std() == pytest.approx(0.02, rel=0.1)
    np.testing.assert_array_equal(env.reset(seed=7)[0], starts[7])


def test_the_goals_are_on_the_half_circle_and_test_goals_are_others():
    np.testing.assert_allclose(np.linalg.norm(GOALS, axis=1), 1.0, rtol=1e-6)
    assert (GOALS[:, 1] >= 0.0).all()
    train, test = (SPARSE_POINT_GOAL_TASKS.tasks(split) for split in ("train", "test"))
    assert (train.shape, test.shape) == ((40, 2), (20, 2))
    assert len(np.unique(GOALS, axis=0)) == 60


def test_a_sweep_finds_every_goal_within_an_episode_and_knowing_it_pays_clearly_more():
    found, known = (np.array([sum(episode(goal, knows)) for goal in GOALS]) for knows in (False, True))
    assert (found > 0.0).all()
    assert found.mean() < 0.6 * known.mean()
    assert known.min() > 14.0  # of 20 at most


def test_standing_still_pays_nothing():
    env = SparsePointGoalEnv()
    for goal in GOALS:
        env.set_task(goal)
        env.reset(seed=0)
        assert not any(env.step(np.zeros(2))[1] for _ in range(20))


def test_images_show_the_point_the_trail_and_the_goal():
    env = SparsePointGoalEnv(render_mode="rgb_array")
    env.set_task([0.0, 1.0])
    env.reset(seed=0)
    for _ in range(7):
        env.step(np.float32([1.0, 0.0]))
    image = env.render()
    assert (image.shape, image.dtype) == ((128, 128, 3), np.uint8)
    rows, columns = np.nonzero((image == (30, 80, 200)).all(axis=2))  # the point, to the right
    assert (len(rows), 95 < columns.mean() < 115, abs(rows.mean() - 64) < 4) == (25, True, True)
    rows, columns = np.nonzero((image == (40, 160, 70)).all(axis=2))  # the goal, at the top, 40 pixels across
    np.testing.assert_allclose([rows.min(), rows.max(), columns.min(), columns.max()], [4, 44, 44, 84], atol=1)
    assert (image == (190, 190, 190)).all(axis=2).sum() >= 6  # the trail


def test_without_a_render_mode_there_is_no_image():
    env = SparsePointGoalEnv()
    env.reset(seed=0)
    assert env.render() is None


def test_an_unknown_render_mode_is_refused():
    with pytest.raises(ValueError, match="render_mode='human' is not supported: use None or 'rgb_array'"):
        SparsePointGoalEnv(render_mode="human")


def test_a_pickled_copy_continues_the_episode():
    env = SparsePointGoalEnv()
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.ones(2))
    copy = pickle.loads(pickle.dumps(env))
    for _ in range(15):
        step, expected = copy.step(np.ones(2)), env.step(np.ones(2))
        np.testing.assert_array_equal(step[0], expected[0])
        assert step[1:] == expected[1:]
    np.testing.assert_array_equal(copy.reset()[0], env.reset()[0])

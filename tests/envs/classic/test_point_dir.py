"""Tests of the toy point: its motion, its reward, its images."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sb3_bruno_envs import POINT_DIR_TASKS, PointDirEnv

COORDINATE = st.floats(-2.0, 2.0, width=32)


@given(x=COORDINATE, y=COORDINATE, angle=st.floats(0.0, 6.28))
def test_the_motion_and_the_reward(x, y, angle):
    env, direction = PointDirEnv(), np.array([np.cos(angle), np.sin(angle)])
    env.set_task(direction)
    start, _ = env.reset(seed=0)
    position, reward, terminated, truncated, _ = env.step(np.float32([x, y]))
    velocity = np.clip([x, y], -1.0, 1.0)
    np.testing.assert_allclose(position, start + 0.1 * velocity, atol=1e-6)
    expected = direction[0] * velocity[0] + direction[1] * velocity[1] - 0.05 * (velocity**2).sum()
    assert reward == pytest.approx(expected, abs=1e-12)
    assert position.dtype == np.float32
    assert (terminated, truncated) == (False, False)


def test_it_starts_near_the_origin_at_a_place_that_the_seed_decides():
    env = PointDirEnv()
    starts = np.stack([env.reset(seed=seed)[0] for seed in range(300)])
    assert starts.std() == pytest.approx(0.1, rel=0.1)
    np.testing.assert_array_equal(env.reset(seed=7)[0], starts[7])


def test_images_show_the_point_the_trail_and_the_direction():
    env = PointDirEnv(render_mode="rgb_array")
    env.set_task([0.0, 1.0])
    env.reset(seed=0)
    for _ in range(30):
        env.step(np.float32([1.0, 0.0]))
    image = env.render()
    assert (image.shape, image.dtype) == ((128, 128, 3), np.uint8)
    rows, columns = np.nonzero((image == (30, 80, 200)).all(axis=2))  # the point, far to the right
    assert (len(rows), columns.min() > 110, abs(rows.mean() - 64) < 8) == (25, True, True)
    rows, _ = np.nonzero((image == (40, 160, 70)).all(axis=2))  # the arrow, which points up
    assert 40 < rows.min() < 50
    assert rows.max() <= 65
    assert (image == (190, 190, 190)).all(axis=2).sum() > 20  # the trail


def test_a_point_far_away_stays_on_the_border_of_the_image():
    env = PointDirEnv(render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(200):
        env.step(np.float32([1.0, 1.0]))
    assert (env.render()[0, -1] == (30, 80, 200)).all()


def test_without_a_render_mode_there_is_no_image():
    env = PointDirEnv()
    env.reset(seed=0)
    assert env.render() is None


def test_an_unknown_render_mode_is_refused():
    with pytest.raises(ValueError, match="render_mode='human' is not supported: use None or 'rgb_array'"):
        PointDirEnv(render_mode="human")


def test_a_pickled_copy_continues_the_episode():
    env = PointDirEnv()
    env.reset(seed=0)
    env.step(np.ones(2))
    copy = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(copy.step(np.ones(2))[0], env.step(np.ones(2))[0])
    np.testing.assert_array_equal(copy.reset()[0], env.reset()[0])


def test_the_points_directions_are_opposite_unit_vectors_in_both_splits():
    train, test = POINT_DIR_TASKS.tasks("train"), POINT_DIR_TASKS.tasks("test")
    np.testing.assert_array_equal(train, [[-1, 0], [1, 0]])
    np.testing.assert_array_equal(test, train)

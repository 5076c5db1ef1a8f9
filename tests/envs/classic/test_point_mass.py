"""Tests of the points with inertia: their motion, what they earn, and what their tasks change."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sb3_bruno_envs import POINT_ROTATION_TASKS, PointGoalEnv, PointRotationEnv, point_goal_tasks

seeds = st.integers(0, 2**31)


@given(st.integers(1, 5), seeds)
def test_half_of_the_gap_to_the_velocity_asked_for_closes_in_a_step(dim, seed):
    rng = np.random.default_rng(seed)
    env, goal = PointGoalEnv(dim), rng.uniform(-1, 1, dim)
    env.set_task(goal)
    observation, _ = env.reset(seed=seed)
    assert observation.shape == (2 * dim,) and observation.dtype == np.float32
    position, velocity = np.split(observation.astype(np.float64), 2)
    np.testing.assert_array_equal(velocity, 0)
    for _ in range(5):
        action = rng.uniform(-2, 2, dim).astype(np.float32)
        observation, reward, terminated, truncated, _ = env.step(action)
        velocity = (velocity + 0.3 * np.clip(action, -1, 1)) / 2
        position = position + velocity
        np.testing.assert_allclose(observation, np.concatenate([position, velocity]), atol=1e-5)
        assert reward == pytest.approx(-np.linalg.norm(position - goal), abs=1e-5)
        assert not terminated and not truncated


@given(st.floats(0, 2 * np.pi), seeds)
def test_a_rotation_turns_what_the_actions_do(angle, seed):
    turned, straight = PointRotationEnv(), PointRotationEnv()
    turned.set_task([np.cos(angle), np.sin(angle)])
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert np.array_equal(turned.reset(seed=seed)[0], straight.reset(seed=seed)[0])
    action = np.random.default_rng(seed).uniform(-0.7, 0.7, 2)
    one, *_ = turned.step(action.astype(np.float32))
    other, *_ = straight.step((matrix @ action).astype(np.float32))
    np.testing.assert_allclose(one, other, atol=1e-5)


@pytest.mark.parametrize("dim", [1, 2, 5])
def test_the_dimension_chooses_the_tasks_that_belong_to_it(dim):
    env = gym.make("sb3_bruno_envs:PointGoal-v0", dim=dim, split="test")
    _, info = env.reset(seed=0)
    assert info["task"].shape == env.action_space.shape == (dim,)
    assert np.abs(point_goal_tasks(dim).tasks("test") - info["task"]).sum(axis=1).min() == 0
    assert env.get_wrapper_attr("task_space").shape == (dim,)
    other = gym.make("sb3_bruno_envs:PointGoal-v0", dim=dim, tasks=[[0.5] * dim])
    assert other.reset(seed=0)[1]["task"].tolist() == [0.5] * dim


def test_train_and_test_tasks_have_nothing_in_common():
    for tasks in (point_goal_tasks(3), POINT_ROTATION_TASKS):
        train, test = (tasks.tasks(split) for split in ("train", "test"))
        assert len(train) == 100 and len(test) == 20
        assert np.linalg.norm(train[:, None] - test, axis=-1).min() > 0
    np.testing.assert_allclose(np.linalg.norm(POINT_ROTATION_TASKS.tasks("train"), axis=1), 1, rtol=1e-6)


@pytest.mark.parametrize("dim", [1, 3])
def test_images_show_the_first_two_axes(dim):
    env = PointGoalEnv(dim, render_mode="rgb_array")
    env.set_task([0.5] * dim)
    env.reset(seed=0)
    before = env.render()
    assert before.shape == (128, 128, 3) and before.dtype == np.uint8
    env.step(np.ones(dim, dtype=np.float32))
    assert (env.render() != before).any()


@pytest.mark.parametrize(
    ("kwargs", "named"), [({"dim": 0}, "dim=0"), ({"render_mode": "human"}, "render_mode='human'")]
)
def test_bad_arguments_are_named(kwargs, named):
    with pytest.raises(ValueError, match=named):
        PointGoalEnv(**kwargs)


@pytest.mark.parametrize("dim", [0, -1, 2.0, "2", True, None])
def test_a_family_of_no_dimension_is_refused_before_its_tasks_are_drawn(dim):
    for make in (PointGoalEnv, point_goal_tasks):
        with pytest.raises(ValueError, match=f"dim={dim!r} is not a positive integer: give"):
            make(dim)
    with pytest.raises(ValueError, match=f"dim={dim!r} is not a positive integer: give"):
        gym.make("sb3_bruno_envs:PointGoal-v0", dim=dim)


@pytest.mark.parametrize(
    ("name", "standing", "random"), [("PointGoal-v0", -45.3, -77.9), ("PointRotation-v0", -39.1, -75.6)]
)
def test_standing_still_and_random_actions_earn_what_they_did(name, standing, random):
    env = gym.make(f"sb3_bruno_envs:{name}", split="test", draw="cycle", observe="plain")
    env.reset(seed=0)
    env.action_space.seed(0)
    for strength, known in ((0.0, standing), (1.0, random)):
        returns = []
        for _ in range(20):
            env.reset()
            returns.append(sum(env.step(strength * env.action_space.sample())[1] for _ in range(50)))
        assert np.mean(returns) == pytest.approx(known, rel=0.2)

"""Tests of ant and humanoid in a hidden direction: Gymnasium's physics to the bit, rewards and ends by hand, floors."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box

from sb3_bruno_envs import ANT_DIR_2D_TASKS, ANT_DIR_TASKS, HUMANOID_DIR_TASKS, AntDirEnv, HumanoidDirEnv
from support.robots import floor, rollout, torques

pytestmark = pytest.mark.mujoco

ANT_V5 = {"include_cfrc_ext_in_observation": False}
HUMANOID_V5 = {f"include_{extra}_in_observation": False for extra in ("cinert", "cvel", "qfrc_actuator", "cfrc_ext")}
robots = pytest.mark.parametrize("robot", [AntDirEnv, HumanoidDirEnv])


def make(env_id, **kwargs):
    return gym.make(f"sb3_bruno_envs:{env_id}", observe="plain", **kwargs)


@pytest.mark.parametrize(
    ("ours", "env_id", "kwargs"),
    [
        ({}, "Ant-v5", ANT_V5),
        ({"include_cfrc_ext_in_observation": True}, "Ant-v5", {}),
        ({}, "Humanoid-v5", HUMANOID_V5),
        ({"full_observation": True}, "Humanoid-v5", {}),
    ],
)
def test_in_the_direction_of_x_it_is_gymnasiums_to_the_bit(ours, env_id, kwargs):
    ours = (AntDirEnv if env_id == "Ant-v5" else HumanoidDirEnv)(**ours)
    theirs = gym.make(env_id, **kwargs).unwrapped
    assert ours.observation_space == theirs.observation_space
    np.testing.assert_array_equal(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    for action in torques(ours):
        mine, other = ours.step(action), theirs.step(action)
        np.testing.assert_array_equal(mine[0], other[0])
        assert mine[1:4] == other[1:4]
        assert mine[4].pop("velocity_in_direction") == mine[4]["x_velocity"]
        for name, value in other[4].items():
            np.testing.assert_array_equal(mine[4][name], value, err_msg=name)


def test_the_shapes_are_those_of_the_literature():
    ant, humanoid = AntDirEnv(), HumanoidDirEnv()
    assert (ant.observation_space.shape, ant.action_space.shape, ant.dt) == ((27,), (8,), 0.05)
    assert (humanoid.observation_space.shape, humanoid.action_space.shape) == ((45,), (17,))
    assert humanoid.dt == pytest.approx(0.015)
    assert HumanoidDirEnv(full_observation=True).observation_space.shape == (348,)


@pytest.mark.parametrize("direction", [[1.0, 0.0], [-1.0, 0.0], [0.6, -0.8]])
def test_the_ants_reward_and_its_end_follow_from_positions(direction):
    env, ends = make("AntDir2D-v0"), 0
    ant = env.unwrapped
    for seed in range(3):
        env.reset(seed=seed, options={"task": direction})
        for action in torques(env, 80):
            before = ant.data.body("torso").xpos[:2].copy()
            observation, reward, terminated, _, info = env.step(action)
            velocity = (ant.data.body("torso").xpos[:2] - before) / 0.05 @ np.float32(direction)  # m/s
            healthy = 0.2 <= observation[0] <= 1.0
            contact = 5e-4 * np.square(np.clip(ant.data.cfrc_ext, -1.0, 1.0)).sum()
            expected = velocity + healthy - 0.5 * np.square(action, dtype=np.float64).sum() - contact
            assert reward == pytest.approx(expected, abs=1e-5)
            assert info["velocity_in_direction"] == pytest.approx(velocity)
            assert terminated == (not healthy)
            if terminated:
                ends += 1
                break
    assert ends > 0


def test_the_humanoids_reward_and_its_end_follow_from_positions():
    env, direction = make("HumanoidDir-v0"), np.float32([-0.8, 0.6])
    humanoid = env.unwrapped

    def centre_of_mass():
        masses = humanoid.model.body_mass
        return (masses @ humanoid.data.xipos / masses.sum())[:2]  # m

    env.reset(seed=0, options={"task": direction})
    terminated, steps = False, iter(torques(env))
    while not terminated:
        action, before = next(steps), centre_of_mass()
        observation, reward, terminated, _, info = env.step(action)
        velocity = (centre_of_mass() - before) / 0.015 @ direction  # m/s
        healthy = 1.0 < observation[0] < 2.0
        contact = min(5e-7 * np.square(humanoid.data.cfrc_ext).sum(), 10.0)
        expected = 1.25 * velocity + 5.0 * healthy - 0.1 * np.square(action, dtype=np.float64).sum() - contact
        assert reward == pytest.approx(expected, abs=1e-5)
        assert info["velocity_in_direction"] == pytest.approx(velocity)
        assert terminated == (not healthy)


@robots
def test_an_episode_can_go_on_after_a_fall(robot):
    env = robot(terminate_when_unhealthy=False)
    env.reset(seed=0)
    assert not rollout(env)[:, env.observation_space.shape[0] + 1].any()


def test_the_camera_follows_the_ant_unless_told_otherwise():
    assert AntDirEnv().camera_name == "track"
    assert AntDirEnv(camera_id=-1).camera_name is None


@robots
@pytest.mark.parametrize("steps_before", [0, 10])
def test_a_pickled_copy_continues_the_episode_to_the_bit(robot, steps_before):
    env = robot()
    env.set_task([0.6, 0.8])
    env.reset(seed=1)
    rollout(env, steps_before)
    copy = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(rollout(copy, 15), rollout(env, 15))
    np.testing.assert_array_equal(copy.reset()[0], env.reset()[0])
    assert copy.direction.tolist() == [0.6, 0.8]


@robots
@pytest.mark.parametrize("task", [[1.0], [1.0, 1.0], [0.0, 0.0], [np.nan, 1.0], [[0.0, 1.0]], 1.0])
def test_what_is_no_unit_vector_is_refused(robot, task):
    with pytest.raises(ValueError, match="is no direction: give two numbers of length 1"):
        robot().set_task(task)


def test_standing_still_and_random_torques_earn_what_they_are_known_to():
    ant, humanoid = make("AntDir-v0", draw="cycle"), make("HumanoidDir-v0", draw="cycle")
    assert floor(ant, 2) == (pytest.approx(202.0, rel=0.2), 200.0)
    assert floor(ant, 10, random=True) == (pytest.approx(-26.0, abs=20.0), pytest.approx(84.0, rel=0.2))
    assert floor(humanoid, 4) == (pytest.approx(198.0, rel=0.2), pytest.approx(40.0, rel=0.2))
    assert floor(humanoid, 8, random=True) == (pytest.approx(92.0, rel=0.2), pytest.approx(20.0, rel=0.2))


def test_the_directions_are_those_of_their_seed():
    assert ANT_DIR_TASKS.tasks("train").tolist() == ANT_DIR_TASKS.tasks("test").tolist() == [[1.0, 0.0], [-1.0, 0.0]]
    train, test = ANT_DIR_2D_TASKS.tasks("train"), ANT_DIR_2D_TASKS.tasks("test")
    assert (train.shape, test.shape) == ((100, 2), (30, 2))
    assert ANT_DIR_2D_TASKS == HUMANOID_DIR_TASKS
    degrees = np.degrees(np.arctan2(*np.concatenate([train[[0, 1, 2, -1]], test[[0, -1]]]).T[::-1])) % 360.0
    np.testing.assert_allclose(degrees, [94.3289, 57.1262, 100.1256, 45.1451, 246.1151, 66.9987], atol=1e-4)
    for tasks in (ANT_DIR_TASKS, ANT_DIR_2D_TASKS):
        assert tasks.space == Box(-1.0, 1.0, (2,))
        np.testing.assert_allclose(np.linalg.norm(tasks.tasks("test"), axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "train", "test"), [("tavt-2", [0, 90], [135, 315]), ("tavt-4", [0, 90, 180, 270], [45, 135, 225, 315])]
)
def test_the_published_directions_in_degrees(name, train, test):
    tasks = make("AntDir2D-v0", tasks=name).get_wrapper_attr("task_distribution")
    for split, degrees in (("train", train), ("test", test)):
        radians = np.radians(degrees)
        expected = np.stack([np.cos(radians), np.sin(radians)], axis=1)
        np.testing.assert_allclose(tasks.tasks(split), expected, atol=1e-7)

"""Tests of the half-cheetahs: Gymnasium's physics to the bit, the two rewards, exact pickling, images."""

import os
import pickle
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box

from sb3_bruno_envs import CHEETAH_DIR_TASKS, CHEETAH_VEL_TASKS, CheetahDirEnv, CheetahVelEnv, MetaHalfCheetahEnv

pytestmark = pytest.mark.mujoco

STEPS = 40  # trajectories of different MuJoCo versions part after about 50


def actions(n=STEPS):
    """Full torques, so that the feet hit the ground; (n, 6)."""
    return np.random.default_rng(0).uniform(-1.0, 1.0, (n, 6)).astype(np.float32)


def rollout(env, acts):
    """Observations (n, 17) and rewards (n,) of the actions."""
    steps = [env.step(action) for action in acts]
    return np.array([step[0] for step in steps]), np.array([step[1] for step in steps])


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_running_forward_at_gymnasiums_cost_is_half_cheetah_v5_to_the_bit():
    ours, theirs = CheetahDirEnv(ctrl_cost_weight=0.1), gym.make("HalfCheetah-v5")
    np.testing.assert_array_equal(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    observations, rewards = rollout(ours, actions())
    expected_observations, expected_rewards = rollout(theirs, actions())
    np.testing.assert_array_equal(observations, expected_observations)
    np.testing.assert_array_equal(rewards, expected_rewards)


def test_every_number_of_the_model_is_gymnasiums():
    ours, theirs = CheetahDirEnv().model, gym.make("HalfCheetah-v5").unwrapped.model
    arrays = [name for name in dir(theirs) if isinstance(getattr(theirs, name), np.ndarray)]
    assert {"body_mass", "dof_invweight0"} < set(arrays)
    for name in arrays:
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    for name in ("extent", "meaninertia", "meanmass", "meansize"):
        assert getattr(ours.stat, name) == getattr(theirs.stat, name)
    assert ours.body_mass.sum() == pytest.approx(14.0)  # kg


def test_no_log_file_is_written(tmp_path):
    env = CheetahVelEnv()
    env.reset(seed=0)
    rollout(env, actions(3))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("task", "direction"), [([1.0, 0.0], -1.0), ([0.0, 1.0], 1.0)])
def test_the_direction_reward(task, direction):
    env = CheetahDirEnv()
    env.set_task(task)
    env.reset(seed=0)
    for action in actions(10):
        _, reward, _, _, info = env.step(action)
        expected = direction * info["x_velocity"] - 0.05 * np.square(action, dtype=np.float64).sum()
        assert reward == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("target", [0.0, 0.4, 2.9])  # m/s, slower and faster than the cheetah runs here
def test_the_velocity_reward(target):
    env = CheetahVelEnv()
    env.set_task([target])
    env.reset(seed=0)
    for action in actions(20):
        before = env.data.qpos[0]
        _, reward, _, _, info = env.step(action)
        velocity = (env.data.qpos[0] - before) / 0.05  # m/s
        assert info["x_velocity"] == pytest.approx(velocity)
        expected = -abs(velocity - target) - 0.05 * np.square(action, dtype=np.float64).sum()
        assert reward == pytest.approx(expected, rel=1e-6)


def test_the_shapes_are_those_of_the_literature_and_nothing_terminates():
    env = CheetahDirEnv()
    env.reset(seed=0)
    assert (env.observation_space.shape, env.action_space.shape, env.dt) == ((17,), (6,), 0.05)
    assert not any(env.step(action)[2] for action in actions())


def test_the_base_class_leaves_the_progress_open():
    env = MetaHalfCheetahEnv()
    env.reset(seed=0)
    with pytest.raises(NotImplementedError):
        env.step(np.zeros(6))


@pytest.mark.parametrize("steps_before", [0, 1, 25])
def test_a_pickled_copy_continues_the_episode_to_the_bit(steps_before):
    env = gym.make("sb3_bruno_envs:CheetahVel-v0", observe="plain", ctrl_cost_weight=0.2)
    env.action_space.seed(0)
    env.reset(seed=1, options={"task": [2.5]})
    rollout(env, actions(steps_before))
    copy = pickle.loads(pickle.dumps(env))
    for mine, others in zip(rollout(env, actions()), rollout(copy, actions()), strict=True):
        np.testing.assert_array_equal(mine, others)
    np.testing.assert_array_equal(env.reset()[0], copy.reset()[0])  # their generators go on alike, too
    np.testing.assert_array_equal(env.action_space.sample(), copy.action_space.sample())
    assert copy.unwrapped.velocity == env.unwrapped.velocity
    assert copy.spec == env.spec


def test_a_model_without_a_total_mass_is_left_to_gymnasium(tmp_path):
    source = Path(CheetahDirEnv().fullpath).read_text()
    own = tmp_path / "heavy.xml"
    own.write_text(source.replace('settotalmass="14"', ""))
    assert CheetahDirEnv(xml_file=str(own)).model.body_mass.sum() > 14.5


@pytest.mark.parametrize("size", [{}, {"width": 800, "height": 600}])
def test_images_are_rendered_without_a_screen(monkeypatch, size):
    """Needs EGL, as Debian's libegl1 and libegl-mesa0 bring it; the larger size grows the offscreen frame."""
    monkeypatch.setenv("MUJOCO_GL", os.environ.get("MUJOCO_GL", "egl"))
    env = gym.make("sb3_bruno_envs:CheetahDir-v0", render_mode="rgb_array", **size)
    env.reset(seed=0)
    before = env.render()
    assert before.shape == (size.get("height", 480), size.get("width", 480), 3)
    assert before.dtype == np.uint8
    assert before[-100:, -100:].std() > 10  # the floor's squares reach into the corner
    rollout(env.unwrapped, actions(10))
    assert (env.render() != before).any()
    env.close()


def test_the_camera_follows_the_cheetah(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", os.environ.get("MUJOCO_GL", "egl"))

    def skin(**kwargs):
        """The share of the picture that is cheetah, which alone is redder than green, 50 m from the start."""
        env = gym.make("sb3_bruno_envs:CheetahDir-v0", render_mode="rgb_array", **kwargs)
        env.reset(seed=0)
        env.render()  # a free camera looks where the cheetah is at first
        env.unwrapped.data.qpos[0] = 50.0
        rollout(env.unwrapped, actions(2))
        picture = env.render().astype(int)
        env.close()
        return (picture[..., 0] > picture[..., 1] + 30).mean()

    assert skin() > 0.01
    assert skin(camera_id=-1) < 1e-4  # the free camera stays where it is


def test_the_cheetahs_tasks_are_the_papers():
    assert CHEETAH_DIR_TASKS.tasks("train").tolist() == [[1.0, 0.0], [0.0, 1.0]]
    assert CHEETAH_DIR_TASKS.tasks("test").tolist() == [[1.0, 0.0], [0.0, 1.0]]
    train, test = CHEETAH_VEL_TASKS.tasks("train"), CHEETAH_VEL_TASKS.tasks("test")
    assert (train.shape, test.shape) == ((100, 1), (30, 1))
    np.testing.assert_array_equal(train[:3, 0], np.float32([0.7861, 0.4761, 0.8344]))  # m/s
    np.testing.assert_array_equal(test[:3, 0], np.float32([2.051, 0.0831, 0.7015]))
    assert CHEETAH_VEL_TASKS.space == Box(0.0, 3.0, (1,))

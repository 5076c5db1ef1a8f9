"""Tests of the cheetah under a hidden gravity: it is an edited model file's, and Earth's Gymnasium's to the bit."""

import pickle
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.mujoco.half_cheetah_v5 import HalfCheetahEnv
from gymnasium.spaces import Box

from sb3_bruno_envs import CHEETAH_GRAVITY_TASKS, CheetahGravityEnv

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


@pytest.mark.parametrize("before", [None, [3.0], [40.0]])
def test_earths_gravity_is_half_cheetah_v5_to_the_bit_after_any_other(before):
    ours, theirs = gym.make("sb3_bruno_envs:CheetahGravity-v0", observe="plain"), gym.make("HalfCheetah-v5")
    if before is not None:
        ours.reset(seed=0, options={"task": before})
        rollout(ours, actions(3))
    first, info = ours.reset(seed=3, options={"task": [9.81]})
    assert info["task"].dtype == np.float32
    np.testing.assert_array_equal(first, theirs.reset(seed=3)[0])
    for mine, others in zip(rollout(ours, actions()), rollout(theirs, actions()), strict=True):
        np.testing.assert_array_equal(mine, others)


def test_without_a_task_it_is_earths():
    ours, theirs = CheetahGravityEnv(), gym.make("HalfCheetah-v5")
    np.testing.assert_array_equal(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    np.testing.assert_array_equal(rollout(ours, actions())[1], rollout(theirs, actions())[1])


@pytest.mark.parametrize("gravity", [2.4525, 4.905, 19.62])  # quotients of 9.81 that float32 holds exactly
def test_the_physics_are_those_of_an_edited_model_file(tmp_path, gravity):
    ours = CheetahGravityEnv(ctrl_cost_weight=0.05)
    ours.set_task([gravity])
    text = Path(ours.fullpath).read_text()
    assert 'gravity="0 0 -9.81"' in text
    (tmp_path / "edited.xml").write_text(text.replace('gravity="0 0 -9.81"', f'gravity="0 0 -{gravity}"'))
    theirs = HalfCheetahEnv(xml_file=str(tmp_path / "edited.xml"), ctrl_cost_weight=0.05)
    np.testing.assert_array_equal(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    for mine, others in zip(rollout(ours, actions()), rollout(theirs, actions()), strict=True):
        np.testing.assert_allclose(mine, others, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("gravity", [2.9, 33.1])
def test_the_reward_is_the_forward_velocity_less_the_cost_of_control(gravity):
    env = CheetahGravityEnv()
    env.set_task([gravity])
    env.reset(seed=0)
    for action in actions(20):
        before = env.data.qpos[0]
        _, reward, terminated, truncated, info = env.step(action)
        velocity = (env.data.qpos[0] - before) / 0.05  # m/s
        assert reward == pytest.approx(velocity - 0.1 * np.square(action, dtype=np.float64).sum(), abs=1e-6)
        assert info["reward_forward"] == pytest.approx(velocity)
        assert (terminated, truncated) == (False, False)


@pytest.mark.parametrize("steps_before", [0, 25])
def test_a_pickled_copy_continues_under_the_same_gravity_to_the_bit(steps_before):
    env = gym.make("sb3_bruno_envs:CheetahGravity-v0", observe="plain")
    env.reset(seed=1, options={"task": [5.0]})
    rollout(env, actions(steps_before))
    copy = pickle.loads(pickle.dumps(env))
    for mine, others in zip(rollout(env, actions()), rollout(copy, actions()), strict=True):
        np.testing.assert_array_equal(mine, others)
    np.testing.assert_array_equal(env.unwrapped.model.opt.gravity, copy.unwrapped.model.opt.gravity)
    np.testing.assert_array_equal(env.reset()[1]["task"], copy.reset()[1]["task"])


@pytest.fixture(scope="module")
def returns():
    """Returns of standing still and of random actions, (2, 18), over every third test task and the extreme ones."""
    beyond = gym.make("sb3_bruno_envs:CheetahGravity-v0", tasks="beyond").get_wrapper_attr("task_distribution")
    gravities = np.sort(np.concatenate([CHEETAH_GRAVITY_TASKS.tasks("test"), beyond.tasks("test")]).ravel())
    env, rng = CheetahGravityEnv(), np.random.default_rng(0)
    found = []
    for gravity in [*gravities[::3], gravities[-1]]:
        env.set_task([gravity])
        for strength in (0.0, 1.0):
            env.reset(seed=0)
            observations, rewards = rollout(env, strength * rng.uniform(-1.0, 1.0, (200, 6)))
            assert np.abs(observations).max() < 150.0, gravity
            found.append(rewards.sum())
    assert not env.data.warning.number.any()
    return np.reshape(found, (-1, 2)).T


def test_the_simulation_is_stable_and_standing_still_earns_nothing(returns):
    assert np.abs(returns[0]).max() < 10.0
    assert abs(returns[0].mean()) < 1.0


def test_random_actions_earn_less_than_standing_still(returns):
    """Their torques cost 40, and under little gravity they drive the cheetah backward."""
    assert returns[1].mean() == pytest.approx(-54.0, rel=0.2)


@pytest.mark.parametrize("task", [[0.0], [-9.81], [np.nan], [np.inf], [1e-50], [1e50], [9.81, 1.0], 9.81, []])
def test_an_impossible_task_is_refused(task):
    with pytest.raises(ValueError, match=r"give the gravity in m/s\^2, of shape \(1,\), finite and above 0"):
        CheetahGravityEnv().set_task(task)


def test_the_gravities_are_log_uniform_and_those_of_their_seed():
    train, test = CHEETAH_GRAVITY_TASKS.tasks("train"), CHEETAH_GRAVITY_TASKS.tasks("test")
    assert (train.shape, test.shape) == ((100, 1), (30, 1))
    np.testing.assert_allclose(train[[0, 1, 2, -1], 0], [5.498405, 4.276145, 5.718065, 3.943569], rtol=1e-6)
    np.testing.assert_allclose(test[-1, 0], 4.571161, rtol=1e-6)
    exponents = np.log(np.concatenate([train, test]) / 9.81) / np.log(1.5)
    assert np.abs(exponents).max() < 3.0
    assert exponents.std() == pytest.approx(6.0 / np.sqrt(12.0), rel=0.15)
    assert CHEETAH_GRAVITY_TASKS.train_box == Box(np.float32([9.81 / 1.5**3]), np.float32([9.81 * 1.5**3]))
    beyond = gym.make("sb3_bruno_envs:CheetahGravity-v0", tasks="beyond").get_wrapper_attr("task_distribution")
    exponents = np.log(beyond.tasks("test").ravel() / 9.81) / np.log(1.5)
    assert ((np.abs(exponents) > 3.0) & (np.abs(exponents) < 4.0)).all()
    assert (exponents > 0.0).sum() == 10

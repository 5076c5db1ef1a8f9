"""Tests of the cheetah of a hidden body: an edited model file says the same, and factors never compound."""

import pickle
import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.mujoco.half_cheetah_v5 import HalfCheetahEnv
from gymnasium.spaces import Box

from sb3_bruno_envs import CHEETAH_PARAMS_TASKS, CheetahDirEnv, CheetahParamsEnv

pytestmark = pytest.mark.mujoco

STEPS = 40  # trajectories of different MuJoCo versions part after about 50
# Light bodies amplify a rounded mass within STEPS: where the mass is a power of two, nothing is rounded.
TASKS = [[0.5, 1.5, 0.7, 0.9], [2.0, 0.5, 2.0, 0.5], [0.25, 2.5, 0.4, 1.1], [1.3, 1.0, 1.7, 0.6], [1.0, 1.0, 1.0, -0.8]]


def actions(n=STEPS):
    """Full torques, so that the feet hit the ground; (n, 6)."""
    return np.random.default_rng(0).uniform(-1.0, 1.0, (n, 6)).astype(np.float32)


def rollout(env, acts):
    """Observations (n, 17) and rewards (n,) of the actions."""
    steps = [env.step(action) for action in acts]
    return np.array([step[0] for step in steps]), np.array([step[1] for step in steps])


def model_arrays(model):
    arrays = {name: getattr(model, name) for name in dir(model)}
    arrays |= {f"stat.{name}": getattr(model.stat, name) for name in ("extent", "meaninertia", "meanmass", "meansize")}
    return {name: np.array(array) for name, array in arrays.items() if isinstance(array, np.ndarray | float)}


def edited_file(folder, task):
    """Gymnasium's model file with its numbers multiplied."""
    mass, damping, friction, strength = task
    text = Path(CheetahDirEnv().fullpath).read_text()
    text = text.replace('settotalmass="14"', f'settotalmass="{14 * mass!r}"')
    text = text.replace('friction=".4 .1 .1"', f'friction="{0.4 * friction!r} .1 .1"')
    text = re.sub(r'damping="([\d.]+)"', lambda found: f'damping="{float(found[1]) * damping!r}"', text)
    text = re.sub(r'gear="([\d.]+)"', lambda found: f'gear="{float(found[1]) * strength!r}"', text)
    path = folder / "edited.xml"
    path.write_text(text)
    return str(path)


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("task", TASKS)
def test_the_physics_are_those_of_an_edited_model_file(tmp_path, task):
    ours = CheetahParamsEnv()
    ours.set_task(task)
    theirs = HalfCheetahEnv(xml_file=edited_file(tmp_path, task), ctrl_cost_weight=0.05)  # warns, writes its log
    np.testing.assert_array_equal(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    observations, rewards = rollout(ours, actions())
    expected_observations, expected_rewards = rollout(theirs, actions())
    np.testing.assert_allclose(observations, expected_observations, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(rewards, expected_rewards, rtol=0.0, atol=1e-9)
    mine, others = model_arrays(ours.model), model_arrays(theirs.model)
    assert {"dof_invweight0", "body_invweight0", "dof_M0", "body_inertia", "stat.meaninertia"} < set(mine)
    for name, expected in others.items():
        np.testing.assert_allclose(mine[name], expected, rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("index", range(4))
def test_each_factor_changes_the_motion(index):
    env, factors = CheetahParamsEnv(), np.ones(4)
    env.reset(seed=0)
    untouched, _ = rollout(env, actions())
    factors[index] = 0.6
    env.set_task(factors)
    env.reset(seed=0)
    changed, _ = rollout(env, actions())
    assert np.abs(changed - untouched).max() > 0.5


def test_factors_of_one_are_the_untouched_model_to_the_bit_after_any_other():
    env, untouched = CheetahParamsEnv(), CheetahDirEnv()
    for task in [*TASKS, *CHEETAH_PARAMS_TASKS.tasks("test")]:
        env.set_task(task)
        env.reset(seed=0)
    env.set_task(np.ones(4, np.float32))
    mine = model_arrays(env.model)
    for name, expected in model_arrays(untouched.model).items():
        np.testing.assert_array_equal(mine[name], expected, err_msg=name)
    np.testing.assert_array_equal(env.reset(seed=5)[0], untouched.reset(seed=5)[0])
    for mine, others in zip(rollout(env, actions()), rollout(untouched, actions()), strict=True):
        np.testing.assert_array_equal(mine, others)


def test_a_task_set_again_in_mid_episode_changes_nothing():
    env, again = CheetahParamsEnv(), CheetahParamsEnv()
    for cheetah in (env, again):
        cheetah.set_task(TASKS[0])
        cheetah.reset(seed=0)
        rollout(cheetah, actions(10))
    again.set_task(TASKS[0])
    np.testing.assert_array_equal(again.data.xpos, env.data.xpos)  # what an image shows
    np.testing.assert_array_equal(rollout(again, actions())[0], rollout(env, actions())[0])


def test_the_reward_is_the_forward_velocity_less_the_cost_of_control():
    env = CheetahParamsEnv()
    env.set_task(TASKS[0])
    env.reset(seed=0)
    for action in actions(10):
        before = env.data.qpos[0]
        _, reward, terminated, _, _ = env.step(action)
        velocity = (env.data.qpos[0] - before) / 0.05  # m/s
        assert reward == pytest.approx(velocity - 0.05 * np.square(action, dtype=np.float64).sum(), abs=1e-6)
        assert not terminated


@pytest.mark.parametrize("steps_before", [0, 25])
def test_a_pickled_copy_continues_in_the_same_body_to_the_bit(steps_before):
    env = gym.make("sb3_bruno_envs:CheetahParams-v0", observe="plain")
    env.reset(seed=1, options={"task": TASKS[1]})
    rollout(env, actions(steps_before))
    copy = pickle.loads(pickle.dumps(env))
    for mine, others in zip(rollout(env, actions()), rollout(copy, actions()), strict=True):
        np.testing.assert_array_equal(mine, others)
    np.testing.assert_array_equal(env.reset()[0], copy.reset()[0])
    np.testing.assert_array_equal(env.unwrapped.model.body_mass, copy.unwrapped.model.body_mass)


@pytest.mark.parametrize("split", ["train", "test"])
def test_the_simulation_is_stable_in_every_task(split):
    env, rng = CheetahParamsEnv(), np.random.default_rng(0)
    for task in CHEETAH_PARAMS_TASKS.tasks(split):
        env.set_task(task)
        env.reset(seed=0)
        for _ in range(200):
            observation = env.step(np.sign(rng.uniform(-1.0, 1.0, 6)))[0]
            assert np.abs(observation).max() < 150.0, task  # the untouched cheetah's joints reach 34 rad/s
        assert not env.data.warning.number.any()


@pytest.mark.parametrize(
    "task",
    [
        [1.0, 1.0, 1.0],
        [1.0, 0.0, 1.0, 1.0],
        [-1.0, 1.0, 1.0, 1.0],
        [np.nan, 1.0, 1.0, 1.0],
        [1.0, 1.0, 1.0, np.nan],
        [[1.0] * 4],
    ],
)
def test_an_impossible_task_is_refused(task):
    with pytest.raises(ValueError, match=r"give factors of .*, of shape \(4,\), finite, and the first 3 above 0"):
        CheetahParamsEnv().set_task(task)


def test_the_cheetahs_bodies_lie_in_their_ranges():
    train, test = CHEETAH_PARAMS_TASKS.tasks("train"), CHEETAH_PARAMS_TASKS.tasks("test")
    assert (train.shape, test.shape) == ((100, 4), (40, 4))
    assert CHEETAH_PARAMS_TASKS.inside_train_box(test).tolist() == [True] * 20 + [False] * 20
    assert CHEETAH_PARAMS_TASKS.train_box == Box(np.float32([0.5, 0.5, 0.5, -1.0]), np.float32([2.0, 2.0, 2.0, 1.0]))
    log2 = np.log2(np.abs(train))
    np.testing.assert_allclose(log2.mean(axis=0), [0.0, 0.0, 0.0, -0.5], atol=0.15)  # 2.6 standard errors, fixed seed
    np.testing.assert_allclose(log2.std(axis=0), np.array([2.0, 2.0, 2.0, 1.0]) / np.sqrt(12.0), rtol=0.15)
    for split in (train, test[:20], test[20:]):  # about one body of two has its motors turned round
        assert 0.3 < (split[:, 3] < 0).mean() < 0.7
    strange = np.abs(test[20:])
    assert ((strange < [0.5, 0.5, 0.5, 0.0]) | (strange > [2.0, 2.0, 2.0, 1.0])).any(axis=0).all()  # in each factor
    assert len(np.unique(np.concatenate([train, test]), axis=0)) == 140

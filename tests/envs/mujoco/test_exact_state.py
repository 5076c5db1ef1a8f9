"""Tests of ExactState on five of Gymnasium's robots: their physics and their pickles, to the bit."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.mujoco.ant_v5 import AntEnv
from gymnasium.envs.mujoco.half_cheetah_v5 import HalfCheetahEnv
from gymnasium.envs.mujoco.hopper_v5 import HopperEnv
from gymnasium.envs.mujoco.humanoid_v5 import HumanoidEnv
from gymnasium.envs.mujoco.walker2d_v5 import Walker2dEnv

from sb3_bruno_envs.mujoco.exact_state import ExactState
from sb3_bruno_envs.mujoco.physics import derive_constants

pytestmark = pytest.mark.mujoco

STEPS = 40  # trajectories of different MuJoCo versions part after about 50


class ExactAnt(ExactState, AntEnv):
    """Ant-v5 with nothing changed."""


class ExactHumanoid(ExactState, HumanoidEnv):
    """Humanoid-v5 with nothing changed."""


class ExactWalker(ExactState, Walker2dEnv):
    """Walker2d-v5 with nothing changed."""


class ExactHopper(ExactState, HopperEnv):
    """Hopper-v5 with nothing changed."""


class ExactCheetah(ExactState, HalfCheetahEnv):
    """HalfCheetah-v5 with nothing changed."""


class HeavyAnt(ExactAnt):
    """Has a constructor of its own, and an attribute that Gymnasium's constructor already needs."""

    def __init__(self, factor):
        self.factor = factor
        super().__init__(reset_noise_scale=0.2, include_cfrc_ext_in_observation=False)
        self.refresh_constants()

    def _initialize_simulation(self):
        model, data = super()._initialize_simulation()
        model.body_mass[:] *= self.factor
        return model, data


robots = pytest.mark.parametrize(
    ("robot", "env_id"),
    [
        (ExactAnt, "Ant-v5"),
        (ExactHumanoid, "Humanoid-v5"),
        (ExactWalker, "Walker2d-v5"),
        (ExactHopper, "Hopper-v5"),
        (ExactCheetah, "HalfCheetah-v5"),
    ],
)


def rollout(env, n=STEPS):
    """Full torques, so that feet hit the ground; all numbers of each step, flat, (n, numbers)."""
    high, rng = env.action_space.high, np.random.default_rng(0)
    steps = [env.step(rng.uniform(-high, high).astype(np.float32)) for _ in range(n)]
    return np.array([np.hstack([*step[:4], *(np.ravel(value) for value in step[4].values())]) for step in steps])


def model_numbers(model):
    parts = {"model": model, "opt": model.opt, "stat": model.stat}
    fields = {
        f"{key}.{name}": getattr(part, name) for key, part in parts.items() for name in dir(part) if name[0] != "_"
    }
    return {name: np.array(value) for name, value in fields.items() if isinstance(value, np.ndarray | float | int)}


def assert_same_numbers(model, other):
    numbers, others = model_numbers(model), model_numbers(other)
    assert {"model.body_mass", "model.dof_invweight0", "opt.gravity", "stat.meaninertia"} < set(numbers)
    assert set(numbers) == set(others)
    for name, value in numbers.items():
        np.testing.assert_array_equal(value, others[name], err_msg=name)


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@robots
def test_the_physics_are_gymnasiums_to_the_bit(robot, env_id):
    ours, theirs = robot(), gym.make(env_id).unwrapped
    assert_same_numbers(ours.model, theirs.model)
    np.testing.assert_array_equal(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    np.testing.assert_array_equal(rollout(ours), rollout(theirs))


@robots
@pytest.mark.parametrize("steps_before", [0, 1, 15])
def test_a_pickled_copy_continues_the_episode_to_the_bit(robot, env_id, steps_before):
    env = robot()
    env.reset(seed=1)
    env.action_space.seed(0)
    rollout(env, steps_before)
    copy = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(copy._get_obs(), env._get_obs())
    np.testing.assert_array_equal(copy.data.xipos, env.data.xipos)  # what an image shows
    np.testing.assert_array_equal(rollout(copy, STEPS - steps_before), rollout(env, STEPS - steps_before))
    np.testing.assert_array_equal(copy.reset()[0], env.reset()[0])  # their generators go on alike, too
    np.testing.assert_array_equal(copy.action_space.sample(), env.action_space.sample())


@robots
def test_a_changed_body_survives_the_pickle(robot, env_id):
    env, untouched = robot(), robot()
    env.model.body_mass[:] *= np.linspace(0.5, 2.0, env.model.nbody)
    env.model.dof_damping[:] *= 1.3
    env.model.opt.gravity[2] = -5.0
    env.refresh_constants()
    env.reset(seed=1)
    rollout(env, 5)
    copy = pickle.loads(pickle.dumps(env))
    assert_same_numbers(copy.model, env.model)
    assert_same_numbers(copy.original_model, untouched.model)
    expected = rollout(env, 20)
    np.testing.assert_array_equal(rollout(copy, 20), expected)
    untouched.reset(seed=1)
    assert np.abs(rollout(untouched, 25)[5:] - expected).max() > 0.1


def test_a_copy_needs_no_constructor_of_a_subclass():
    env = HeavyAnt(2.0)
    env.reset(seed=0)
    rollout(env, 3)
    copy = pickle.loads(pickle.dumps(env))
    assert copy.factor == 2.0
    assert_same_numbers(copy.model, env.model)
    np.testing.assert_array_equal(rollout(copy, 20), rollout(env, 20))


def test_a_copy_renders_its_own_simulation():
    env = ExactHopper(width=100, height=50)
    copy = pickle.loads(pickle.dumps(env))
    renderer = copy.mujoco_renderer
    assert (renderer.model, renderer.data) == (copy.model, copy.data)
    assert (renderer.width, renderer.height) == (100, 50)


@robots
def test_constants_derived_from_an_untouched_body_are_those_it_has(robot, env_id):
    env = robot()
    derive_constants(env.model)
    assert_same_numbers(env.model, env.original_model)


@robots
def test_refreshed_constants_leave_the_episode_where_it_was(robot, env_id):
    env, again = robot(), robot()
    for each in (env, again):
        each.reset(seed=0)
        rollout(each, 10)
    again.refresh_constants()
    np.testing.assert_array_equal(rollout(again, 20), rollout(env, 20))


@robots
def test_a_pickle_holds_no_model_and_no_file_is_written(tmp_path, robot, env_id):
    env = robot()
    env.reset(seed=0)
    env.model.body_mass[:] *= 2.0
    env.refresh_constants()
    assert len(pickle.dumps(env)) < 60_000  # bytes; a model takes 500,000
    assert list(tmp_path.iterdir()) == []

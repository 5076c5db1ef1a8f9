"""Tests of scale_physics: its models are those of edited model files, and nothing compounds or stays behind."""

import pickle

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from sb3_bruno_envs import CheetahDirEnv, scale_physics
from sb3_bruno_envs.mujoco.exact_state import _numbers, _parts

pytestmark = pytest.mark.mujoco

ROBOTS = ["Walker2d-v5", "Hopper-v5", "Ant-v5", "HalfCheetah-v5"]
SCALES = {"mass": 2.0, "inertia": 1.5, "damping": 0.7, "friction": 0.5, "gear": -0.8, "gravity": 1.2}
CONSTANTS = {"body_subtreemass", "body_invweight0", "dof_invweight0", "dof_M0", "actuator_acc0"}
robots = pytest.mark.parametrize("robot", ROBOTS)


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def numbers(model):
    """All numbers of a model, its options and its statistics."""
    return {f"{i}.{name}": value for i, part in enumerate(_parts(model)) for name, value in _numbers(part).items()}


def assert_same_numbers(model, other):
    others = numbers(other)
    for name, value in numbers(model).items():
        np.testing.assert_array_equal(value, others[name], err_msg=name)


def rollout(env, n=40):
    """Observations and rewards of full torques, (n, numbers)."""
    high, rng = env.action_space.high, np.random.default_rng(0)
    steps = [env.step(rng.uniform(-high, high).astype(np.float32)) for _ in range(n)]
    return np.array([[*step[0], step[1]] for step in steps])


@pytest.mark.parametrize("robot", ["Walker2d-v5", "Hopper-v5", "Ant-v5"])
def test_the_model_is_that_of_an_edited_model_file(robot):
    env = gym.make(robot)
    scale_physics(env, **{name: scale for name, scale in SCALES.items() if name != "inertia"})
    spec = mujoco.MjSpec.from_file(env.unwrapped.fullpath)
    for geom in spec.geoms:
        geom.density *= SCALES["mass"]
        geom.friction[0] *= SCALES["friction"]
    for joint in spec.joints:
        joint.damping *= SCALES["damping"]
    for actuator in spec.actuators:
        actuator.gear *= SCALES["gear"]
    spec.option.gravity = SCALES["gravity"] * spec.option.gravity
    mine, expected = numbers(env.unwrapped.model), numbers(spec.compile())
    assert {f"0.{name}" for name in CONSTANTS} | {"2.meaninertia", "2.meanmass"} < set(mine)
    for name, value in mine.items():
        if "global" not in name and "offwidth" not in name:
            np.testing.assert_allclose(value, expected[name], rtol=1e-9, atol=1e-12, err_msg=name)


@robots
def test_mass_by_hand_is_another_simulation_because_inertia_and_constants_are_stale(robot):
    by_hand, ours = gym.make(robot), gym.make(robot)
    by_hand.unwrapped.model.body_mass[:] *= 2.0
    scale_physics(ours, mass=2.0)
    stale, fresh = by_hand.unwrapped.model, ours.unwrapped.model
    np.testing.assert_array_equal(stale.body_mass, fresh.body_mass)
    np.testing.assert_array_equal(2.0 * stale.body_inertia, fresh.body_inertia)
    assert (stale.dof_invweight0 > fresh.dof_invweight0).all()
    for env in (by_hand, ours):
        env.reset(seed=0)
    assert np.abs(rollout(by_hand) - rollout(ours)).max() > 0.1


@robots
def test_a_call_twice_is_as_one_and_a_call_without_factors_restores_to_the_bit(robot):
    env, once, fresh = gym.make(robot), gym.make(robot), gym.make(robot)
    scale_physics(env, mass=0.5, gravity=0.0)
    scale_physics(env, **SCALES)
    scale_physics(env, **SCALES)
    scale_physics(once, **SCALES)
    assert_same_numbers(env.unwrapped.model, once.unwrapped.model)
    scale_physics(env)
    assert_same_numbers(env.unwrapped.model, fresh.unwrapped.model)
    np.testing.assert_array_equal(env.reset(seed=1)[0], fresh.reset(seed=1)[0])
    np.testing.assert_array_equal(rollout(env), rollout(fresh))


@robots
@pytest.mark.parametrize("name", [name for name in SCALES if name != "damping"])
def test_each_factor_changes_the_motion(robot, name):
    changed, original = gym.make(robot), gym.make(robot)
    scale_physics(changed, **{name: SCALES[name]})
    for env in (changed, original):
        env.reset(seed=0)
    assert np.abs(rollout(changed) - rollout(original)).max() > 1e-3


@robots
def test_in_mid_episode_the_state_stays(robot):
    env, other = gym.make(robot), gym.make(robot)
    for each in (env, other):
        each.reset(seed=0)
        rollout(each, 10)
    scale_physics(env, **SCALES)
    np.testing.assert_array_equal(env.unwrapped.data.qpos, other.unwrapped.data.qpos)
    scale_physics(env)
    np.testing.assert_array_equal(rollout(env), rollout(other))


def test_parts_are_named_as_in_the_model_file():
    env = gym.make("Walker2d-v5")
    scale_physics(
        env, mass={"torso": 3.0}, damping={"foot_joint": 0.5}, friction={"floor": 0.5}, gear={"thigh_joint": 2.0}
    )
    model, original = env.unwrapped.model, env.unwrapped.original_model
    torso = model.body("torso").id
    assert model.body_mass[torso] == 3.0 * original.body_mass[torso]
    np.testing.assert_array_equal(np.delete(model.body_mass, torso), np.delete(original.body_mass, torso))
    np.testing.assert_array_equal(model.dof_damping[3:] / original.dof_damping[3:], [1.0, 1.0, 0.5, 1.0, 1.0, 1.0])
    assert (model.geom_friction[:, 0] / original.geom_friction[:, 0]).tolist() == [0.5, *[1.0] * (model.ngeom - 1)]
    assert (model.actuator_gear[:, 0] / original.actuator_gear[:, 0]).tolist() == [2.0, 1.0, 1.0, 1.0, 1.0, 1.0]


def test_an_original_is_the_class_own_where_it_keeps_one_and_a_pickle_knows_it():
    env = CheetahDirEnv()
    original = env.original_model
    scale_physics(env, mass=2.0)
    assert env.original_model is original
    copy = pickle.loads(pickle.dumps(env))
    scale_physics(copy)
    assert_same_numbers(copy.model, original)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mass": 0.0}, r"mass=0.0 is out of range: give a factor above 0"),
        ({"inertia": -1.0}, r"inertia=-1.0 is out of range"),
        ({"damping": -0.1}, r"damping=-0.1 is out of range: give a factor of at least 0"),
        ({"friction": np.inf}, r"friction=inf is out of range"),
        ({"gear": np.nan}, r"gear=nan is out of range: give a factor that is finite"),
        ({"gravity": np.nan}, r"gravity=nan is out of range"),
        ({"gravity": [0.0, 0.0]}, r"gravity=\[0.0, 0.0\] is not a number"),
        ({"mass": "heavy"}, r"mass='heavy' is not a number: give one factor"),
        ({"mass": {"torso": 0.0}}, r"mass\['torso'\]=0.0 is out of range"),
        ({"mass": {"trunk": 2.0}}, r"mass names 'trunk', which is not in the model: choose of \['world', 'torso'"),
        ({"gear": {"rootx": 2.0}}, r"gear names 'rootx', which is not in the model: choose of \['thigh_joint'"),
        ({"gear": {3: 2.0}}, r"gear names 3, which is not in the model"),
    ],
)
def test_an_impossible_factor_is_refused_and_nothing_is_written(arguments, message):
    env = gym.make("Hopper-v5")
    with pytest.raises(ValueError, match=message):
        scale_physics(env, **{"mass": 2.0, **arguments})
    assert_same_numbers(env.unwrapped.model, gym.make("Hopper-v5").unwrapped.model)


def test_an_environment_without_a_model_is_refused():
    with pytest.raises(TypeError, match=r"has no MuJoCo model: give an environment whose `unwrapped.model`"):
        scale_physics(gym.make("Pendulum-v1"))

"""Tests of hopper and walker in hidden bodies: Gymnasium's at a task of zeros, an edited model else, ends, floors."""

import pickle
import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.mujoco.hopper_v5 import HopperEnv
from gymnasium.envs.mujoco.walker2d_v5 import Walker2dEnv

from sb3_bruno_envs import HOPPER_PARAMS_TASKS, WALKER_PARAMS_TASKS, HopperParamsEnv, WalkerParamsEnv
from support.robots import floor, rollout, torques

pytestmark = pytest.mark.mujoco

UNIT = {  # log factors of one unit of the published scale
    HopperParamsEnv: np.log([1.5] * 4 + [1.3] * 3 + [1.5]),
    WalkerParamsEnv: np.log([1.5] * 7 + [1.3] * 6 + [1.5] * 2),
}
ENTRIES = {HopperParamsEnv: 41, WalkerParamsEnv: 65}
ORIGINAL = {HopperParamsEnv: HopperEnv, WalkerParamsEnv: Walker2dEnv}
robots = pytest.mark.parametrize("robot", [HopperParamsEnv, WalkerParamsEnv])
ids = pytest.mark.parametrize("env_id", ["HopperParams-v0", "WalkerParams-v0"])


def make(env_id, **kwargs):
    return gym.make(f"sb3_bruno_envs:{env_id}", observe="plain", **kwargs)


def tasks_of(env_id, **kwargs):
    return make(env_id, **kwargs).get_wrapper_attr("task_distribution")


def numbers(model):
    arrays = {name: getattr(model, name) for name in dir(model)}
    arrays |= {f"stat.{name}": getattr(model.stat, name) for name in ("extent", "meaninertia", "meanmass", "meansize")}
    return {name: np.array(array) for name, array in arrays.items() if isinstance(array, np.ndarray | float)}


@robots
@pytest.mark.parametrize("published", [False, True])
@pytest.mark.parametrize("frame_skip", [4, 8])
def test_a_task_of_zeros_is_gymnasiums_robot_to_the_bit(robot, published, frame_skip):
    ours, theirs = robot(published=published, frame_skip=frame_skip), ORIGINAL[robot](frame_skip=frame_skip)
    dim = ENTRIES[robot] if published else len(UNIT[robot])
    ours.set_task(np.linspace(-1.0, 1.0, dim))
    ours.set_task(np.zeros(dim, np.float32))
    mine = numbers(ours.model)
    for name, expected in numbers(theirs.model).items():
        np.testing.assert_array_equal(mine[name], expected, err_msg=name)
    np.testing.assert_array_equal(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    np.testing.assert_array_equal(rollout(ours), rollout(theirs))


def edited_file(folder, robot, masses, dampings, frictions):
    """Gymnasium's model file with its numbers multiplied; a density is the mass's and the inertia's factor."""
    text = Path(robot().fullpath).read_text()
    geoms = iter(masses)
    text = re.sub(r'(<geom )(friction="0.9"|friction="2.0"|friction="1.9")', r"\1DENSITY \2", text)
    text = re.sub("DENSITY", lambda _: f'density="{1000.0 * next(geoms)!r}"', text)
    feet = iter(frictions)
    text = re.sub(r'friction="(2.0|1.9)"', lambda found: f'friction="{float(found[1]) * next(feet)!r}"', text)
    usual = 1.0 if robot is HopperParamsEnv else 0.1  # damping
    joints = iter(dampings)
    text = re.sub(
        r'(<joint )(axis="0 -1 0")', lambda found: f'{found[1]}damping="{usual * next(joints)!r}" {found[2]}', text
    )
    path = folder / "edited.xml"
    path.write_text(text)
    return str(path)


@robots
def test_the_physics_are_those_of_an_edited_model_file(tmp_path, robot):
    ours, dim = robot(), len(UNIT[robot])
    task = np.random.default_rng(0).uniform(-2.0, 2.0, dim) * UNIT[robot]
    n_masses, n_dampings = (4, 3) if robot is HopperParamsEnv else (7, 6)
    ours.set_task(task)
    parts = np.split(np.exp(task), [n_masses, n_masses + n_dampings])
    theirs = ORIGINAL[robot](xml_file=edited_file(tmp_path, robot, *(part.tolist() for part in parts)), frame_skip=8)
    mine = numbers(ours.model)
    for name, expected in numbers(theirs.model).items():
        np.testing.assert_allclose(mine[name], expected, rtol=1e-9, atol=1e-12, err_msg=name)
    np.testing.assert_array_equal(ours.reset(seed=3)[0], theirs.reset(seed=3)[0])
    np.testing.assert_allclose(rollout(ours, 20), rollout(theirs, 20), rtol=0.0, atol=1e-6)


@robots
def test_published_tasks_multiply_every_entry_and_recompute_nothing(robot):
    env = robot(published=True)
    model, original = env.model, env.original_model
    task = np.random.default_rng(0).uniform(-1.0, 1.0, ENTRIES[robot])
    env.set_task(task)
    written = [model.body_mass, model.body_inertia, model.dof_damping, model.geom_friction]
    before = [original.body_mass, original.body_inertia, original.dof_damping, original.geom_friction]
    start = 0
    for mine, theirs in zip(written, before, strict=True):
        factors = np.exp(task[start : start + theirs.size]).reshape(theirs.shape)
        np.testing.assert_allclose(mine, theirs * factors, rtol=1e-12)
        start += theirs.size
    assert start == len(task)
    for derived in ("dof_invweight0", "body_invweight0", "dof_M0"):
        np.testing.assert_array_equal(getattr(model, derived), getattr(original, derived))


@ids
def test_the_reward_and_the_end_follow_from_positions(env_id):
    env = make(env_id, draw="cycle")
    robot, hopper = env.unwrapped, env_id == "HopperParams-v0"
    for seed in range(3):
        env.reset(seed=seed)
        steps, terminated = iter(torques(env, 100)), False
        while not terminated:
            action, before = next(steps), robot.data.qpos[0]
            _, reward, terminated, _, _ = env.step(action)
            velocity = (robot.data.qpos[0] - before) / 0.016  # m/s
            (height, angle), rest = robot.data.qpos[1:3], np.hstack([robot.data.qpos[2:], robot.data.qvel])
            if hopper:
                healthy = height > 0.7 and abs(angle) < 0.2 and np.abs(rest).max() < 100.0
            else:
                healthy = 0.8 < height < 2.0 and abs(angle) < 1.0
            expected = velocity + healthy - 1e-3 * np.square(action, dtype=np.float64).sum()
            assert reward == pytest.approx(expected, abs=1e-6)
            assert terminated == (not healthy)


@robots
def test_an_episode_can_go_on_after_a_fall_and_the_wildest_body_is_stable(robot):
    env = robot(terminate_when_unhealthy=False)
    signs = np.random.default_rng(0).choice([-4.0, 4.0], (10, len(UNIT[robot])))
    for units in signs:
        env.set_task(units * UNIT[robot])
        env.reset(seed=0)
        assert not rollout(env)[:, env.observation_space.shape[0] + 1].any()
        assert np.abs(env.data.qvel).max() < 200.0
    assert not env.data.warning.number.any()


@ids
@pytest.mark.parametrize("published", [False, True])
def test_a_pickled_copy_continues_in_the_same_body_to_the_bit(env_id, published):
    env = make(env_id, published=published, terminate_when_unhealthy=False)
    env.reset(seed=1)
    rollout(env.unwrapped, 10)
    copy = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(rollout(copy.unwrapped, 15), rollout(env.unwrapped, 15))
    for _ in range(2):
        (mine, info), (others, others_info) = env.reset(), copy.reset()
        np.testing.assert_array_equal(mine, others)
        np.testing.assert_array_equal(info["task"], others_info["task"])
    np.testing.assert_array_equal(rollout(copy.unwrapped, 15), rollout(env.unwrapped, 15))


@robots
@pytest.mark.parametrize("published", [False, True])
def test_an_impossible_task_is_refused(robot, published):
    env = robot(published=published)
    dim = ENTRIES[robot] if published else len(UNIT[robot])
    for task in (np.zeros(dim - 1), np.full(dim, np.nan), np.zeros((1, dim)), 0.0):
        with pytest.raises(ValueError, match=rf"give log factors, 0 for the original, of shape \({dim},\), finite"):
            env.set_task(task)


@pytest.mark.parametrize(
    ("env_id", "zero", "steps", "random_return", "random_steps"),
    [("HopperParams-v0", 81.0, 78.0, 8.0, 11.0), ("WalkerParams-v0", 41.0, 51.0, -1.0, 10.0)],
)
def test_doing_nothing_and_random_torques_earn_what_they_are_known_to(env_id, zero, steps, random_return, random_steps):
    env = make(env_id, draw="cycle")
    assert floor(env, 12) == (pytest.approx(zero, rel=0.2), pytest.approx(steps, rel=0.2))
    expected = (pytest.approx(random_return, abs=3.0), pytest.approx(random_steps, rel=0.2))
    assert floor(env, 20, random=True) == expected


@pytest.mark.parametrize(("env_id", "zero", "steps"), [("HopperParams-v0", 146, 149), ("WalkerParams-v0", 94, 119)])
def test_gymnasiums_own_body_earns_by_doing_nothing_what_it_is_known_to(env_id, zero, steps):
    dim = tasks_of(env_id).space.shape[0]
    env = make(env_id, frame_skip=4, tasks=np.zeros((1, dim)))
    assert floor(env, 5) == (pytest.approx(zero, rel=0.2), pytest.approx(steps, rel=0.2))


@pytest.mark.parametrize(
    ("tasks", "unit", "torso_masses", "frictions"),
    [
        (HOPPER_PARAMS_TASKS, UNIT[HopperParamsEnv], [0.5605, 1.7619, 2.0453, 2.0559], [0.7123, 0.8510]),
        (WALKER_PARAMS_TASKS, UNIT[WalkerParamsEnv], [0.5605, 2.0227, 0.4650, 1.6859], [1.6974, 0.6110]),
    ],
)
def test_the_bodies_are_those_of_their_seed(tasks, unit, torso_masses, frictions):
    assert (tasks.tasks("train").shape, tasks.tasks("test").shape) == ((100, len(unit)), (30, len(unit)))
    np.testing.assert_allclose(np.exp(tasks.tasks("train")[[0, 1, 2, -1], 0]), torso_masses, atol=1e-4)
    np.testing.assert_allclose(np.exp(tasks.tasks("test")[[0, -1], -1]), frictions, atol=1e-4)
    np.testing.assert_allclose(tasks.train_box.high, 3.0 * unit, rtol=1e-6)
    np.testing.assert_allclose(tasks.space.high, 4.0 * unit, rtol=1e-6)
    assert tasks.inside_train_box(tasks.tasks("test")).all()


@ids
def test_other_sets_of_bodies(env_id):
    own = tasks_of(env_id)
    beyond, pearl, tavt = (tasks_of(env_id, tasks=name) for name in ("beyond", "pearl", "tavt"))
    np.testing.assert_array_equal(beyond.tasks("train"), own.tasks("train"))
    assert len(beyond.tasks("test")) == 20
    assert not beyond.inside_train_box(beyond.tasks("test")).any()
    np.testing.assert_array_equal(pearl.tasks("train"), own.tasks("train")[:40])
    np.testing.assert_array_equal(pearl.tasks("test"), own.tasks("train")[40:50])
    n_masses = 4 if env_id == "HopperParams-v0" else 7
    for split, units in (("train", [(0.0, 0.5), (3.0, 3.5)]), ("test", [(0.75, 0.75), (2.75, 2.75)])):
        masses, others = np.split(tavt.tasks(split), [n_masses], axis=1)
        assert not others.any()
        assert (np.ptp(masses, axis=1) == 0.0).all()
        (least, _), (_, most) = units
        assert least <= masses.min() / np.log(1.5) and masses.max() / np.log(1.5) <= most + 1e-6
    assert len(tavt.tasks("train")) == 100
    np.testing.assert_allclose(tavt.tasks("test")[:, 0] / np.log(1.5), [0.75, 1.25, 1.75, 2.25, 2.75], rtol=1e-6)


@pytest.mark.parametrize(
    ("env_id", "dim", "world", "last"),
    [
        ("HopperParams-v0", 41, [0.5605, 1.6001, 0.6968, 1.0764], [0.7055, 0.8305]),
        ("WalkerParams-v0", 65, [0.5605, 0.4709, 0.4669, 2.7907], [1.7291, 3.1787]),
    ],
)
def test_published_tasks_have_a_set_of_their_own(env_id, dim, world, last):
    tasks = tasks_of(env_id, published=True)
    assert (tasks.tasks("train").shape, tasks.tasks("test").shape) == ((40, dim), (10, dim))
    np.testing.assert_allclose(np.exp(tasks.tasks("train")[[0, 1, 2, -1], 0]), world, atol=1e-4)
    np.testing.assert_allclose(np.exp(tasks.tasks("test")[[0, -1], -1]), last, atol=1e-4)
    assert tasks.train_box.high.max() == pytest.approx(3.0 * np.log(1.5))
    with pytest.raises(ValueError, match="tasks='beyond' is no task set"):
        make(env_id, published=True, tasks="beyond")
    env = gym.make(make(env_id, published=True).spec)
    assert env.reset(seed=0)[1]["task"].shape == (dim,)


@ids
@pytest.mark.parametrize(
    "kwargs", [{}, *({"tasks": name} for name in ("beyond", "pearl", "tavt")), {"published": True}]
)
def test_every_body_has_a_name_of_its_own(env_id, kwargs):
    env = make(env_id, **kwargs)
    for split in ("train", "test"):
        names = list(map(env.get_wrapper_attr("name_of"), tasks_of(env_id, **kwargs).tasks(split)))
        assert len(set(names)) == len(names) and max(map(len, names)) < 60


@robots
def test_one_factor_of_all_masses_is_called_that_and_none_the_original(robot):
    parts = robot.parts
    task = np.zeros(len(UNIT[robot]))
    assert robot.name_task(task) == "original body"
    task[: len(parts.bodies)] = np.log(1.25)
    assert robot.name_task(np.float32(task)) == "every mass x1.25"
    task[-1] = np.log(0.5)
    assert robot.name_task(np.float32(task)) == f"{parts.feet[-1]} friction x0.5, every mass x1.25"


@robots
def test_a_published_body_is_named_by_the_same_numbers(robot):
    env, rng = robot(published=True), np.random.default_rng(0)
    task = rng.normal(size=ENTRIES[robot]) * 0.01
    env.set_task(task)
    dampings, frictions = 4 * env.model.nbody, 4 * env.model.nbody + env.model.nv  # where they begin
    feet = [env.model.geom(name).id for name in robot.feet]
    for places, kind, parts in (
        (range(1, env.model.nbody), "mass", robot.parts.bodies),
        (range(dampings + 3, frictions), "damping", robot.parts.joints),
        ([frictions + 3 * foot for foot in feet], "friction", robot.parts.feet),
    ):
        for place, name in zip(places, parts, strict=True):
            changed = task.copy()
            changed[place] = np.log(2.0)
            assert robot.name_task(changed).startswith(f"{name} {kind} x2, ")


def test_what_is_no_body_has_no_name():
    with pytest.raises(ValueError, match=r"task=.* is invalid: give 8 log factors, or 41 as published"):
        HopperParamsEnv.name_task([0.0, 1.0])

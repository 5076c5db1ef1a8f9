"""Tests of the adapter of Meta-World, where that is installed."""

import pickle
import re
import warnings
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from sb3_bruno_envs import check_meta_env

metaworld = pytest.importorskip("metaworld")
adapter = pytest.importorskip("sb3_bruno_envs.metaworld")
made = pytest.importorskip("sb3_bruno_envs.metaworld_tasks")
pytestmark = pytest.mark.mujoco

ML1 = "sb3_bruno_envs.metaworld:ML1Reach-v0"


@pytest.fixture(scope="module")
def ml1():
    return metaworld.ML1("reach-v3", seed=1)


@pytest.fixture(scope="module")
def small_ml10():
    """A benchmark of ML10's form, which is made faster."""
    return metaworld.CustomML(["reach-v3", "drawer-close-v3"], ["door-close-v3"], seed=1)


def rand_vecs(tasks):
    return np.float32([pickle.loads(task.data)["rand_vec"] for task in tasks])


def episode(env, n_steps=30):
    actions = np.random.default_rng(0).uniform(-1, 1, (n_steps, 4)).astype(np.float32)
    return [env.step(action) for action in actions]


def test_ml1_has_the_tasks_of_meta_world(ml1):
    env = gym.make(ML1)
    np.testing.assert_array_equal(env.get_wrapper_attr("task_distribution").tasks("train"), rand_vecs(ml1.train_tasks))
    np.testing.assert_array_equal(env.get_wrapper_attr("task_distribution").tasks("test"), rand_vecs(ml1.test_tasks))
    other = gym.make(ML1, seed=2).get_wrapper_attr("task_distribution")
    assert not np.array_equal(other.tasks("train"), rand_vecs(ml1.train_tasks))


def test_an_episode_equals_meta_worlds_own(ml1):
    theirs = ml1.train_classes["reach-v3"]()
    theirs.set_task(ml1.test_tasks[3])
    first, _ = theirs.reset()
    ours = gym.make(ML1, split="test", observe="plain")
    observation, info = ours.reset(seed=0, options={"task": rand_vecs(ml1.test_tasks)[3]})
    assert info["task_index"] == 3
    np.testing.assert_array_equal(observation, first)
    for mine, plain in zip(episode(ours), episode(theirs), strict=True):
        np.testing.assert_array_equal(mine[0], plain[0])
        assert mine[1:4] == plain[1:4]


def test_the_goal_is_hidden_and_the_object_shown():
    env = gym.make(ML1)
    with pytest.raises(ValueError, match="a leak") as error, warnings.catch_warnings(action="ignore"):
        check_meta_env(env)
    _, *found = str(error.value).splitlines()
    leaks = [f"- the first observation contains task[{i}]" for i in (0, 1)]
    assert [line.partition(", ")[0] for line in found] == leaks
    observation, _ = env.reset(seed=0)
    assert observation["observation"].shape == (39,) and not observation["observation"][-3:].any()
    assert gym.make(ML1, observe="task").observation_space.shape == (39 + 6,)


def test_a_success_counts_until_the_episode_ends(ml1):
    env = gym.make(ML1)
    _, info = env.reset(seed=0)
    successes, is_success = [], []
    for step in range(500):
        hand = env.unwrapped._env.get_endeff_pos()
        way = 10 * (info["task"][3:] - hand) if step < 200 else -np.ones(3)
        *_, truncated, info = env.step(np.append(np.clip(way, -1, 1), 0).astype(np.float32))
        successes.append(bool(info["success"]))
        is_success.append(info["is_success"])
    assert truncated
    assert any(successes) and not successes[-1]
    assert is_success == np.maximum.accumulate(successes).tolist()
    env.reset()
    assert not env.step(env.action_space.sample())[4]["is_success"]


def test_a_trial_is_of_several_episodes():
    env = gym.make(ML1, n_episodes=2)
    env.reset(seed=0)
    ends = [env.step(np.zeros(4, np.float32))[3:] for _ in range(1000)]
    assert [truncated for truncated, _ in ends] == [False] * 999 + [True]
    assert "trial_final_observation" in ends[499][1]


def test_a_copy_begins_the_episode_anew():
    env = gym.make(ML1)
    env.reset(seed=0)
    first = env.step(np.ones(4, np.float32))[0]["observation"]
    copy = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(copy.step(np.ones(4, np.float32))[0]["observation"], first)


def test_a_task_of_ml10_is_its_class_and_where_things_are(small_ml10):
    benchmark = made.describe(small_ml10)
    train, test = benchmark.tasks.tasks("train"), benchmark.tasks.tasks("test")
    assert train.shape == (100, 2 + 6) and test.shape == (50, 2 + 6)
    np.testing.assert_array_equal(train[:, :2], np.repeat(np.eye(2), 50, axis=0))
    np.testing.assert_array_equal(train[:50, 2:], rand_vecs(small_ml10.train_tasks[:50]))
    np.testing.assert_array_equal(train[50:, 2:5], rand_vecs(small_ml10.train_tasks[50:]))
    assert not train[50:, 5:].any() and not test[:, :2].any() and not test[:, 5:].any()


def test_ml10_changes_the_class_with_the_task(small_ml10, monkeypatch):
    monkeypatch.setattr(made, "_load", lambda name, seed: made.describe(small_ml10))
    for split in ("train", "test"):
        env = gym.make("sb3_bruno_envs.metaworld:ML10-v0", split=split, observe="plain")
        tasks, originals = env.get_wrapper_attr("task_distribution").tasks(split), getattr(small_ml10, f"{split}_tasks")
        for i in (49, len(tasks) - 1, 0):
            theirs = {**small_ml10.train_classes, **small_ml10.test_classes}[originals[i].env_name]()
            theirs.set_task(originals[i])
            theirs.reset()
            env.reset(seed=0, options={"task": tasks[i]})
            for mine, plain in zip(episode(env, 5), episode(theirs, 5), strict=True):
                np.testing.assert_array_equal(mine[0], plain[0])
                assert mine[1] == plain[1]
        env.close()


def test_ml10_is_loaded_as_meta_world_makes_it(monkeypatch):
    seeds = []
    monkeypatch.setattr(metaworld, "ML10", lambda seed: seeds.append(seed) or SimpleNamespace())
    monkeypatch.setattr(made, "describe", lambda benchmark: benchmark)
    made.load_benchmark("ML10", 12345)
    assert seeds == [12345]


def test_a_task_of_ml1_is_called_by_its_places(ml1):
    env = gym.make(ML1)
    for split in ("train", "test"):
        names = list(map(env.get_wrapper_attr("name_of"), env.get_wrapper_attr("task_distribution").tasks(split)))
        assert len(set(names)) == 50 and re.fullmatch(r"reach \(\S+, \S+, \S+\) to \(\S+, \S+, \S+\)", names[0])
    name_of = made.TaskNames("reach-v3", 1)
    assert name_of(np.float32([0, 0.6, 0.02, 0.1, 0.8, 0.25])) == "reach (0, 0.6, 0.02) to (0.1, 0.8, 0.25)"
    entries = [
        ("object x", "m"),
        ("object y", "m"),
        ("object z", "m"),
        ("goal x", "m"),
        ("goal y", "m"),
        ("goal z", "m"),
    ]
    assert list(env.get_wrapper_attr("task_entries")) == entries
    assert gym.make(env.spec).get_wrapper_attr("name_of")(env.reset(seed=0)[1]["task"]).startswith("reach ")


def test_a_task_of_ml10_is_called_by_its_class_and_place(small_ml10, monkeypatch):
    monkeypatch.setattr(made, "_load", lambda name, seed: made.describe(small_ml10))
    env = pickle.loads(pickle.dumps(gym.make("sb3_bruno_envs.metaworld:ML10-v0")))
    tasks, name_of = env.get_wrapper_attr("task_distribution").tasks, env.get_wrapper_attr("name_of")
    for split, skills in (("train", ["reach", "drawer-close"]), ("test", ["door-close"])):
        names = list(map(name_of, tasks(split)))
        assert [name.split()[0] for name in names[::50]] == skills and len(set(names)) == len(names)
    x, y, z = np.round(tasks("test")[0, 2:5], 5)
    assert name_of(tasks("test")[0]) == f"door-close ({x:g}, {y:g}, {z:g})"
    assert env.get_wrapper_attr("task_entries")[:3] == (("reach", ""), ("drawer-close", ""), ("object x", "m"))
    with pytest.raises(ValueError, match="none of the benchmark's"):
        env.reset(options={"task": env.get_wrapper_attr("task_space").low})


@pytest.mark.parametrize("make", [adapter.make_meta_world, adapter.MetaWorldEnv])
@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("render_mode", "rgb_arry"),
        ("render_mode", 5),
        ("seed", "a"),
        ("seed", "1"),
        ("seed", 1.5),
        ("seed", -1),
        ("seed", 2**32),
        ("seed", True),
        ("seed", None),
        ("name", ["reach-v3"]),
    ],
)
def test_a_wrong_argument_is_named_with_its_value(make, argument, value):
    with pytest.raises(ValueError, match=re.escape(f"{argument}={value!r} ") + ".*: (use|give) "):
        make(**{"name": "reach-v3", argument: value})


def test_without_a_render_mode_nothing_is_drawn():
    env = adapter.MetaWorldEnv("reach-v3")
    env.reset(seed=0)
    assert env.render() is None


def test_a_task_of_ones_own_is_refused():
    env = gym.make(ML1)
    task = env.get_wrapper_attr("task_space").low
    with pytest.raises(ValueError, match=r"the task .* is none of the benchmark's: choose from its TaskSet"):
        env.reset(options={"task": task})


def test_an_unknown_class_is_refused():
    with pytest.raises(ValueError, match=r"name='reach' is no benchmark: give 'ML10', or for ML1 one of .*'reach-v3'"):
        adapter.make_meta_world("reach")

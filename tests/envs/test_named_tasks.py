"""Every family names its tasks as people do, and the name goes with the task through every wrapper."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import registry

from sb3_bruno_envs import MetaTask, PointDirEnv
from sb3_bruno_envs.naming import direction_name, place_name

IDS = sorted(spec.id for spec in registry.values() if str(spec.entry_point).startswith("sb3_bruno_envs."))
EXAMPLES = {
    "PointDir-v0": ([-1, 0], "left"),
    "PointGoal-v0": ([0.5, -1, 0.25], "goal (0.5, -1, 0.25)"),
    "PointRotation-v0": ([0, -1], "-90 degrees"),
    "SparsePointGoal-v0": ([0, 1], "goal at 90 degrees"),
    "CartpoleSwingUp-v0": ([0.1, 0.5], "cart 0.1 kg, pole 0.5 m"),
    "Wind-v0": ([0.01, -0.08], "wind (0.01, -0.08)"),
    "AntDir-v0": ([-1, 0], "backward"),
    "AntDir2D-v0": ([0.6, 0.8], "53.13 degrees"),
    "AntGoal-v0": ([0.5, -3], "goal (0.5, -3) m"),
    "HumanoidDir-v0": ([0, 1], "left"),
    "CheetahGravity-v0": ([9.81], "9.81 m/s^2"),
    "CheetahDir-v0": ([0, 1], "forward"),
    "CheetahVel-v0": ([1.9], "1.9 m/s"),
    "HopperParams-v0": (np.log([1, 2, 1, 1, 0.4, 1, 0.5, 1]), "thigh damping x0.4, thigh mass x2"),
    "WalkerParams-v0": (np.log([*[1] * 6, 3, *[1] * 6, 0.5, 0.9]), "left foot mass x3, foot friction x0.5"),
    "CheetahParams-v0": ([1, 0.5, 2, -1], "mass 1, damping 0.5, friction 2, strength -1"),
}


def test_every_family_is_here():
    assert EXAMPLES.keys() == set(IDS)


@pytest.mark.parametrize("env_id", EXAMPLES)
def test_a_family_names_all_its_tasks_apart(env_id):
    env = gym.make(env_id, observe="plain")
    tasks, name_task = env.get_wrapper_attr("task_distribution").tasks("train"), env.unwrapped.name_task
    assert len(set(map(name_task, tasks))) == len(tasks)
    _, info = env.reset(seed=0)
    assert info["task_name"] == name_task(info["task"]) == env.step(env.action_space.sample())[-1]["task_name"]
    task, name = EXAMPLES[env_id]
    assert name_task(np.float32(task)) == name


@pytest.mark.parametrize("env_id", IDS)
def test_a_family_says_what_the_numbers_of_a_task_are(env_id):
    env = gym.make(env_id)
    entries, space = env.get_wrapper_attr("task_entries"), env.get_wrapper_attr("task_space")
    assert len(entries) == space.shape[0] and len({name for name, _ in entries}) == len(entries)


def test_entries_are_those_of_the_tasks_at_hand():
    assert gym.make("PointGoal-v0", dim=2).get_wrapper_attr("task_entries") == (("goal x", ""), ("goal y", ""))
    assert gym.make("HopperParams-v0", published=True).get_wrapper_attr("task_entries") is None
    assert gym.make("CheetahVel-v0").get_wrapper_attr("task_entries") == (("velocity", "m/s"),)


@pytest.mark.parametrize(
    "entries", [["velocity"], [("velocity", "m/s")], [("x", 1), ("y", 2)], [("x", "m"), ("y",)], "xy", [("x", "m")] * 3]
)
def test_what_are_no_entries_is_refused(entries):
    with pytest.raises(ValueError, match="task_entries="):
        MetaTask(PointDirEnv(), PointDirEnv.set_task, [[1.0, 0.0]], task_entries=entries)


def test_directions_and_places():
    assert [direction_name(vector) for vector in ([1, 0], [1, 1e-9], [1, -1e-9], [-1, 0], [1, 1])] == [
        "0 degrees",
        "0 degrees",
        "0 degrees",
        "180 degrees",
        "45 degrees",
    ]
    assert place_name(np.float32([0.1, -0.0])) == "(0.1, 0)"


@pytest.mark.parametrize("name_task", ["forward", lambda task: 3, lambda task: ""])
def test_what_is_no_name_is_refused(name_task):
    with pytest.raises(ValueError, match=r"name_task.*(pass name_task|return a text)"):
        MetaTask(PointDirEnv(), PointDirEnv.set_task, [[1.0, 0.0]], name_task=name_task).reset(seed=0)


def test_tasks_without_names_say_nothing():
    assert "task_name" not in MetaTask(PointDirEnv(), PointDirEnv.set_task, [[1.0, 0.0]]).reset(seed=0)[1]

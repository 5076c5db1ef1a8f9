"""Tests of MetaTask: when a task is drawn, applied, named and kept, and that it stays a secret."""

import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from gymnasium.wrappers import TimeLimit

from sb3_bruno_envs import CHEETAH_VEL_TASKS, CheetahVelEnv, MetaTask, PointDirEnv, TaskSampler, TaskSet

DIRECTIONS = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]]
PLANE = Box(-1.0, 1.0, (2,))


def point(tasks=DIRECTIONS, **kwargs):
    return MetaTask(PointDirEnv(), PointDirEnv.set_task, tasks, **kwargs)


def drawn(env, n, **kwargs):
    """The tasks of n resets."""
    return [env.reset(**kwargs)[1]["task"].tolist() for _ in range(n)]


def sample_direction(rng):
    angle = rng.uniform(0.0, 2 * np.pi)
    return np.cos(angle), np.sin(angle)


class Recorder(gym.Env):
    """Keeps the order of calls and the options it receives."""

    observation_space = Box(0.0, 1.0, (1,))
    action_space = Box(-1.0, 1.0, (1,))

    def __init__(self):
        self.calls = []

    def set_task(self, task):
        self.calls.append(("task", task.tolist()))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.calls.append(("reset", options))
        return np.zeros(1, np.float32), {"own": True}

    def step(self, action):
        return np.zeros(1, np.float32), 0.0, False, False, {"own": True}


def test_the_task_is_applied_before_the_environment_resets():
    env = MetaTask(Recorder(), Recorder.set_task, [[0.5]])
    env.reset(seed=0)
    assert env.unwrapped.calls == [("task", [0.5]), ("reset", None)]


def test_other_options_go_on_to_the_environment_and_its_info_is_kept():
    env = MetaTask(Recorder(), Recorder.set_task, [[0.5], [0.7]])
    options = {"task": [0.7], "speed": 3}
    _, info = env.reset(options=options)
    assert env.unwrapped.calls == [("task", [np.float32(0.7)]), ("reset", {"speed": 3})]
    assert options == {"task": [0.7], "speed": 3}
    assert info["own"]
    assert env.step(np.zeros(1))[4]["own"]


def test_every_info_names_the_task_and_its_row():
    env = TimeLimit(point(), 3)
    _, info = env.reset(options={"task": [0.0, 1.0]})
    infos = [info] + [env.step(np.zeros(2))[4] for _ in range(3)]  # the last one is that of the end
    for info in infos:
        assert info["task"].tolist() == [0.0, 1.0]
        assert info["task"].dtype == np.float32
        assert info["task_index"] == 1
    infos[0]["task"][:] = 9.0
    assert env.get_wrapper_attr("task").tolist() == [0.0, 1.0]


def test_the_row_is_counted_in_the_split_and_is_minus_one_for_a_stranger():
    env = point(TaskSet([[1.0, 0.0]], DIRECTIONS), split="test", task_space=PLANE)
    assert env.reset(options={"task": [-1.0, 0.0]})[1]["task_index"] == 2
    assert env.reset(options={"task": [0.6, 0.8]})[1]["task_index"] == -1
    assert point(TaskSampler(sample_direction, PLANE)).reset()[1]["task_index"] == -1


def test_random_draws_reach_every_task_and_follow_the_seed():
    env = point()
    env.reset(seed=1)
    first = drawn(env, 40)
    env.reset(seed=1)
    assert drawn(env, 40) == first
    assert sorted(map(tuple, DIRECTIONS)) == sorted(set(map(tuple, first)))


def test_a_given_task_leaves_the_following_draws_alone():
    env, other = point(), point()
    env.reset(seed=1)
    other.reset(seed=1)
    env.reset(options={"task": [1.0, 0.0]})
    assert drawn(env, 10) == drawn(other, 10)


def test_a_cycle_goes_in_order_and_starts_anew_with_a_seed():
    env = point(draw="cycle")
    assert drawn(env, 4) == [*DIRECTIONS, DIRECTIONS[0]]
    assert drawn(env, 2, seed=3) == [DIRECTIONS[0]] * 2


def test_a_fixed_task_is_kept_until_another_is_given():
    env = point(TaskSampler(sample_direction, PLANE), draw="fixed")
    first, *others = drawn(env, 5)
    assert others == [first] * 4
    assert drawn(env, 1, options={"task": [0.0, 1.0]}) == [[0.0, 1.0]]
    assert drawn(env, 3) == [[0.0, 1.0]] * 3
    assert len({tuple(drawn(env, 1, seed=seed)[0]) for seed in range(5)}) == 5


def test_task_and_first_observation_are_uncorrelated_over_a_thousand_seeds():
    env = MetaTask(CheetahVelEnv(), CheetahVelEnv.set_task, CHEETAH_VEL_TASKS)
    starts = [env.reset(seed=seed) for seed in range(1000)]
    tasks = np.array([info["task"][0] for _, info in starts])
    observations = np.stack([observation for observation, _ in starts])  # (1000, 17)
    correlations = np.corrcoef(tasks, observations.T)[0, 1:]
    assert np.abs(correlations).max() < 4 / np.sqrt(1000)  # four standard deviations
    assert len(np.unique(tasks)) == 100


def test_the_task_is_not_the_first_number_of_the_environments_generator():
    """A task drawn as the environment draws would be the first observation, were both seeded alike."""
    drawn_alike = TaskSampler(lambda rng: 0.1 * rng.standard_normal(2), PLANE)
    env = MetaTask(PointDirEnv(), lambda *_: None, drawn_alike)
    starts = [env.reset(seed=seed) for seed in range(200)]
    tasks = np.stack([info["task"] for _, info in starts])
    firsts = np.stack([observation for observation, _ in starts])
    assert np.abs(tasks - firsts).min() > 0.0
    assert abs(np.corrcoef(tasks[:, 0], firsts[:, 0])[0, 1]) < 4 / np.sqrt(200)


def test_a_pickled_copy_draws_the_same_tasks_in_the_same_episode():
    env = point()
    env.reset(seed=5)
    env.step(np.ones(2))
    copy = pickle.loads(pickle.dumps(env))
    assert copy.task.tolist() == env.task.tolist()
    assert copy.step(np.ones(2))[1] == env.step(np.ones(2))[1]
    assert drawn(copy, 20) == drawn(env, 20)


def test_without_tasks_there_is_one_constant_task():
    env = MetaTask(gym.make("Pendulum-v1"))
    _, info = env.reset(seed=0)
    assert (info["task"].tolist(), info["task_index"]) == ([0.0], 0)
    assert env.task_space == Box(0.0, 0.0, (1,))


def test_without_tasks_it_is_rebuilt_from_its_spec():
    env = gym.make(MetaTask(gym.make("Pendulum-v1")).spec)
    assert env.reset(seed=0)[1]["task"].tolist() == [0.0]


def test_the_task_space_is_found_through_wrappers():
    env = TimeLimit(point(task_space=PLANE), 3)
    assert env.get_wrapper_attr("task_space") == PLANE
    assert point().task_space == Box(np.float32([-1, 0]), np.float32([1, 1]))


def test_there_is_no_task_before_the_first_reset():
    with pytest.raises(ResetNeeded, match="call reset"):
        _ = point().task


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"split": "valid"}, "split='valid' is unknown"),
        ({"draw": "sorted"}, "draw='sorted' is unknown: use 'random', 'cycle' or 'fixed'"),
        ({"tasks": sample_direction}, "give task_space"),
        (
            {"tasks": sample_direction, "task_space": PLANE, "draw": "cycle"},
            "draw='cycle' needs finite tasks",
        ),
        ({"tasks": [[2.0, 0.0]], "task_space": PLANE}, r"outside .*widen task_space"),
        ({"task_space": gym.spaces.Discrete(2)}, "give a Box"),
    ],
)
def test_wrong_arguments_are_refused_with_a_remedy(kwargs, message):
    with pytest.raises(ValueError, match=message):
        point(**kwargs)


def test_tasks_without_a_function_to_apply_them_are_refused():
    with pytest.raises(ValueError, match="apply_task=None cannot set the given tasks"):
        MetaTask(PointDirEnv(), tasks=DIRECTIONS)


@pytest.mark.parametrize("task", [[2.0, 0.0], [1.0], [np.nan, 0.0], "north"])
def test_a_wrong_task_in_the_options_is_refused_and_changes_nothing(task):
    env = point()
    before = env.reset(seed=0)[1]["task"].tolist()
    with pytest.raises(ValueError, match=r"options\['task'\]"):
        env.reset(seed=1, options={"task": task})
    assert env.task.tolist() == before


def test_a_task_can_switch_in_mid_episode():
    env = point(draw="fixed")
    with pytest.raises(ResetNeeded, match="call reset"):
        env.switch_task([0.0, 1.0])
    env.reset(seed=0, options={"task": [1.0, 0.0]})
    env.switch_task([0.0, 1.0])
    info = env.step(np.zeros(2, np.float32))[4]
    assert info["task"].tolist() == env.unwrapped.direction.tolist() == [0.0, 1.0]
    with pytest.raises(ValueError, match="task has shape"):
        env.switch_task([1.0])
    assert env.task.tolist() == [0.0, 1.0]
    assert env.reset()[1]["task"].tolist() == [0.0, 1.0]  # draw="fixed" keeps it


@pytest.mark.parametrize("number", [16777217, 123456789, np.int64(2**24 + 1), 16777217.0])
def test_a_whole_number_that_float32_would_change_is_refused_and_the_task_stays(number):
    env = MetaTask(Recorder(), Recorder.set_task, [[5.0]], task_space=Box(0.0, 1e9, (1,)))
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"options\['task'\] is \[.*\], a whole number that float32, .*: give an"):
        env.reset(options={"task": [number]})
    with pytest.raises(ValueError, match=r"task is \[.*\], a whole number that float32, .* or the number in two parts"):
        env.switch_task([number])
    assert env.task.tolist() == [5.0]
    assert env.switch_task([16777218])["task"].tolist() == [16777218.0]

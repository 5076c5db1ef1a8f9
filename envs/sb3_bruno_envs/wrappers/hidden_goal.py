"""Hides the goal of a goal environment and makes it the task; knows no particular environment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, SupportsFloat, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box, Dict, flatdim, flatten, unflatten
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import ArrayLike

from sb3_bruno_envs.arguments import check_count, check_env, check_function
from sb3_bruno_envs.naming import place_name
from sb3_bruno_envs.tasks import Split, Task, TaskDistribution, TaskSet, as_task_distribution
from sb3_bruno_envs.wrappers.meta_task import Draw, MetaTask

SetGoal: TypeAlias = Callable[[Any, Any], object]

_FIRST_TEST_SEED = 1_000_000
_ENTRIES = (("goal x", ""), ("goal y", ""), ("goal z", ""))
_MOST_NUMBERS = 8  # of a goal that is named by them; a name of more would fill a line


def hide_goal(
    env: gym.Env[Any, Any],
    tasks: TaskDistribution | ArrayLike | None = None,
    *,
    set_goal: SetGoal | None = None,
    split: Split = "train",
    draw: Draw = "random",
    name_task: Callable[[Task], str] | None = None,
    task_entries: Sequence[tuple[str, str]] | None = None,
) -> MetaTask:
    """Hide the goal of an environment with a goal, and make it the task.

    Such an environment observes a Dict with ``desired_goal``, as gymnasium-robotics' do. All other entries stay in the
    observation. The environment computes reward, success and end as ever, from the task's goal. An ``info["success"]``,
    which gymnasium-robotics' mazes write, becomes ``info["is_success"]``, the name that logs and tables read.

    Args:
        env: the environment, with its time limit. For several episodes of one goal, a ``Trial`` of it.
        tasks: goals, flat, ``(n, goal_dim)``, or a TaskSet or TaskSampler of them; None for ``goal_tasks(env)``, which
            takes 120 resets.
        set_goal: called as ``set_goal(env.unwrapped, goal)`` after every reset, with a goal in the form of
            ``desired_goal``; None writes it into the attribute ``goal``.
        split: ``"train"`` or ``"test"``.
        draw: ``"random"``, ``"cycle"`` or ``"fixed"``, as in MetaTask.
        name_task: what people call a goal, as in MetaTask; None for such as ``"goal (0.5, 1)"``, if a goal is a vector
            of at most eight numbers.
        task_entries: name and unit of each number of a goal, as in MetaTask; None for ``goal x``, ``goal y`` and
            ``goal z``, if a goal is a vector of at most three numbers.

    Raises:
        ValueError: if the environment shows no goal or has too few different ones, ``tasks`` are not of a goal's size,
            or MetaTask refuses an argument. A reset raises one if there is neither ``set_goal`` nor an attribute
            ``goal``.

    Example:
        >>> env = TransitionObservation(hide_goal(gym.make("FetchReachDense-v4"), split="test"))
    """
    hidden = HiddenGoal(env, set_goal)
    distribution = as_task_distribution(goal_tasks(env) if tasks is None else tasks)
    space = _goal_space(env)
    _check_size(distribution, space)
    if isinstance(space, Box) and len(space.shape) == 1:
        (dim,) = space.shape
        name_task = _name_goal if name_task is None and dim <= _MOST_NUMBERS else name_task
        task_entries = _ENTRIES[:dim] if task_entries is None and dim <= len(_ENTRIES) else task_entries
    return MetaTask(
        hidden,
        HiddenGoal.set_task,
        distribution,
        split=split,
        draw=draw,
        when="after_reset",
        unwrap=False,
        name_task=name_task,
        task_entries=task_entries,
    )


def goal_tasks(env: gym.Env[Any, Any], n_train: int = 100, n_test: int = 20) -> TaskSet:
    """Draw tasks as an environment draws its goals.

    The training goals are those of resets with the seeds 0, 1, 2, ..., the test goals those of 1,000,000 and on. No
    goal comes twice.

    Args:
        env: an environment that observes a Dict with ``desired_goal``.
        n_train: the number of training goals.
        n_test: the number of test goals.

    Raises:
        ValueError: if the environment shows no goal or has fewer different ones, or a number is no positive integer.
    """
    check_count("n_train", n_train)
    check_count("n_test", n_test)
    space = _goal_space(env)
    goals: dict[bytes, Task] = {}  # in the order of their seeds
    for n, first_seed in ((n_train, 0), (n_test, _FIRST_TEST_SEED)):
        wanted = len(goals) + n
        for seed in range(first_seed, first_seed + 10 * n):
            if len(goals) == wanted:
                break
            flat: Any = flatten(space, env.reset(seed=seed)[0]["desired_goal"])
            goal = np.asarray(flat, dtype=np.float32) + np.float32(0.0)  # -0.0 is 0.0
            goals.setdefault(goal.tobytes(), goal)
        if len(goals) < wanted:
            raise ValueError(
                f"n_train={n_train} and n_test={n_test} are too many: {10 * n} resets of {env} gave {len(goals)} "
                "different goals. Ask for fewer, or give tasks of your own."
            )
    env.reset(seed=int(np.random.SeedSequence().generate_state(1)[0]))  # else unseeded episodes would be the same ones
    tasks = list(goals.values())
    return TaskSet(np.stack(tasks[:n_train]), np.stack(tasks[n_train:]))


class HiddenGoal(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Leaves ``desired_goal`` out of the observation, and writes a given goal into the environment.

    A goal counts until the next reset. A step raises a ValueError if the environment has another goal by then. It says
    ``info["is_success"]`` where the environment says ``info["success"]`` alone.

    Args:
        env: an environment that observes a Dict with ``desired_goal``.
        set_goal: as in ``hide_goal``.

    Raises:
        ValueError: if the environment shows no goal.
    """

    def __init__(self, env: gym.Env[Any, Any], set_goal: SetGoal | None = None) -> None:
        check_env(env)
        check_function("set_goal", set_goal, "set_goal(env.unwrapped, goal)")
        RecordConstructorArgs.__init__(self, set_goal=set_goal)
        super().__init__(env)
        self._goal_space = _goal_space(env)
        self._set_goal = _set_attribute if set_goal is None else set_goal
        self._task: Task | None = None  # since the last reset
        shown: Any = env.observation_space
        self.observation_space = Dict({key: part for key, part in shown.items() if key != "desired_goal"})

    def set_task(self, task: Task) -> None:
        """Write a goal, flat, ``(goal_dim,)``, into the environment.

        Raises:
            ValueError: if there is neither ``set_goal`` nor an attribute ``goal``.
        """
        self._task = task
        self._set_goal(self.env.unwrapped, unflatten(self._goal_space, task))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, which draws a goal of its own."""
        self._task = None
        observation, info = self.env.reset(seed=seed, options=options)
        return _without_goal(observation), info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment.

        Raises:
            ValueError: if its goal is not the one that was set.
        """
        observation, reward, terminated, truncated, info = self.env.step(action)
        if "trial_final_observation" in info:  # Trial has reset the environment
            info = {**info, "trial_final_observation": _without_goal(info["trial_final_observation"])}
        else:
            self._check_goal(flatten(self._goal_space, observation["desired_goal"]))
        if "success" in info:
            info = {"is_success": info["success"], **info}  # what the environment itself calls is_success stays
        return _without_goal(observation), reward, terminated, truncated, info

    def _check_goal(self, goal: Any) -> None:
        """Raise a ValueError if a flat goal is not the task."""
        if self._task is not None and not np.allclose(goal, self._task, rtol=1e-5, atol=1e-6):
            raise ValueError(
                f"the goal is {goal}, the task {self._task}: let set_goal set the goal that {self.env} observes, and "
                "let the environment keep it for an episode (gymnasium-robotics' mazes by reset_target=False)."
            )


def _goal_space(env: gym.Env[Any, Any]) -> gym.Space[Any]:
    """Return the space of the goals.

    Raises:
        ValueError: if the environment observes none, or one that is no vector.
    """
    check_env(env)
    space = env.observation_space
    if not isinstance(space, Dict) or "desired_goal" not in space.spaces or len(space.spaces) < 2:
        raise ValueError(
            f"observation_space={space} has no goal to hide: give an environment that observes a Dict with "
            "desired_goal and more, or set the task by MetaTask."
        )
    goals = space["desired_goal"]
    if not goals.is_np_flattenable:
        raise ValueError(f"observation_space['desired_goal']={goals} has no fixed size: set the task by MetaTask.")
    return goals


def _check_size(tasks: TaskDistribution, goals: gym.Space[Any]) -> None:
    """Raise a ValueError if tasks have another number of numbers than flat goals."""
    (dim,), goal_dim = tasks.space.shape, flatdim(goals)
    if dim != goal_dim:
        raise ValueError(
            f"tasks={tasks} hold {dim} numbers each, and observation_space['desired_goal']={goals} holds {goal_dim}: "
            f"give goals, flat, (n, {goal_dim})."
        )


def _name_goal(goal: Task) -> str:
    return f"goal {place_name(goal)}"


def _without_goal(observation: dict[str, Any]) -> dict[str, Any]:
    return {key: part for key, part in observation.items() if key != "desired_goal"}


def _set_attribute(env: Any, goal: Any) -> None:
    """Write the goal where gymnasium-robotics' environments keep it; its mazes also show it, where they are told to.

    Raises:
        ValueError: if it is not there.
    """
    if not hasattr(env, "goal"):  # once reset
        raise ValueError(f"{env} has no attribute goal: pass set_goal(env.unwrapped, goal), which sets its goal.")
    env.goal = goal
    if hasattr(env, "update_target_site_pos"):
        env.update_target_site_pos()

"""Makes the environments of one Gymnasium id from an environment class and its tasks; knows no particular class."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeAlias, get_args

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike

from sb3_bruno_envs.arguments import check_count, check_function
from sb3_bruno_envs.naming import check_entries
from sb3_bruno_envs.tasks import Split, Task, TaskDistribution, TaskSet, as_task_distribution, as_task_space
from sb3_bruno_envs.wrappers.meta_task import Draw, MetaTask
from sb3_bruno_envs.wrappers.observations import TaskObservation, TransitionObservation
from sb3_bruno_envs.wrappers.trial import Trial

Observe: TypeAlias = Literal["transition", "task", "plain"]


class Family:
    """Makes an environment in MetaTask and an observation wrapper whenever ``gym.make`` calls it.

    A family is the entry point of its id: ``gym.make`` calls it with all keyword arguments, and reads the render modes
    from ``metadata``. Several families may share a class.

    Args:
        env_class: a Gymnasium environment with a method ``set_task(task)``, which is called before every reset. It may
            have a static or class method ``name_task(task)``, which says what people call a task, and ``task_entries``,
            which say what its numbers are (see MetaTask): the first of them if tasks are shorter, none if they are
            longer. It may have a method ``read_task(task)``, which raises a ValueError at what is no task of the
            environment: then a list of tasks is refused as a whole, when an environment is made with it.
        tasks: the family's own tasks: a TaskSet, a TaskSampler or an array-like ``(n, dim)``.
        task_sets: other sets of tasks by name, for ``gym.make(id, tasks=name)``. A set named ``"beyond"`` has the
            family's own training tasks, and test tasks outside their range. A published set is named after its paper.
        max_episode_steps: the length of an episode; None if the environment ends each of its episodes itself.
        n_episodes: the number of inner episodes, if an episode is a trial (see Trial). The environment ends the inner
            episodes itself, and ``max_episode_steps`` limits the whole trial.
        name_task: what people call a task, ``name_task(task)``; None for what the class says.
        task_entries: what a task's numbers are, the first of them if tasks are shorter; None for what the class says.

    Raises:
        ValueError: if the class has no ``set_task``, the tasks or what names them are invalid, or a number is not
            positive.

    Example:
        >>> POINT_DIR = Family(PointDirEnv, POINT_DIR_TASKS, max_episode_steps=30)
        >>> register_family("PointDir-v0", "sb3_bruno_envs.classic.point_dir:POINT_DIR")
        >>> env = gym.make("PointDir-v0", split="test", draw="cycle")
    """

    def __init__(
        self,
        env_class: type[gym.Env[Any, Any]],
        tasks: TaskDistribution | ArrayLike,
        *,
        task_sets: Mapping[str, TaskSet] | None = None,
        max_episode_steps: int | None = None,
        n_episodes: int | None = None,
        name_task: Callable[[Task], str] | None = None,
        task_entries: Sequence[tuple[str, str]] | None = None,
    ) -> None:
        set_task: Callable[[Any, Task], object] | None = getattr(env_class, "set_task", None)
        if set_task is None:
            raise ValueError(f"env_class={env_class!r} has no method set_task(task): add one that applies a task.")
        task_sets = {} if task_sets is None else task_sets
        if not isinstance(task_sets, Mapping) or not all(isinstance(named, TaskSet) for named in task_sets.values()):
            raise ValueError(f"task_sets={task_sets!r} is no dict of TaskSets: give each by its name.")
        for name, count in (("max_episode_steps", max_episode_steps), ("n_episodes", n_episodes)):
            if count is not None:
                check_count(name, count)
        self.env_class = env_class
        self.tasks = as_task_distribution(tasks)
        self.task_sets = dict(task_sets)
        self.max_episode_steps = max_episode_steps
        self.n_episodes = n_episodes
        self._set_task = set_task
        check_function("name_task", name_task, "name_task(task), which returns a text")
        self._name_task = getattr(env_class, "name_task", None) if name_task is None else name_task
        entries = getattr(env_class, "task_entries", None) if task_entries is None else task_entries
        self._task_entries = () if entries is None else entries
        check_entries(self._task_entries)

    @property
    def metadata(self) -> dict[str, Any]:
        """Return the render modes of the environment class."""
        return self.env_class.metadata

    def __call__(
        self,
        *,
        split: Split = "train",
        tasks: Any = None,
        draw: Draw = "random",
        observe: Observe = "transition",
        task_space: Box | None = None,
        **env_kwargs: Any,
    ) -> gym.Env[Any, Any]:
        """Make one environment.

        Args:
            split: ``"train"`` or ``"test"``.
            tasks: None for the family's own tasks, the name of one of its ``task_sets``, or other tasks in any form
                that MetaTask takes.
            draw: ``"random"``, ``"cycle"`` or ``"fixed"``, as in MetaTask.
            observe: ``"transition"`` (a Dict, see TransitionObservation), ``"task"`` (what an oracle sees, see
                TaskObservation) or ``"plain"`` (the bare observation; the task is in ``info`` all the same).
            task_space: the Box that holds every task; None for that of the named set, or else the family's own,
                whatever ``tasks`` are.
            **env_kwargs: arguments of the environment class, ``render_mode`` among them, and ``n_episodes`` where an
                episode is a trial.

        Raises:
            ValueError: if ``observe`` or the name of a task set is unknown, MetaTask refuses an argument, or the
                environment class refuses one of the listed tasks.
        """
        if observe not in get_args(Observe):
            raise ValueError(f"observe={observe!r} is unknown: use 'transition', 'task' or 'plain'.")
        own, task_sets = self.tasks_for(env_kwargs)
        if isinstance(tasks, str):
            own = tasks = self.named(tasks, task_sets)
        space = own.space if task_space is None else as_task_space(task_space)
        bare = self._make_bare(**env_kwargs)
        meta = MetaTask(
            bare,
            self._set_task,
            own if tasks is None else tasks,
            split=split,
            draw=draw,
            name_task=self._name_task,
            task_entries=self._entries_of(space),
            task_space=space,
        )
        if tasks is not None:
            _check_listed(bare, meta.task_distribution)
        if observe == "transition":
            return TransitionObservation(meta)
        return TaskObservation(meta) if observe == "task" else meta

    def tasks_for(self, env_kwargs: Mapping[str, Any]) -> tuple[TaskDistribution, Mapping[str, TaskSet]]:
        """Return the family's own tasks and its named sets, for these arguments of the environment class.

        They are always the same here. Override this where the dimension of a task depends on an argument.
        """
        return self.tasks, self.task_sets

    def named(self, name: str, task_sets: Mapping[str, TaskSet]) -> TaskSet:
        """Return the task set of that name, out of those that ``tasks_for`` found.

        Raises:
            ValueError: if there is none.
        """
        if name not in task_sets:
            known = f"one of {sorted(task_sets)}" if task_sets else "an array (n, dim), for it has no named set"
            owner = self.env_class.__name__
            raise ValueError(f"tasks={name!r} is no task set of {owner}: give {known}, or leave it out.")
        return task_sets[name]

    def _entries_of(self, space: Box) -> Sequence[tuple[str, str]] | None:
        entries = self._task_entries[: space.shape[0]]
        return entries if len(entries) == space.shape[0] else None

    def _make_bare(self, **env_kwargs: Any) -> gym.Env[Any, Any]:
        """Make the environment, or a trial of its episodes."""
        if self.n_episodes is None:
            return self.env_class(**env_kwargs)
        n_episodes = env_kwargs.pop("n_episodes", self.n_episodes)
        # No TimeLimit inside: the spec would name it, and gym.make would put it around the whole trial.
        return Trial(self.env_class(**env_kwargs), n_episodes)

    def __repr__(self) -> str:
        return f"Family({self.env_class.__name__}, {self.tasks})"


def _check_listed(bare: gym.Env[Any, Any], tasks: TaskDistribution) -> None:
    """Let the environment read every task of both splits, if it reads tasks and there is a list of them."""
    read_task = getattr(bare.unwrapped, "read_task", None)
    if read_task is not None and isinstance(tasks, TaskSet):
        for task in np.concatenate([tasks.tasks("train"), tasks.tasks("test")]):
            read_task(task)

"""Gives an environment a hidden task in every episode; knows no observation format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, SupportsFloat, TypeAlias, get_args

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import ArrayLike

from sb3_bruno_envs.arguments import check_env, check_function
from sb3_bruno_envs.naming import check_entries
from sb3_bruno_envs.task_effect import find_task_without_effect
from sb3_bruno_envs.task_lists import list_examples, list_few
from sb3_bruno_envs.tasks import Split, Task, TaskDistribution, TaskSet, as_task_distribution, check_split, check_task

Draw: TypeAlias = Literal["random", "cycle", "fixed"]
When: TypeAlias = Literal["before_reset", "after_reset"]

_TASK_STREAM = 1909  # spawn key of the task generator; an environment's own children have 0, 1, 2, ...


class MetaTask(gym.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """Gives a task at every reset: a drawn one, or the one in ``reset(options={"task": task})``.

    ``apply_task`` writes the task into the environment, by default into ``env.unwrapped`` and before it resets. The
    task is privileged: the observation never shows it, but every reset and step names it in ``info["task"]``
    (float32, ``(dim,)``) and ``info["task_index"]`` (its row in the split's finite set, or -1), and in
    ``info["task_name"]`` if tasks have names.

    Tasks come from a generator of their own, spawned from the reset seed. It shares no number with the
    environment's generator, so the first observation says nothing about the task.

    Args:
        env: the environment.
        apply_task: called as ``apply_task(env.unwrapped, task)``; needed as soon as ``tasks`` is given. It writes all
            that the task means, and never a change relative to the last task.
        tasks: a TaskSet, a TaskSampler, an array-like ``(n, dim)``, a callable that draws a task from a
            generator, or None: the one constant task ``[0]``.
        split: ``"train"`` or ``"test"``.
        draw: ``"random"``; ``"cycle"``, in order from the first; or ``"fixed"``, which keeps the first task that is
            drawn, or the last that options gave. A reset with a seed starts each of these anew.
        task_space: the Box that holds every task, also those given by options; None is that of ``tasks``.
        when: ``"before_reset"``, or ``"after_reset"`` for an environment whose reset would overwrite the task, as one
            that draws its goal there. The reset's observation then was made before the task was applied. If it shows
            what the task changes, ``apply_task`` returns the new first observation, else None.
        unwrap: False calls ``apply_task(env, task)`` with the wrappers inside this one, if one of them keeps what the
            task changes: ``env.set_wrapper_attr(name, value)`` reaches it.
        name_task: what people call a task, ``name_task(task)``, such as ``"1.9 m/s"``; it goes to
            ``info["task_name"]``, and from there to logs, tables and figures. Give different tasks different names.
            None: tasks have no names.
        task_entries: name and unit of each number of a task, such as ``[("velocity", "m/s")]``, with which an agent
            says what it takes the task for.

    Raises:
        ValueError: if an argument is invalid, endless tasks should cycle, a task is outside ``task_space``, or there is
            a MetaTask inside.

    Example:
        >>> def set_gravity(pendulum, task):
        ...     pendulum.g = float(task[0])
        >>> env = MetaTask(gym.make("Pendulum-v1"), set_gravity, tasks=[[8.0], [10.0], [12.0]])
    """

    # As an attribute, which an algorithm finds through the wrappers without importing environments.
    find_task_without_effect = staticmethod(find_task_without_effect)

    def __init__(
        self,
        env: gym.Env[Any, Any],
        apply_task: Callable[[Any, Task], object] | None = None,
        tasks: Any = None,
        *,
        split: Split = "train",
        draw: Draw = "random",
        task_space: Box | None = None,
        when: When = "before_reset",
        unwrap: bool = True,
        name_task: Callable[[Task], str] | None = None,
        task_entries: Sequence[tuple[str, str]] | None = None,
    ) -> None:
        check_env(env)
        check_split(split)
        if draw not in get_args(Draw):
            raise ValueError(f"draw={draw!r} is unknown: use 'random', 'cycle' or 'fixed'.")
        if when not in get_args(When):
            raise ValueError(f"when={when!r} is unknown: use 'before_reset' or 'after_reset'.")
        if apply_task is None and tasks is not None:
            raise ValueError("apply_task=None cannot set the given tasks: pass apply_task(env.unwrapped, task).")
        check_function("apply_task", apply_task, "apply_task(env.unwrapped, task)")
        check_function("name_task", name_task, "name_task(task), which returns a text")
        if not isinstance(unwrap, bool):
            raise ValueError(f"unwrap={unwrap!r} is neither True nor False: give one of them.")
        layer: Any = env
        while isinstance(layer, gym.Wrapper):
            if isinstance(layer, MetaTask):
                raise ValueError(
                    f"env={env} has a MetaTask, which would overwrite the task: wrap what is inside of it."
                )
            layer = layer.env
        distribution = as_task_distribution(tasks, task_space)
        if draw == "cycle" and not isinstance(distribution, TaskSet):
            raise ValueError("draw='cycle' needs finite tasks: use draw='random', or give an array (n, dim).")
        recorded = None if tasks is None else distribution
        RecordConstructorArgs.__init__(
            self,
            apply_task=apply_task,
            tasks=recorded,
            split=split,
            draw=draw,
            task_space=task_space,
            when=when,
            unwrap=unwrap,
            name_task=name_task,
            task_entries=task_entries,
        )
        super().__init__(env)
        self._apply_task = apply_task
        self._distribution = distribution
        self._split: Split = split
        self._draw: Draw = draw
        self._when: When = when
        self._unwrap = unwrap
        self._name_task = name_task
        self.task_entries = None if task_entries is None else _read_entries(task_entries, distribution.space)
        self._task_name: str | None = None  # of the current episode
        self._task: Task | None = None  # of the current episode
        self._task_index = -1
        self._kept: Task | None = None  # the task that draw="fixed" gives again
        self._restart_drawing(seed=None)

    @property
    def task_space(self) -> Box:
        """Return the Box that holds every task, float32, ``(dim,)``."""
        return self._distribution.space

    @property
    def task_distribution(self) -> TaskDistribution:
        """Return the distribution that the tasks of both splits come from."""
        return self._distribution

    @property
    def family_id(self) -> str | None:
        """Return the id that the environment was made by; None if it has none. It is no spec: those hold functions."""
        spec = self.unwrapped.spec
        return None if spec is None else spec.id

    def list_tasks(self, most: int) -> list[list[float]] | None:
        """List the training tasks if these are at most so many, and those of the test among them; else None."""
        return list_few(self._distribution, most)

    def example_tasks(self, most: int) -> list[list[float]]:
        """List the first tasks of the split, or so many that are drawn, by a generator of their own."""
        return list_examples(self._distribution, self._split, most)

    @property
    def task(self) -> Task:
        """Return the task of the current episode, ``(dim,)``.

        Raises:
            ResetNeeded: before the first reset.
        """
        if self._task is None:
            raise ResetNeeded("The first task comes with the first reset: call reset before reading the task.")
        return self._task.copy()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Choose the task, apply it and reset the environment; options other than ``"task"`` go on to it.

        Raises:
            ValueError: if the task in ``options`` is outside ``task_space``, or ``apply_task`` returned after the reset
                what is no observation.
        """
        options = dict(options or {})
        given = options.pop("task", None)
        if given is not None:
            given = check_task(given, self.task_space, "options['task']")
        if seed is not None:
            self._restart_drawing(seed)
        self._task = self._next_task() if given is None else given
        if self._when == "before_reset":
            self._apply()
        observation, info = self.env.reset(seed=seed, options=options or None)
        if self._when == "after_reset":
            observation = self._apply_late(observation)
        self._accept(self._task)
        return observation, self._with_task(info)

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Step the environment; the info of an episode's last step still names that episode's task."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        if self._when == "after_reset" and "trial_final_observation" in info:  # Trial has reset the environment
            observation = self._apply_late(observation)
        return observation, reward, terminated, truncated, self._with_task(info)

    def switch_task(self, task: ArrayLike) -> dict[str, Any]:
        """Switch to another task in mid-episode: the next step is the first one of it.

        Nothing is reset. What a task says of an episode's beginning counts from the next reset on. It is for tests and
        films: a replay buffer takes an episode for one task's.

        Args:
            task: ``(dim,)``, in ``task_space``.

        Returns:
            What ``info`` says of the task from here on.

        Raises:
            ResetNeeded: before the first reset.
            ValueError: if the task is outside ``task_space``, or the environment refuses it; the task then stays.
        """
        before, self._task = self.task, check_task(task, self.task_space, "task")
        try:
            self._apply()
            self._accept(self._task)
        except Exception:
            self._task = before
            self._apply()
            raise
        return self._with_task({})

    def _accept(self, task: Task) -> None:
        """Name a task that the environment has taken, find its row, and keep it if it is to come again."""
        self._task_name, self._task_index = self.name_of(task), self._index_of(task)
        if self._draw == "fixed":
            self._kept = task

    def _apply(self) -> Any:
        """Apply the task; return what ``apply_task`` returned."""
        if self._apply_task is None:
            return None
        return self._apply_task(self.env.unwrapped if self._unwrap else self.env, self.task)

    def _apply_late(self, observation: Any) -> Any:
        """Apply the task after a reset; return the first observation, that of ``apply_task`` if it gives one."""
        new = self._apply()
        if new is None:
            return observation
        if not isinstance(new, type(observation)) or np.shape(new) != np.shape(observation):
            raise ValueError(
                f"apply_task returned {new!r}, no observation of {self.env}: return the first observation that shows "
                "the task's effect, or None if the reset's is still right."
            )
        return new

    def _restart_drawing(self, seed: int | None) -> None:
        self._rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_TASK_STREAM,)))
        self._cursor = 0  # the row that a cycle gives next
        self._kept = None

    def _next_task(self) -> Task:
        if self._kept is not None:
            return self._kept
        if self._draw == "cycle" and isinstance(self._distribution, TaskSet):
            tasks = self._distribution.tasks(self._split)
            task: Task = tasks[self._cursor].copy()
            self._cursor = (self._cursor + 1) % len(tasks)
            return task
        return self._distribution.draw(self._rng, self._split)

    def _index_of(self, task: Task) -> int:
        """Return the first row of the split's finite set that equals ``task``, or -1."""
        return self._distribution.index(task, self._split) if isinstance(self._distribution, TaskSet) else -1

    def name_of(self, task: Task) -> str | None:
        """Return what people call a task, ``(dim,)``; None if tasks have no names.

        Raises:
            ValueError: if ``name_task`` returns no text.
        """
        if self._name_task is None:
            return None
        name = self._name_task(task.copy())
        if not isinstance(name, str) or not name:
            raise ValueError(f"name_task({task}) returned {name!r}: return a text, such as 'forward'.")
        return name

    def _with_task(self, info: dict[str, Any]) -> dict[str, Any]:
        named = {} if self._task_name is None else {"task_name": self._task_name}
        return {**info, "task": self.task, "task_index": self._task_index, **named}


def _read_entries(entries: Sequence[tuple[str, str]], space: Box) -> tuple[tuple[str, str], ...]:
    """Return name and unit of each number of a task; a ValueError refuses what is none, or not one for each."""
    check_entries(entries)
    if space.shape != (len(entries),):
        raise ValueError(
            f"task_entries={entries!r} names {len(entries)} numbers, and tasks have shape {space.shape}: name each."
        )
    return tuple((name, unit) for name, unit in entries)

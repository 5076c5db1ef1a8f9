"""Asks an environment about its tasks, whoever registered it and however it is wrapped."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from difflib import get_close_matches
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator
from numpy.typing import NDArray

Wrap = Callable[[gym.Env[Any, Any]], gym.Env[Any, Any]]


class EnvFacts(NamedTuple):
    """What an environment says of its tasks.

    Attributes:
        names_task: whether it has a hidden task.
        records_task: whether it has one without the config's wrappers. RL Zoo's Monitor is below these.
        test_tasks: the list of its test tasks, ``(n_tasks, task_dim)``; none if it has no such list.
        can_cycle: whether it goes through a list of tasks itself, if it is made so.
    """

    names_task: bool
    records_task: bool
    test_tasks: NDArray[np.float32]
    can_cycle: bool


def ask(env_id: str, env_kwargs: dict[str, Any], wrap: Wrap | None) -> EnvFacts:
    """Make an environment, and ask it about its tasks. The arguments are those of ``make_env``."""
    env = make_env(env_id, env_kwargs)
    try:
        records_task = env.has_wrapper_attr("task_space")
        env = env if wrap is None else wrap(env)
        can_cycle = takes(env_id, "split", "tasks", "draw")
        return EnvFacts(env.has_wrapper_attr("task_space"), records_task, tasks_of(env, "test"), can_cycle)
    finally:
        env.close()


def make_env(env_id: str, env_kwargs: dict[str, Any], wrap: Wrap | None = None) -> gym.Env[Any, Any]:
    """Make an environment.

    Args:
        env_id: its id.
        env_kwargs: what it is made with.
        wrap: puts wrappers around it; None for none.

    Raises:
        ValueError: if it does not take an argument, with the nearest that it takes.
    """
    try:
        env = gym.make(env_id, **env_kwargs)
    except TypeError as error:
        unknown = re.search(r"unexpected keyword argument '(\w+)'", str(error))
        if unknown is None or unknown[1] not in env_kwargs:
            raise
        nearest = get_close_matches(unknown[1], _keywords(env_id), n=1)
        remedy = f"did you mean {nearest[0]}?" if nearest else "leave it out"
        given = f"--env-kwargs {unknown[1]}:{env_kwargs[unknown[1]]!r}"
        raise ValueError(f"{given}: {env_id} has no argument {unknown[1]}: {remedy}") from error
    return env if wrap is None else wrap(env)


def takes(env_id: str, *names: str) -> bool:
    """Say whether an environment's maker names all these keywords, as every ``Family`` names split, tasks and draw."""
    return set(names) <= _signature(_creator(env_id)).keys()


def distribution_of(env: gym.Env[Any, Any]) -> Any:
    """Return an environment's ``task_distribution``, through its wrappers; None if it draws tasks in its own way."""
    return env.get_wrapper_attr("task_distribution") if env.has_wrapper_attr("task_distribution") else None


def tasks_of(env: gym.Env[Any, Any], split: str) -> NDArray[np.float32]:
    """List the tasks of a split, ``(n_tasks, task_dim)``; none if the environment has no list of them.

    Args:
        env: the environment, which may have a ``task_distribution``, through its wrappers.
        split: "train" or "test".
    """
    list_tasks = getattr(distribution_of(env), "tasks", None)  # a distribution of endless tasks has no list
    if not callable(list_tasks):
        return np.zeros((0, 0), dtype=np.float32)
    return np.asarray(list_tasks(split), dtype=np.float32)


class TasksInTurn(gym.Wrapper[Any, Any, Any, Any]):
    """Gives the tasks of a list one after the other, each at a reset. A reset with a seed begins anew.

    Args:
        env: an environment that takes its task at reset, as MetaTask does.
        tasks: the list, ``(n_tasks, task_dim)``.
    """

    def __init__(self, env: gym.Env[Any, Any], tasks: NDArray[np.float32]) -> None:
        super().__init__(env)
        self._tasks = tasks
        self._place = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset to the next task."""
        self._place = 0 if seed is not None else self._place
        task = self._tasks[self._place]
        self._place = (self._place + 1) % len(self._tasks)
        return self.env.reset(seed=seed, options={"task": task, **(options or {})})


def in_turn(env: gym.Env[Any, Any], wrap: Wrap | None, tasks: NDArray[np.float32]) -> gym.Env[Any, Any]:
    """Put wrappers around an environment, and let it go through a list of tasks."""
    return TasksInTurn(env if wrap is None else wrap(env), tasks)


def _keywords(env_id: str) -> list[str]:
    """Name the keywords of an environment: those of its maker, and where this passes on, those of the class."""
    creator = _creator(env_id)
    return [*_signature(creator), *_signature(getattr(creator, "env_class", None)), "max_episode_steps", "render_mode"]


def _signature(creator: Callable[..., Any] | None) -> dict[str, Any]:
    return {} if creator is None else dict(inspect.signature(creator).parameters)


def _creator(env_id: str) -> Callable[..., Any] | None:
    entry_point: Any = gym.spec(env_id).entry_point
    creator: Callable[..., Any] | None = load_env_creator(entry_point) if isinstance(entry_point, str) else entry_point
    return creator

"""Holds training tasks out of a search, to judge its trials on without a look at the test tasks."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from sb3_bruno.zoo.environments import make_env, takes, tasks_of

FEWEST = 10  # training tasks, of which some are held out
FRESH = 10_000  # is added to the seed of the environments that a trial is judged on


class HeldOut(NamedTuple):
    """How a search divides the training tasks of an environment.

    Attributes:
        train: ``env_kwargs`` of the environments that a trial learns in.
        judge: ``env_kwargs`` of those that it is judged on.
        n_tasks: how many tasks these go through in turn; 1 if they do not.
    """

    train: dict[str, Any]
    judge: dict[str, Any]
    n_tasks: int


def listed_tasks(env_id: str, env_kwargs: dict[str, Any], split: str) -> NDArray[np.float32]:
    """List the tasks of a split, ``(n_tasks, task_dim)``; none if the environment cannot be made with a part of them.

    One that can takes ``split``, ``tasks`` and ``draw``, as every ``Family`` of ``sb3_bruno_envs`` does, whoever
    registered it.

    Args:
        env_id: id of the environment.
        env_kwargs: what it is made with.
        split: "train" or "test".
    """
    if not takes(env_id, "split", "tasks", "draw"):
        return np.zeros((0, 0), dtype=np.float32)
    env = make_env(env_id, env_kwargs)
    try:
        return tasks_of(env, split)
    finally:
        env.close()


def hold_out(env_id: str, env_kwargs: dict[str, Any]) -> HeldOut:
    """Hold out the last fifth of ten or more training tasks. Fewer tasks serve for both, with fresh seeds.

    This needs the keywords of a family of environments, see ``listed_tasks``. Other environments stay as they are.

    Args:
        env_id: id of the environment.
        env_kwargs: what it is made with.
    """
    train = listed_tasks(env_id, env_kwargs, "train")
    if len(train) == 0:
        return HeldOut(env_kwargs, env_kwargs, 1)
    if len(train) < FEWEST:
        return HeldOut(env_kwargs, {**env_kwargs, "draw": "cycle"}, len(train))
    if isinstance(env_kwargs.get("tasks"), str) and takes(env_id, "task_space"):
        # The parts of a named set lie in its Box, which may be wider than the family's own.
        env_kwargs = {**env_kwargs, "task_space": _task_space(env_id, env_kwargs)}
    kept = len(train) // 5
    judge = {**env_kwargs, "tasks": train[-kept:], "draw": "cycle"}
    return HeldOut({**env_kwargs, "tasks": train[:-kept]}, judge, kept)


def _task_space(env_id: str, env_kwargs: dict[str, Any]) -> Box:
    """Return the Box that holds every task of an environment."""
    env = make_env(env_id, env_kwargs)
    try:
        space: Box = env.get_wrapper_attr("task_space")
        return space
    finally:
        env.close()

"""Holds training tasks out of a search, to judge its trials on without a look at the test tasks."""

from __future__ import annotations

import inspect
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator
from numpy.typing import NDArray

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
    """List the tasks of a split, ``(n_tasks, task_dim)``; none if the environment cannot go through a list of them.

    One that can takes ``split``, ``tasks`` and ``draw``, as every ``Family`` of ``sb3_bruno_envs`` does, whoever
    registered it.

    Args:
        env_id: id of the environment.
        env_kwargs: what it is made with.
        split: "train" or "test".
    """
    none = np.zeros((0, 0), dtype=np.float32)
    entry_point = gym.spec(env_id).entry_point
    creator = load_env_creator(entry_point) if isinstance(entry_point, str) else entry_point
    if creator is None or not {"split", "tasks", "draw"} <= inspect.signature(creator).parameters.keys():
        return none
    env = gym.make(env_id, **env_kwargs)
    distribution = env.get_wrapper_attr("task_distribution") if env.has_wrapper_attr("task_distribution") else None
    env.close()
    list_tasks = getattr(distribution, "tasks", None)  # a distribution of endless tasks has no list
    tasks: NDArray[np.float32] = none if list_tasks is None else list_tasks(split)
    return tasks


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
    kept = len(train) // 5
    judge = {**env_kwargs, "tasks": train[-kept:], "draw": "cycle"}
    return HeldOut({**env_kwargs, "tasks": train[:-kept]}, judge, kept)

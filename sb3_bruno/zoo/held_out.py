"""Training tasks that a search does not train on, so that it is judged without a look at the test tasks."""

from __future__ import annotations

from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

FEWEST = 10  # tasks that are worth parting
FRESH = 10_000  # added to the seed of the environments that a trial is judged on


class HeldOut(NamedTuple):
    """How a search parts the training tasks of an environment.

    :ivar train: ``env_kwargs`` of the environments that a trial learns in
    :ivar judge: ``env_kwargs`` of those that it is judged on
    :ivar n_tasks: how many tasks these go through in turn; 1 where they do not
    """

    train: dict[str, Any]
    judge: dict[str, Any]
    n_tasks: int


def hold_out(env_id: str, env_kwargs: dict[str, Any]) -> HeldOut:
    """Keep the last fifth of ten or more training tasks for judging; fewer serve both, with fresh seeds.

    That is for our environments, which take ``tasks`` and ``draw``; others learn and are judged as they are.
    """
    if not str(gym.spec(env_id).entry_point).startswith("sb3_bruno_envs"):
        return HeldOut(env_kwargs, env_kwargs, 1)
    env = gym.make(env_id, **env_kwargs)
    tasks = env.get_wrapper_attr("task_distribution") if env.has_wrapper_attr("task_distribution") else None
    env.close()
    list_tasks = getattr(tasks, "tasks", None)  # endless tasks have no list
    train = np.zeros((0, 0)) if list_tasks is None else list_tasks("train")
    if len(train) == 0:
        return HeldOut(env_kwargs, env_kwargs, 1)
    if len(train) < FEWEST:
        return HeldOut(env_kwargs, {**env_kwargs, "draw": "cycle"}, len(train))
    kept = len(train) // 5
    judge = {**env_kwargs, "tasks": train[-kept:], "draw": "cycle"}
    return HeldOut({**env_kwargs, "tasks": train[:-kept]}, judge, kept)

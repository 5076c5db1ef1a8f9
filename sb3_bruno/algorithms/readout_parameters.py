"""Refuses parameters of a read-out of the task that tell other tasks than an agent's own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from sb3_bruno.encoders.task_readout import ListReadout, TaskReadout

_PREFIX = "readout."


def check_readout(readout: TaskReadout | None, given: Any, *, exact_match: bool) -> list[int] | None:
    """Refuse the parameters of a policy whose read-out is not of the tasks of an agent's.

    Args:
        readout: the agent's, None if it has none.
        given: the parameters of a policy by name. What is no dict is left to SB3.
        exact_match: whether all of them are needed.

    Returns:
        Where each of the few tasks of ``given`` is among the agent's, if the order is another; else None.

    Example: of the tasks left and right and the agent's right and left, ``[1, 0]``.

    Raises:
        ValueError: if only one of the two has a read-out, or they tell other tasks.
    """
    if not isinstance(given, Mapping):
        return None
    has_readout = any(str(name).startswith(_PREFIX) for name in given)
    if has_readout != (readout is not None):
        if not exact_match:
            return None
        lack, remedy = ("the agent has", "True") if has_readout else ("they have", "False")
        raise ValueError(
            f"The parameters are those of another agent, for {lack} no read-out of the task: make the agent with "
            f"`task_readout={remedy}`, or give `exact_match=False`, which leaves read-outs as they are."
        )
    told = _tasks(given.get(f"{_PREFIX}tasks"))
    own = _tasks(readout.tasks) if isinstance(readout, ListReadout) else None
    if not has_readout or told == own:
        return None
    if told is None or own is None or sorted(told) != sorted(own):
        raise ValueError(
            f"The parameters have a read-out of {_said(told)}, and the agent's is of {_said(own)}: make the agent in "
            "an environment of the same tasks."
        )
    return [own.index(task) for task in told]


def _tasks(tasks: Any) -> list[list[float]] | None:
    return tasks.tolist() if isinstance(tasks, Tensor) else None


def _said(tasks: list[list[float]] | None) -> str:
    return "many tasks" if tasks is None else f"the tasks {tasks}"

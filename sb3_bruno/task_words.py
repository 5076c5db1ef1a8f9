"""Says what an agent takes the task for, in the task's own units and in words. Knows NumPy alone.

An exported agent says it too, where neither torch nor Stable-Baselines3 is installed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MOST_SAID = 3
"""How many of the most probable tasks are said."""
LEAST_SAID = 0.01
"""A task that is less probable is not said."""


class TaskLabels(NamedTuple):
    """What people call a task and its numbers.

    Attributes:
        names: of the entries of a task vector, such as ``("velocity",)``; empty if the env gives none.
        units: their units, such as ``("m/s",)``; ``""`` for none.
        tasks: of the few tasks that there are, such as ``("backward", "forward")``; empty where they are not few.
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()


class TaskEstimate(NamedTuple):
    """What an agent takes the task for, batch shape (...).

    Attributes:
        mean: in the task's own units, (..., task_dim).
        std: standard deviation of each entry, likewise.
        tasks: all tasks that there are, where these are few, (n_tasks, task_dim); else None.
        probabilities: of each of these, (..., n_tasks); else None.
        labels: what they are called.
    """

    mean: NDArray[np.float32]
    std: NDArray[np.float32]
    tasks: NDArray[np.float32] | None
    probabilities: NDArray[np.float32] | None
    labels: TaskLabels

    def __str__(self) -> str:
        return "\n".join(self.texts())

    def texts(self) -> list[str]:
        """Say it, one line for each of the batch: ``"forward 0.99"``, ``"velocity 1.9 ± 0.1 m/s"``."""
        if self.probabilities is not None:
            return [self._say_probable(row) for row in self.probabilities.reshape(-1, self.probabilities.shape[-1])]
        means, stds = (numbers.reshape(-1, numbers.shape[-1]) for numbers in (self.mean, self.std))
        return [self._say_numbers(mean, std) for mean, std in zip(means, stds, strict=True)]

    def _say_probable(self, probabilities: NDArray[np.float32]) -> str:
        likeliest = np.argsort(-probabilities, kind="stable")[:MOST_SAID]
        said = [i for i in likeliest if probabilities[i] >= LEAST_SAID]
        return ", ".join(f"{self.labels.tasks[i]} {probabilities[i]:.2f}" for i in said)

    def _say_numbers(self, mean: NDArray[np.float32], std: NDArray[np.float32]) -> str:
        names = self.labels.names or tuple(f"task[{i}]" for i in range(len(mean)))
        units = self.labels.units or ("",) * len(mean)
        numbers = [_with_spread(value, spread) for value, spread in zip(mean.tolist(), std.tolist(), strict=True)]
        entries = zip(names, numbers, units, strict=True)
        return ", ".join(f"{name} {number} {unit}".rstrip() for name, number, unit in entries)


def _with_spread(value: float, spread: float) -> str:
    """Write a number as precisely as it is known: ``_with_spread(1.9123, 0.132)`` gives ``"1.91 ± 0.13"``.

    A number whose spread says nothing of its digits, as 0 or inf, has three of them.
    """
    if not 0 < spread < np.inf:
        return f"{value:.3g} ± {spread:g}"
    decimals = max(0, 1 - int(np.floor(np.log10(spread))))
    return f"{value:.{decimals}f} ± {spread:.{decimals}f}"

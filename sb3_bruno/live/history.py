"""Keeps the last steps as arrays to draw."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from sb3_bruno.live.session import Moment

Lines = tuple[NDArray[np.float64], ...]
"""Arrays of one length, one for each line of a chart."""


class History:
    """The last steps, of one agent.

    Args:
        length: how many are kept.
    """

    def __init__(self, length: int = 200) -> None:
        self._moments: deque[Moment] = deque(maxlen=length)
        self._n_seen = 0

    def add(self, moment: Moment) -> None:
        """Keep one more step."""
        self._moments.append(moment)
        self._n_seen += 1

    def __len__(self) -> int:
        """Return how many steps are kept."""
        return len(self._moments)

    @property
    def last(self) -> Moment:
        """Return the last step."""
        return self._moments[-1]

    @property
    def steps(self) -> NDArray[np.float64]:
        """Return the number of each step since the agent was opened, ``(n,)``."""
        return np.arange(self._n_seen - len(self._moments), self._n_seen, dtype=np.float64) + 1.0

    def rewards(self) -> Lines:
        """Return the rewards."""
        return (np.array([moment.reward for moment in self._moments], dtype=np.float64),)

    def surprises(self, threshold: float | None) -> Lines:
        """Return the surprise, the evidence that it adds up to, and the threshold; 0 where there is none."""
        surprise = [moment.surprise or 0.0 for moment in self._moments]
        evidence = [moment.evidence or 0.0 for moment in self._moments]
        limit = np.full(len(self._moments), threshold or 0.0)
        return np.array(surprise, dtype=np.float64), np.array(evidence, dtype=np.float64), limit

    def probabilities(self) -> Lines:
        """Return the probability of each of the few tasks."""
        return tuple(np.array([moment.estimate.probabilities[0] for moment in self._moments], dtype=np.float64).T)

    def entries(self, most: int) -> Lines:
        """Return of each of a task's numbers, at most so many, four lines: mean plus and minus spread, mean, truth."""
        mean = np.array([moment.estimate.mean[0] for moment in self._moments], dtype=np.float64)  # (n, task_dim)
        std = np.array([moment.estimate.std[0] for moment in self._moments], dtype=np.float64)
        truth = np.array([_known(moment) for moment in self._moments], dtype=np.float64)
        lines = np.stack([mean + std, mean - std, mean, truth], axis=-1)[:, :most]  # (n, most, 4)
        return tuple(lines.reshape(len(lines), -1).T)


def _known(moment: Moment) -> NDArray[np.float32]:
    """Return the true task; where the environment names none, the estimate, whose line then hides it."""
    return moment.estimate.mean[0] if moment.task is None else moment.task

"""Has an agent tell what it takes the task for while rl_zoo3 lets it act."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from sb3_bruno.algorithms.carried import State
from sb3_bruno.algorithms.policies import Observation
from sb3_bruno.algorithms.task_inference import TaskInference

TOLD = {0, 1, 2, 5, 10, 20, 50}
"""Transitions of a task after which it tells, and then after every hundred."""
Algorithm = TypeVar("Algorithm", bound=type)


def telling(algorithm: Algorithm) -> Algorithm:
    """Return an algorithm whose agents print what they take the task of the first env for; others as they are."""
    if not issubclass(algorithm, TaskInference):
        return algorithm

    class Telling(algorithm):  # type: ignore[valid-type, misc]  # a class of the caller's
        _n_transitions = -1

        def predict(
            self,
            observation: Observation,
            state: State | None = None,
            episode_start: NDArray[Any] | None = None,
            deterministic: bool = False,
        ) -> tuple[NDArray[Any], State | None]:
            actions, state = super().predict(observation, state, episode_start, deterministic)
            begins = self._n_transitions < 0 or (episode_start is not None and bool(np.ravel(episode_start)[0]))
            is_inner = isinstance(observation, dict) and bool(np.ravel(observation["episode_start"])[0])
            if is_inner and not begins:  # another episode of a trial: no transition led to it
                return actions, state
            self._n_transitions = 0 if begins else self._n_transitions + 1
            is_due = self._n_transitions in TOLD or self._n_transitions % 100 == 0
            if self.policy.readout is not None and state is not None and is_due:
                print(f"after {self._n_transitions} transitions: {self.task_estimate(state).texts()[0]}", flush=True)
            return actions, state

    return Telling  # type: ignore[return-value]  # it is one

"""How long a run has trained at which environment step, by the clocks of SB3's monitor files."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray


class TrainingClock(NamedTuple):
    """The ends of the first environment's episodes.

    Attributes:
        env_steps: of all environments together, ``(n_episodes,)``.
        seconds: of training, ``(n_episodes,)``. What lies between the end of a run and its resumption is not counted:
            the Monitors go on from their checkpoint, and in subprocesses, where they start again, the parts add up.
    """

    env_steps: NDArray[np.int64]
    seconds: NDArray[np.float64]

    @classmethod
    def of_run(cls, folder: Path) -> TrainingClock | None:
        """The clock of a run's folder; None without monitor files or before the first episode's end."""
        if not (folder / "0.monitor.csv").is_file():
            return None
        episodes = pd.read_csv(folder / "0.monitor.csv", comment="#")
        if episodes.empty:
            return None
        n_envs = len(list(folder.glob("*.monitor.csv")))
        seconds = episodes["t"].to_numpy(dtype=np.float64)
        starts_again = np.diff(seconds, prepend=0.0) < 0
        before = np.where(starts_again, np.roll(seconds, 1), 0.0).cumsum()  # of the parts that had ended
        return cls(n_envs * episodes["l"].to_numpy(dtype=np.int64).cumsum(), before + seconds)

    def at(self, env_steps: NDArray[np.int64]) -> NDArray[np.float64]:
        """Seconds after so many environment steps, between episodes by interpolation."""
        seconds: NDArray[np.float64] = np.interp(env_steps, [0, *self.env_steps], [0.0, *self.seconds])
        return seconds

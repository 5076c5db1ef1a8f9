"""How long a run had trained by each environment step, from the clocks of SB3's monitor files."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray


class TrainingClock(NamedTuple):
    """The time at the end of each episode of the first environment.

    The time between the end of a run and its resumption does not count. A Monitor's clock continues from the
    checkpoint. In a subprocess it starts again from 0, and then the parts of the run are added up.

    Attributes:
        env_steps: environment steps so far, of all environments together, ``(n_episodes,)``.
        seconds: seconds of training so far, ``(n_episodes,)``.
    """

    env_steps: NDArray[np.int64]
    seconds: NDArray[np.float64]

    @classmethod
    def of_run(cls, folder: Path) -> TrainingClock | None:
        """Read the clock of a run's folder; None without monitor files, or before the first episode has ended."""
        if not (folder / "0.monitor.csv").is_file():
            return None
        episodes = pd.read_csv(folder / "0.monitor.csv", comment="#")
        if episodes.empty:
            return None
        n_envs = len(list(folder.glob("*.monitor.csv")))
        seconds = episodes["t"].to_numpy(dtype=np.float64)
        starts_again = np.diff(seconds, prepend=0.0) < 0
        before = np.where(starts_again, np.roll(seconds, 1), 0.0).cumsum()  # seconds of the parts before this one
        return cls(n_envs * episodes["l"].to_numpy(dtype=np.int64).cumsum(), before + seconds)

    def at(self, env_steps: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the seconds at each of ``env_steps``, ``(n,)``, interpolated between the ends of episodes."""
        seconds: NDArray[np.float64] = np.interp(env_steps, [0, *self.env_steps], [0.0, *self.seconds])
        return seconds

"""How long a run had trained by each environment step, from the clocks of SB3's monitor files."""

from __future__ import annotations

import warnings
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
        """Read the clock of a run's folder; None without monitor files, or before the first episode has ended.

        A damaged file has no clock, with a warning: it keeps nobody from testing the agent.
        """
        path = folder / "0.monitor.csv"
        if not path.is_file():
            return None
        try:
            episodes = pd.read_csv(path, comment="#")[["l", "t"]].astype(np.float64)
            if not np.isfinite(episodes).all(axis=None):
                raise ValueError("a number is missing")
        except (OSError, ValueError, KeyError) as error:  # pandas' errors are ValueErrors
            warnings.warn(f"{path} cannot be read ({error}), so nobody knows how long the run trained", stacklevel=2)
            return None
        if episodes.empty:
            return None
        n_envs = len(list(folder.glob("*.monitor.csv")))
        seconds = episodes["t"].to_numpy()
        starts_again = np.diff(seconds, prepend=0.0) < 0
        before = np.where(starts_again, np.roll(seconds, 1), 0.0).cumsum()  # seconds of the parts before this one
        return cls(n_envs * episodes["l"].to_numpy(dtype=np.int64).cumsum(), before + seconds)

    def at(self, env_steps: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the seconds at each of ``env_steps``, ``(n,)``, interpolated between the ends of episodes."""
        seconds: NDArray[np.float64] = np.interp(env_steps, [0, *self.env_steps], [0.0, *self.seconds])
        return seconds

"""Prints fewer tables of the log than SB3 does; TensorBoard and files get all of it."""

from __future__ import annotations

import sys
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import HumanOutputFormat, KVWriter

TABLES = 10  # of a training
LEAST = 2_000  # env steps between two


class SeldomTables(BaseCallback):
    """Lets a tenth of the training pass between two tables on stdout, and 2,000 env steps at least.

    Args:
        n_timesteps: env steps of the training.
    """

    def __init__(self, n_timesteps: int) -> None:
        super().__init__()
        self._every = max(n_timesteps // TABLES, LEAST)

    def _on_training_start(self) -> None:
        outputs = self.logger.output_formats
        for place, output in enumerate(outputs):
            if isinstance(output, HumanOutputFormat) and output.file is sys.stdout:
                outputs[place] = _Seldom(output, self._every)

    def _on_step(self) -> bool:
        return True


class _Seldom(KVWriter):
    """Writes the first table, and then one whenever ``every`` env steps have passed."""

    def __init__(self, output: KVWriter, every: int) -> None:
        self._output = output
        self._every = every
        self._next = 0

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        if step >= self._next:
            self._output.write(key_values, key_excluded, step)
            self._next = step + self._every

    def close(self) -> None:
        self._output.close()

"""Scalars that stay on their device until SB3's logger is dumped.

Making a number of a tensor on a GPU waits for the GPU. An update records its scalars far more often than a line of the
log is written.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch as th
from stable_baselines3.common.logger import KVWriter, Logger
from torch import Tensor


class TensorReader(KVWriter):
    """Turns recorded tensors into numbers, in one transfer, for the logger's outputs that come after it.

    Attributes:
        names: of the tensors recorded.
    """

    def __init__(self) -> None:
        self.names: set[str] = set()

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        recorded = [name for name in key_values if name in self.names]
        if recorded:
            numbers = th.stack([key_values[name] for name in recorded]).tolist()
            key_values.update(zip(recorded, numbers, strict=True))

    def close(self) -> None:
        """Close nothing: no file is open."""


def log_late(logger: Logger, scalars: Mapping[str, Tensor]) -> None:
    """Record tensors of shape () that become numbers when the logger is dumped."""
    reader = next((output for output in logger.output_formats if isinstance(output, TensorReader)), None)
    if reader is None:
        reader = TensorReader()
        logger.output_formats.insert(0, reader)  # outputs write in this order, all from one dict
    for name, scalar in scalars.items():
        reader.names.add(name)
        logger.record(name, scalar.detach())

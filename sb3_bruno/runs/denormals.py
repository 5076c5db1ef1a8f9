"""Flushes denormal numbers to zero in training: a CPU computes slowly with them (docs/performance.md)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch as th


@contextmanager
def flushed_denormals() -> Iterator[None]:
    """Flush denormal numbers to zero on this thread; at the end, keep them again, which is torch's default."""
    th.set_flush_denormal(True)
    try:
        yield
    finally:
        th.set_flush_denormal(False)

"""Numbers too small to be normal, on which a CPU is slow: flushed to zero in training (docs/performance.md)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch as th


@contextmanager
def flushed_denormals() -> Iterator[None]:
    """Flush denormal numbers to zero on this thread, and leave it as torch starts: with them."""
    th.set_flush_denormal(True)
    try:
        yield
    finally:
        th.set_flush_denormal(False)

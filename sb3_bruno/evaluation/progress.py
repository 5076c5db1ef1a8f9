"""A progress bar on stderr, where that is a terminal. Knows tqdm alone."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from tqdm import tqdm


def progress(steps: Iterable[Any] | None = None, *, shown: bool, total: int | None = None, about: str = "") -> Any:
    """Return tqdm's bar, which is silent where stderr is no terminal, and leaves no line behind.

    Args:
        steps: what to go through; None for a bar that ``update`` moves.
        shown: whether there is a bar at all.
        total: the number of steps, where ``steps`` does not know it.
        about: says what the steps are of.
    """
    return tqdm(steps, total=total, desc=about, disable=None if shown else True, leave=False)

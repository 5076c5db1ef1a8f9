"""Bounds what beliefs in long episodes cost: a window of steps, after a sample of the earlier ones that stands for all.

An encoder whose belief does not depend on the order of the transitions sums over them. A sample without replacement,
each of its members weighted by how many it stands for, estimates the sum without bias.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sb3_bruno.buffers.distinct import distinct_places
from sb3_bruno.buffers.episode_index import Slots

WINDOW = 128
"""Consecutive steps of a long episode, at which there are beliefs."""
EARLIER = 256
"""Steps before the window that stand for all that came before it."""


class EpisodeRows(NamedTuple):
    """Steps of an episode each, in their order.

    Attributes:
        slots: where they are in the ring, rows padded with their last slot, (n, time).
        counts: of how many steps each tells, 0 for padding, (n, time). None: of one each, and there is no padding.
        is_read: where the belief is that of all steps before, so that the step can be learned from, (n, time).
    """

    slots: Slots
    counts: NDArray[np.float32] | None
    is_read: NDArray[np.bool_]


def whole(slots: Slots, lengths: Slots) -> EpisodeRows:
    """Take all steps of episodes, (n, longest), of the lengths (n,)."""
    is_real = np.arange(slots.shape[1]) < lengths[:, None]
    return EpisodeRows(slots, is_real.astype(np.float32), is_real)


def shortened(slots: Slots, lengths: Slots, drawn: Slots, rng: np.random.Generator) -> EpisodeRows:
    """Take all steps of an episode of up to ``EARLIER + WINDOW``, and of a longer one a window and a sample before it.

    Example: with a window of 2 after 2, of an episode of 9 with the drawn step 6, the window may be steps 5 6, and the
    sample steps 1 and 4, each of which counts for 2.5 of the 5 steps before the window.

    Args:
        slots: of the episodes, (n, longest), rows padded with their last slot.
        lengths: of the episodes, (n,).
        drawn: a slot of each, which the window holds at a random place, (n,).
        rng: draws both.
    """
    if lengths.max() <= EARLIER + WINDOW:
        return whole(slots, lengths)
    step = np.argmax(slots == drawn[:, None], axis=1)
    return _with_windows(slots, lengths, step - rng.integers(WINDOW, size=len(slots)), rng)


def newest(slots: Slots, lengths: Slots, rng: np.random.Generator) -> EpisodeRows:
    """Take the newest steps, and a sample of those before them that stands for all; arguments as in ``shortened``."""
    if lengths.max() <= EARLIER + WINDOW:
        return whole(slots, lengths)
    return _with_windows(slots, lengths, lengths - WINDOW, rng)


def _with_windows(slots: Slots, lengths: Slots, begin: Slots, rng: np.random.Generator) -> EpisodeRows:
    """Take a window of each long episode, which begins at the step ``begin``, (n,), and a sample before it."""
    column, is_long = np.arange(EARLIER + WINDOW), lengths > EARLIER + WINDOW
    begin = np.where(is_long, np.clip(begin, 0, np.maximum(lengths - WINDOW, 0)), 0)
    end = np.where(is_long, begin + WINDOW, lengths)[:, None]
    n_earlier = np.minimum(begin, EARLIER)[:, None]
    sampled = np.sort(distinct_places(np.maximum(begin, 1), EARLIER, rng), axis=1)
    earlier = np.where((begin > EARLIER)[:, None], sampled, np.arange(EARLIER))
    steps = begin[:, None] + column - n_earlier  # of the window, in the columns after the earlier ones
    is_earlier, is_read = column < n_earlier, (column >= n_earlier) & (steps < end)
    weight = begin[:, None] / np.maximum(n_earlier, 1)
    counts = np.where(is_earlier, weight, is_read).astype(np.float32)
    last = np.maximum(end - 1, 0)  # pads, also where an episode has no step at all
    steps = np.where(is_earlier, np.pad(earlier, ((0, 0), (0, WINDOW))), np.minimum(steps, last))
    return EpisodeRows(np.take_along_axis(slots, steps, axis=1), counts, is_read)

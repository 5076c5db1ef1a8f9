"""Bounds what beliefs in long episodes cost: a window of steps, after a sample of the earlier ones that stands for all.

An encoder whose belief does not depend on the order of the transitions sums over them. A sample without replacement,
each of its members weighted by how many it stands for, estimates the sum without bias.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    steps = np.argmax(slots == drawn[:, None], axis=1)

    def begin(i: int) -> int:
        return int(np.clip(steps[i] - rng.integers(WINDOW), 0, lengths[i] - WINDOW))

    return _with_windows(slots, lengths, begin, rng)


def newest(slots: Slots, lengths: Slots, rng: np.random.Generator) -> EpisodeRows:
    """Take the newest steps, and a sample of those before them that stands for all; arguments as in ``shortened``."""
    if lengths.max() <= EARLIER + WINDOW:
        return whole(slots, lengths)
    return _with_windows(slots, lengths, lambda i: int(lengths[i]) - WINDOW, rng)


def _with_windows(
    slots: Slots, lengths: Slots, begin_of: Callable[[int], int], rng: np.random.Generator
) -> EpisodeRows:
    """Take a window of each long episode, which begins at step ``begin_of(row)``, and a sample before it."""
    most = EARLIER + WINDOW
    chosen = np.repeat(slots[:, :1], most, axis=1)  # padding, where an episode has no step at all
    counts, is_read = np.zeros(chosen.shape, dtype=np.float32), np.zeros(chosen.shape, dtype=bool)
    for i, length in enumerate(lengths.tolist()):
        if length == 0:
            continue
        begin = 0 if length <= most else begin_of(i)
        before = np.sort(rng.choice(begin, min(begin, EARLIER), replace=False))
        steps = np.concatenate([before, np.arange(begin, min(begin + (WINDOW if length > most else length), length))])
        counts[i, : len(steps)] = 1.0
        counts[i, : len(before)] = begin / max(len(before), 1)
        is_read[i, len(before) : len(steps)] = True
        chosen[i] = slots[i, np.pad(steps, (0, most - len(steps)), mode="edge")]
    return EpisodeRows(chosen, counts, is_read)

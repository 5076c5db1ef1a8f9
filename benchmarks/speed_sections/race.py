"""Contestants that take turns, and the table of their times."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

Seconds = dict[str, list[float]]


class Row(NamedTuple):
    """A line of the table: how often ``what`` is done, and its seconds as a multiple of those of ``beside``.

    ``share`` is that of the bare matrix products, where they take part: 1 would be the limit.
    """

    what: str
    per_second: float
    beside: str
    ratio: float
    low: float
    high: float
    target: str = ""
    share: float | None = None


def race(contestants: dict[str, Callable[[], Any]], rounds: int, calls: int) -> Seconds:
    """Time the contestants: seconds per call of each, an entry per round of ``calls`` calls.

    Time is the processor time of this process. A contestant that works in another one returns its seconds as a float.
    """
    for call in contestants.values():
        call()
    seconds: Seconds = {name: [] for name in contestants}
    for _ in range(rounds):
        for name, call in contestants.items():
            seconds[name].append(sum(_cost(call) for _ in range(calls)) / calls)
    return seconds


def _cost(call: Callable[[], Any]) -> float:
    start = time.process_time()
    answer = call()
    return answer if isinstance(answer, float) else time.process_time() - start


def row(
    what: str, seconds: Seconds, name: str, beside: str, target: str = "", units: int = 1, limit: str | None = None
) -> Row:
    """Compare ``name`` with ``beside``, the ratio taken round by round; a call does ``units`` of work.

    Args:
        what: the work.
        seconds: of all contestants.
        name: the contestant.
        beside: the one that it is compared with.
        target: what its ratio should be.
        units: how much of the work a call does.
        limit: the contestant that no other can be faster than.
    """
    ratio = np.divide(seconds[name], seconds[beside])
    low, middle, high = np.quantile(ratio, (0.25, 0.5, 0.75)).tolist()
    share = None if limit is None else float(np.median(np.divide(seconds[limit], seconds[name])))
    return Row(what, units / float(np.median(seconds[name])), beside, middle, low, high, target, share)


def table(rows: list[Row]) -> str:
    """Write the rows as a markdown table."""
    lines = [
        "| work | per second | beside | time, as a multiple (quartiles) | share of the limit | target |",
        "|---|---|---|---|---|---|",
    ]
    for entry in rows:
        speed = f"{entry.per_second:,.0f}" if entry.per_second else ""
        ratio = f"{entry.ratio:.2f} ({entry.low:.2f} to {entry.high:.2f})"
        share = "" if entry.share is None else f"{entry.share:.2f}"
        lines.append(f"| {entry.what} | {speed} | {entry.beside} | {ratio} | {share} | {entry.target} |")
    return "\n".join(lines) + "\n"

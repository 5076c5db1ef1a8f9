"""Says in words how far a belief can be trusted, from the numbers of its diagnostics by fixed thresholds."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sb3_bruno.evaluation.floats import Floats

if TYPE_CHECKING:
    from sb3_bruno.diagnostics.result import Diagnostics

WIDE = 0.6
"""Intervals are too wide where the central 50 % hold more than this share of what came."""

NARROW = (0.4, 0.8)
"""They are too narrow where the central 50 % or the central 90 % hold less than this."""

FAR = 0.2
"""Sets of transitions do not fit beyond this KS distance from uniform, unless so few may show it by chance."""

ALARM = {0.9: "strong", 0.75: "fair", 0.0: "weak"}
"""What the alarm is called, by the least AUROC."""

HOLDS = (0.8, 0.97)
"""The read-out's 90 % intervals should hold a share of the true tasks between these."""

TRUE_TASK = "probability of the true task"
"""What a read-out's misses are of where tasks are few."""

SOON = 20
"""Steps after which the read-out is judged."""

LEAST_MISS = 1e-9
"""A read-out's miss that is less counts as so much."""


def verdict(found: Diagnostics) -> str:
    """Judge a belief: its intervals, and so what to take it for; its alarm; the read-out of the task, if there is one.

    Example: ``"intervals too wide (71 % within 50 %): treat the belief as a ranking; alarm weak (AUROC 0.60)"``.
    """
    intervals, fit = _intervals(found.coverage(0.5), found.coverage(0.9)), _fit(found)
    right = intervals.startswith("intervals right") and not fit
    use = "take the belief at its word" if right else "treat the belief as a ranking"
    parts = [f"{intervals}{fit}: {use}", _alarm(found)]
    return "; ".join([*parts, *_readout(found)])


def _intervals(half: Floats, most: Floats) -> str:
    """Judge the predictive intervals of all quantities, whose shares within 50 % and 90 % are given."""
    wide, narrow = half > WIDE, (half < NARROW[0]) | (most < NARROW[1])
    shares = f"({100 * half.mean():.0f} % within 50 %, {100 * most.mean():.0f} % within 90 %)"
    faults = {"too wide": int(wide.sum()), "too narrow": int(narrow.sum())}
    said = [fault if n == len(half) else f"{fault} for {n} of {len(half)}" for fault, n in faults.items() if n > 0]
    return f"intervals {' and '.join(said) or 'right'} {shares}"


def _fit(found: Diagnostics) -> str:
    """Judge whole sets of transitions; nothing is said of those that fit."""
    if found.distance_levels is None:
        return ""
    n_sets = found.distance_levels[..., 0].size
    by_chance = 1.36 / math.sqrt(n_sets)  # what one KS distance in twenty exceeds
    distance = found.distance_ks().mean()
    return f", sets of transitions do not fit (KS distance {distance:.2f})" if distance > max(FAR, by_chance) else ""


def _alarm(found: Diagnostics) -> str:
    """Judge how well strange episodes are told from known ones."""
    if found.outside_tasks is None:
        return "alarm not tested, for there are no outside tasks"
    auroc = found.auroc()
    return f"alarm {next(word for least, word in ALARM.items() if auroc >= least)} (AUROC {auroc:.2f})"


def _readout(found: Diagnostics) -> list[str]:
    """Judge the read-out of the task; nothing is said of an agent without one."""
    if found.readout_misses is None or found.readout_holds is None or found.readout_entries is None:
        return []
    soon = min(SOON, found.readout_misses.shape[2] - 1)
    steps = f"after {soon} steps"
    misses = np.nanmean(found.readout_misses[:, :, [0, soon]], axis=(0, 1))  # (2, n_entries)
    each_held = np.nanmean(found.readout_holds[:, :, soon:], axis=(0, 1, 2))  # (n_entries,)
    if found.readout_entries[0] == TRUE_TASK:
        share = 100 * each_held[0]
        return [f"read-out gives the true task {1 - misses[1, 0]:.2f} {steps}, and is right {share:.0f} % of the time"]
    weights = _weights(found.tasks, misses[0])
    held = np.average(each_held, weights=weights)
    if len(found.readout_entries) == 1:
        unit = "".join(str(found.readout_entries[0]).partition(",")[2:])
        said = f"is off by {misses[1, 0]:.2g}{unit} {steps}, by {misses[0, 0]:.2g}{unit} before any"
    else:
        left = np.average(misses[1] / np.maximum(misses[0], LEAST_MISS), weights=weights)
        said = f"is off {steps} by {100 * left:.0f} % of what it is before any"
    fault = "too narrow" if held < HOLDS[0] else "too wide" if held > HOLDS[1] else "right"
    return [f"read-out {said}, its intervals {fault} ({100 * held:.0f} % within 90 %)"]


def _weights(tasks: Floats, misses: Floats) -> Floats:
    """Return what each entry counts, (n_entries,): 1 if its tasks vary by what the read-out misses before any step.

    An entry that varies less counts less, and one that does not vary counts nothing: it is known from the first, so
    what is missed of it is noise, and its interval always holds. Where no entry varies, all count alike.

    Args:
        tasks: the diagnosed ones, (n_tasks, n_entries).
        misses: the mean miss before any step, (n_entries,).
    """
    weights: Floats = np.minimum(tasks.std(axis=0) / np.maximum(misses, LEAST_MISS), 1.0)
    return weights if weights.any() else np.ones_like(weights)

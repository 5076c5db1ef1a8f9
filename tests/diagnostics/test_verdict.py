"""The verdict on a belief is read off its numbers, by thresholds that are said."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sb3_bruno.diagnostics.result import Diagnostics
from sb3_bruno.diagnostics.verdict import verdict

RIGHT = np.linspace(0.005, 0.995, 100)  # PIT of a predictive that is right
WIDE, NARROW = 0.5 + 0.3 * (RIGHT - 0.5), np.clip(0.5 + 4.0 * (RIGHT - 0.5), 0.0, 1.0)


def found_of(*pits: Any, **changes: Any) -> Diagnostics:
    """One task, ten episodes of ten steps, a quantity for each PIT."""
    found = Diagnostics(
        tasks=np.zeros((1, 1)),
        quantities=np.array([f"quantity {i}" for i in range(len(pits))]),
        pit=np.stack([pit.reshape(1, 10, 10) for pit in pits], axis=-1),
        log_scores=np.linspace(0.0, 1.0, 10)[None, :, None] * np.ones((1, 10, 10)),
        beliefs=np.zeros((1, 10, 11, 2)),
        explained=np.array([1.0, 0.0]),
        real=np.zeros((1, 10)),
        predicted=np.zeros((3, 1, 10)),
    )
    return replace(found, **changes)


@pytest.mark.parametrize(
    ("pits", "said"),
    [
        ([RIGHT], "intervals right (50 % within 50 %, 90 % within 90 %): take the belief at its word;"),
        ([WIDE], "intervals too wide (100 % within 50 %, 100 % within 90 %): treat the belief as a ranking;"),
        ([NARROW], "intervals too narrow (12 % within 50 %, 22 % within 90 %): treat the belief as a ranking;"),
        (
            [RIGHT, WIDE, NARROW],
            "intervals too wide for 1 of 3 and too narrow for 1 of 3 (54 % within 50 %",
        ),
    ],
)
def test_intervals_decide_what_to_take_the_belief_for(pits: Any, said: str) -> None:
    assert verdict(found_of(*pits)).startswith(said)


@pytest.mark.parametrize(
    ("n_sets", "level", "fits"), [(100, RIGHT, True), (100, 0.9 + 0.1 * RIGHT, False), (4, 0.5 * RIGHT, True)]
)
def test_whole_sets_must_fit_too_unless_they_are_too_few_to_tell(n_sets: int, level: Any, fits: bool) -> None:
    levels = np.linspace(level[0], level[-1], n_sets).reshape(1, n_sets, 1)
    said = verdict(found_of(RIGHT, distance_levels=levels))
    assert ("sets of transitions do not fit" not in said) == fits
    assert ("take the belief at its word" in said) == fits


@pytest.mark.parametrize(
    ("shift", "said"), [(5.0, "strong (AUROC 1.00)"), (0.4, "fair (AUROC 0.79)"), (0.0, "weak (AUROC 0.5")]
)
def test_the_alarm_is_graded(shift: float, said: str) -> None:
    outside = found_of(RIGHT).log_scores - shift
    assert f"alarm {said}" in verdict(found_of(RIGHT, outside_tasks=np.ones((1, 1)), outside_log_scores=outside))
    assert "alarm not tested" in verdict(found_of(RIGHT))


def readout_of(entries: list[str], miss: float, holds: float) -> str:
    """Say what a read-out is worth that is off by 1 at first and by ``miss`` at the end of the ten steps."""
    misses = np.ones((1, 10, 11, len(entries)))
    misses[:, :, 10] = miss
    held = np.ones_like(misses)
    held[:, round(10 * holds) :] = 0.0
    tasks = np.zeros((1, len(entries)))
    found = found_of(RIGHT, tasks=tasks, readout_entries=np.array(entries), readout_misses=misses, readout_holds=held)
    numbers = found.numbers()
    told = [numbers[f"readout_{name}"] for name in ("miss_at_first", "miss", "holds")]
    assert told == pytest.approx([1.0, miss, holds])
    return verdict(found).split("; ")[-1]


def test_the_read_out_is_judged_by_its_miss_and_its_intervals() -> None:
    said = "read-out is off by 0.1 m/s after 10 steps, by 1 m/s before any, its intervals"
    assert readout_of(["velocity, m/s"], 0.1, 0.9) == f"{said} right (90 % within 90 %)"
    assert readout_of(["velocity, m/s"], 0.1, 0.5) == f"{said} too narrow (50 % within 90 %)"
    assert readout_of(["velocity, m/s"], 0.1, 1.0) == f"{said} too wide (100 % within 90 %)"
    assert readout_of(["x", "y"], 0.1, 0.9).startswith(
        "read-out is off after 10 steps by 10 % of what it is before any"
    )
    few = readout_of(["probability of the true task"], 0.25, 0.9)
    assert few == "read-out gives the true task 0.75 after 10 steps, and is right 90 % of the time"
    assert "read-out" not in verdict(found_of(RIGHT))


@pytest.mark.parametrize(
    ("others", "noise"),
    [([0.35], 1e-3), ([5.0, 0.35, 9.81], 1e-3), ([0.0], 0.0), ([0.1 + 0.2], 1e-17), ([1e4], 1.0)],
)
@pytest.mark.parametrize("jitter", [0.0, 1e-12])
def test_entries_that_do_not_vary_are_not_judged(others: list[float], noise: float, jitter: float) -> None:
    speeds = np.linspace(0.0, 3.0, 20)
    tasks = np.stack([speeds, *(other + jitter * np.sin(speeds) for other in others)], axis=1)
    misses = np.full((20, 1, 11, tasks.shape[1]), noise)  # of a constant they are as great after steps as before
    misses[:, :, 0, 0], misses[:, :, 1:, 0] = 0.8, 0.04
    held = np.ones_like(misses)
    held[:8, :, :, 0] = 0.0  # too narrow, where the task varies
    entries = np.array([f"task[{i}]" for i in range(tasks.shape[1])])
    found = found_of(RIGHT, tasks=tasks, readout_entries=entries, readout_misses=misses, readout_holds=held)
    said = "is off after 10 steps by 5 % of what it is before any, its intervals too narrow (60 % within 90 %)"
    assert verdict(found).endswith(said)


def test_entries_that_vary_count_alike_whatever_their_units() -> None:
    tasks = np.linspace([0.0, 0.0], [1.0, 1e-3], 20)
    misses = np.broadcast_to(np.array([0.2, 2e-4]), (20, 1, 11, 2)).copy()
    misses[:, :, 10] = [0.02, 1e-4]
    entries, held = np.array(["x, m", "y, km"]), np.ones_like(misses)
    found = found_of(RIGHT, tasks=tasks, readout_entries=entries, readout_misses=misses, readout_holds=held)
    assert "is off after 10 steps by 30 % of what it is before any" in verdict(found)

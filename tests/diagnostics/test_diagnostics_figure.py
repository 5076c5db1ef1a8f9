"""The figure of the diagnostics: what its panels show, for few tasks and for many, and its verdict."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from sb3_bruno.diagnostics.figure import draw_diagnostics, plot_diagnostics
from sb3_bruno.diagnostics.result import Diagnostics
from sb3_bruno.diagnostics.verdict import TRUE_TASK, verdict
from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.task_names import task_title


def diagnostics_of(n_tasks: int, quantities: int = 1, outside_bound: float | None = None) -> Diagnostics:
    """Two episodes of five steps of each task; the last episode ends after three steps."""
    rng = np.random.default_rng(0)
    pit, log_scores = rng.random((n_tasks, 2, 5, quantities)), rng.normal(size=(n_tasks, 2, 5))
    beliefs = rng.normal(size=(n_tasks, 2, 6, 2))
    pit[-1, 1, 3:] = log_scores[-1, 1, 3:] = beliefs[-1, 1, 4:] = np.nan
    predicted = np.stack([np.zeros((n_tasks, 5)), -np.ones((n_tasks, 5)), np.ones((n_tasks, 5))])
    return Diagnostics(
        tasks=np.linspace(0.0, 1.0, n_tasks)[:, None],
        quantities=np.array([f"quantity {i}" for i in range(quantities)]),
        pit=pit,
        distance_levels=rng.random((n_tasks, 2, quantities)),
        log_scores=log_scores,
        beliefs=beliefs,
        explained=np.array([0.5, 0.25]),
        real=rng.normal(size=(n_tasks, 5)),
        predicted=predicted,
        outside_tasks=None if outside_bound is None else np.array([[9.0]]),
        outside_log_scores=None if outside_bound is None else np.full((1, 2, 5), outside_bound),
    )


def test_six_panels_show_the_numbers() -> None:
    found = diagnostics_of(2, outside_bound=-50.0)
    panels = draw_diagnostics(found).axes
    titles = [panel.get_title(loc="left") for panel in panels]
    numbers = found.numbers()
    half, most = 100 * numbers["coverage_50"], 100 * numbers["coverage_90"]
    assert titles == [
        f"Calibration: {half:.0f} % within 50 %, {most:.0f} % within 90 %",
        "Distance of 4 sets of transitions",
        "Out-of-distribution alarm: AUROC 1.000",
        f"Log score of held-out transitions: {numbers['log_score']:.2f} nats",
        "Posterior means: 75 % of their variance",
        "Predicted and real quantity 0",
    ]
    labels = [[text.get_text() for text in panel.get_legend().get_texts()] for panel in panels]
    assert labels[0] == [f"quantity 0, KS {found.pit_ks()[0]:.2f}", "calibrated"]
    assert labels[2] == ["these tasks", "outside tasks"]
    assert labels[4] == ["task 0", "task 1", "prior"]
    assert labels[5] == ["task 0: mean, 90 %", "task 0: real", "task 1: mean, 90 %", "task 1: real"]


def test_names_of_tasks_are_drawn_as_they_are(tmp_path: Path) -> None:
    found = replace(diagnostics_of(2), names=np.array(["$a_{ $", "_hidden"]))  # half a formula, and a hidden label
    plot_diagnostics(found, tmp_path / "found.png")
    beliefs, prediction = draw_diagnostics(found).axes[-2:]
    assert [text.get_text() for text in beliefs.get_legend().get_texts()] == [r"\$a_{ \$", " _hidden", "prior"]
    assert len(prediction.get_legend().get_texts()) == 4


@pytest.mark.parametrize("names", [None, ["", ""], ["", "fast"]])
@pytest.mark.parametrize("dim", [1, 3, 9])
def test_tasks_are_called_as_evaluate_calls_them(names: list[str] | None, dim: int) -> None:
    tasks = np.float64(np.float32([[0.001] * dim, [0.002] * dim]))
    found = replace(diagnostics_of(2), tasks=tasks, names=None if names is None else np.array(names))
    titles = list(map(task_title, AdaptationResult(tasks, np.zeros((2, 1, 1)), names=names).labels))
    beliefs, prediction = draw_diagnostics(found).axes[-2:]
    assert [text.get_text() for text in beliefs.get_legend().get_texts()] == [*titles, "prior"]
    drawn = [text.get_text() for text in prediction.get_legend().get_texts()]
    assert drawn == [f"{title}: {what}" for title in titles for what in ("mean, 90 %", "real")]
    assert len(set(titles)) == 2


def readout(found: Diagnostics, entries: list[str]) -> Diagnostics:
    """Add a read-out that is off by 0.25 from the start, and holds half of the time."""
    shape = (*found.beliefs.shape[:3], len(entries))
    holds = np.resize([0.0, 1.0], shape)
    return replace(found, readout_entries=np.array(entries), readout_misses=np.full(shape, 0.25), readout_holds=holds)


def test_there_is_a_panel_for_what_was_measured_and_no_other() -> None:
    found = diagnostics_of(2)
    for kind, n_panels in {
        found: 5,  # no outside tasks, no alarm
        replace(found, distance_levels=None): 4,
        readout(found, ["velocity, m/s"]): 6,
        readout(diagnostics_of(2, outside_bound=-5.0), [TRUE_TASK]): 7,
    }.items():
        figure = draw_diagnostics(kind)
        assert len(figure.axes) == n_panels and all(panel.has_data() for panel in figure.axes)
        assert figure.get_suptitle().replace("\n", " ") == f"Verdict: {verdict(kind)}"


@pytest.mark.parametrize(
    ("entries", "title", "labels", "height"),
    [
        (["velocity, m/s"], "Read-out: 90 % interval holds 60 %", ["velocity, m/s"], 0.25),
        (
            [TRUE_TASK],
            "Read-out: likeliest task right in 60 %",
            [TRUE_TASK],
            0.75,
        ),
        ([f"task[{i}]" for i in range(6)], "Read-out: 90 % interval holds 50 %", ["median entry"], 0.25),
    ],
)
def test_the_read_out_is_drawn_along_time(entries: list[str], title: str, labels: list[str], height: float) -> None:
    found = readout(diagnostics_of(2), entries)
    panel = next(panel for panel in draw_diagnostics(found).axes if panel.get_title(loc="left") == title)
    assert [text.get_text() for text in panel.get_legend().get_texts()] == labels
    assert panel.lines[0].get_ydata() == pytest.approx(np.full(6, height))


def test_an_axis_that_holds_nothing_is_time(tmp_path: Path) -> None:
    found = replace(diagnostics_of(2), explained=np.array([0.99, 0.001]))
    beliefs = draw_diagnostics(found).axes[-2]
    assert beliefs.get_title(loc="left") == "Posterior means: 99 % of their variance"
    assert (beliefs.get_xlabel(), beliefs.get_ylabel()) == ("transitions seen", "principal axis 1 (99 %)")
    np.testing.assert_array_equal(beliefs.lines[0].get_xdata(), np.arange(6))


def test_an_encoder_that_measures_no_distance_says_so(tmp_path: Path) -> None:
    found = replace(diagnostics_of(2), distance_levels=None)
    assert "sets of transitions" not in found.summary() and "distance_ks" not in found.numbers()
    found.save(tmp_path / "found.npz")
    assert Diagnostics.load(tmp_path / "found.npz").distance_levels is None
    with pytest.raises(ValueError, match="MeasuresDistance"):
        found.distance_ks()


def test_lines_are_the_arrays() -> None:
    found = diagnostics_of(2, outside_bound=-5.0)
    _, _, alarm, log_scores, beliefs, prediction = draw_diagnostics(found).axes
    assert sum(bar.get_height() for bar in alarm.patches) == found.scores().size + 2
    np.testing.assert_allclose(log_scores.lines[0].get_ydata(), np.nanmedian(found.log_scores, axis=(0, 1)))
    ends = [line.get_xydata()[0] for line in beliefs.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(ends, [*found.beliefs[0, :, -1], found.beliefs[1, 0, -1], found.beliefs[1, 1, 3]])
    np.testing.assert_allclose(prediction.lines[0].get_ydata(), found.predicted[0, 0])
    np.testing.assert_allclose(prediction.lines[1].get_ydata(), found.real[0])


@pytest.mark.parametrize("outside_bound", [-1e6, 1e6])
def test_scores_far_outside_do_not_squeeze_the_others(outside_bound: float) -> None:
    found = diagnostics_of(3, outside_bound=outside_bound)
    alarm = draw_diagnostics(found).axes[2]
    low, high = alarm.get_xlim()
    assert high - low < 15 * np.ptp(found.scores())
    assert sum(bar.get_height() for bar in alarm.patches) == found.scores().size + 2  # none is lost
    assert alarm.get_xlabel().endswith("(outer bars: and beyond)")


def test_many_tasks_have_a_colour_bar_and_many_quantities_no_names() -> None:
    *panels, bar = draw_diagnostics(diagnostics_of(12, quantities=9)).axes
    assert bar.get_ylabel() == "task, first dimension"
    assert [text.get_text() for text in panels[0].get_legend().get_texts()] == ["each of 9 quantities", "calibrated"]
    assert [text.get_text() for text in panels[3].get_legend().get_texts()] == ["prior"]
    colors = {tuple(line.get_color()) for line in panels[3].lines if line.get_marker() == "o"}
    assert len(colors) == 12


def test_the_file_is_written_and_matplotlibs_settings_are_left_alone(tmp_path: Path) -> None:
    before = dict(matplotlib.rcParams)
    plot_diagnostics(diagnostics_of(1), tmp_path / "x.png")
    assert dict(matplotlib.rcParams) == before
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")

"""The figures draw the right numbers, with readable texts."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.evaluation.band import Band
from sb3_bruno.evaluation.eval_callback import LearningCurve
from sb3_bruno.plotting.curves import adaptation_band, learning_band, plot_adaptation, plot_learning_curves
from sb3_bruno.plotting.style import COLORS, apart, plot_bands

NAN = np.nan


def curve_of(returns: Sequence[Sequence[float]], tasks: Sequence[float], first_step: int = 10) -> LearningCurve:
    """Make evaluations at every ten steps; the episodes of each have the given scalar tasks."""
    n = len(returns)
    steps = first_step + 10 * np.arange(n)
    return LearningCurve(steps, np.tile(np.float32(tasks)[None, :, None], (n, 1, 1)), np.array(returns, float))


def test_adaptation_band_is_mean_and_middle_half_of_running_episodes() -> None:
    rewards = [[[1, 2], [3, NAN]], [[5, 8], [7, 0]]]
    result = AdaptationResult(np.array([[0.0], [1.0]]), np.array(rewards))
    pooled, first = adaptation_band(result), adaptation_band(result, slice(0, 1))
    np.testing.assert_array_equal(np.stack(pooled), [[1, 2], [4, 10 / 3], [2.5, 1], [5.5, 5]])
    np.testing.assert_array_equal(np.stack(first), [[1, 2], [2, 2], [1.5, 2], [2.5, 2]])


def test_learning_band_of_one_run_is_of_its_episodes() -> None:
    run = curve_of([[1, 2, 6], [4, 4, 7]], [0.0, 0.0, 1.0])
    pooled = learning_band("x", [run], over_runs=False)
    np.testing.assert_array_equal(np.stack(pooled), [[10, 20], [3, 5], [1.5, 4], [4, 5.5]])
    first = learning_band("x", [run], np.float32([0.0]), over_runs=False)
    np.testing.assert_array_equal(np.stack(first), [[10, 20], [1.5, 4], [1.25, 4], [1.75, 4]])


def test_learning_band_of_several_runs_is_of_their_means_up_to_the_shortest() -> None:
    runs = [curve_of([[1, 3], [5, 7]], [0.0, 1.0]), curve_of([[4, 8]], [0.0, 1.0])]
    np.testing.assert_array_equal(np.stack(learning_band("x", runs)).ravel(), [10, 4, 3, 5])


def test_an_evaluation_that_missed_the_task_leaves_a_gap() -> None:
    run = curve_of([[1, 2]], [0.0, 1.0])
    band = learning_band("x", [run], np.float32([5.0]))
    assert np.isnan(np.stack(band[1:])).all()


def test_runs_of_other_steps_are_refused() -> None:
    runs = [curve_of([[1.0]], [0.0]), curve_of([[1.0]], [0.0], first_step=11)]
    with pytest.raises(ValueError, match="the runs of 'BrunoSAC' were evaluated at different steps"):
        plot_learning_curves({"BrunoSAC": runs}, "unused.png")


def test_few_tasks_get_a_panel_each(tmp_path: Path) -> None:
    result = AdaptationResult(np.array([[1.0, 0.0], [0.0, 1.0]]), np.ones((2, 3, 20)))
    plot_adaptation({"BrunoSAC": result, "oracle": result}, tmp_path / "few.svg")
    curve = curve_of([[1, 2], [3, 4]], [0.0, 1.0])
    plot_learning_curves({"RL2": [curve, curve]}, tmp_path / "curves.svg", oracle={"0": 5.0, "1": 6.0})
    assert texts(tmp_path / "few.svg") >= {
        "task (1, 0): return 20.0, 20.0",
        "task (0, 1): return 20.0, 20.0",
        "BrunoSAC",
        "environment step",
    }
    assert texts(tmp_path / "curves.svg") >= {"task 0", "task 1", "RL2", "told the task", "test return"}


def test_many_tasks_or_different_ones_are_pooled(tmp_path: Path) -> None:
    many = AdaptationResult(np.arange(5.0)[:, None], np.ones((5, 2, 20)))
    plot_adaptation({"BrunoSAC": many}, tmp_path / "many.svg")
    results = [AdaptationResult(np.array([[task], [9.0]]), np.ones((2, 1, 3))) for task in (0.0, 1.0)]
    plot_adaptation(dict(zip(("x", "y"), results, strict=True)), tmp_path / "different.svg")
    plot_learning_curves({"x": curve_of([range(5)], range(5))}, tmp_path / "curves.svg", oracle=5.0)
    assert "5 tasks: return 20.0" in texts(tmp_path / "many.svg")
    assert "2 tasks: return 3.0, 3.0" in texts(tmp_path / "different.svg")
    assert texts(tmp_path / "curves.svg") >= {"5 tasks", "Line: mean. Band: middle half of the episodes."}


def test_a_name_has_one_colour_in_all_panels(tmp_path: Path) -> None:
    both, second = ({name: Band(*np.ones((4, 2))) for name in names} for names in (["x", "y"], ["y"]))
    plot_bands({"a": both, "b": second}, tmp_path / "bands.svg", "step", "return", "")
    before_legend = (tmp_path / "bands.svg").read_text(encoding="utf-8").lower().split('id="legend_')[0]
    panels = before_legend.split('id="axes_')[1:]
    drawn = [[color in panel for color in map(str.lower, COLORS[:2])] for panel in panels]
    assert drawn == [[True, True], [False, True]]


def test_a_method_has_one_colour_whatever_it_returns_on_each_task(tmp_path: Path) -> None:
    result = AdaptationResult(np.array([[0.0], [1.0]]), np.arange(12.0).reshape(2, 2, 3))
    plot_adaptation({"x": result}, tmp_path / "x.svg")
    drawn = (tmp_path / "x.svg").read_text(encoding="utf-8").lower()
    assert [color.lower() in drawn for color in COLORS[:2]] == [True, False]


def test_one_legend_of_all_panels_stands_above_them(tmp_path: Path) -> None:
    bands = [{name: Band(*np.ones((4, 2))) for name in names} for names in ("xy", "yz")]
    plot_bands(dict(zip("ab", bands, strict=True)), tmp_path / "bands.svg", "step", "return", "")
    groups = (tmp_path / "bands.svg").read_text(encoding="utf-8").split('<g id="')
    assert [group[: group.index('"')] for group in groups if group.startswith("legend_")] == ["legend_1"]
    assert [[f"<!-- {name} -->" in group for group in groups].count(True) for name in "xyz"] == [1, 1, 1]


def test_a_long_name_leaves_room_for_the_lines(tmp_path: Path) -> None:
    name = "bruno_sac (" + ", ".join(f"argument_{n}=value" for n in range(6)) + ")"
    with warnings.catch_warnings(action="error"):  # matplotlib warns when a legend leaves no room for its panel
        plot_bands({"a": {name: Band(*np.ones((4, 2)))}}, tmp_path / "bands.svg", "step", "return", "")
    assert "bruno_sac (argument_0=value," in texts(tmp_path / "bands.svg")


def test_a_long_title_takes_more_lines_instead_of_being_cut(tmp_path: Path) -> None:
    result = AdaptationResult(np.zeros((1, 1)), np.ones((1, 1, 2)), names=["go to the left " * 8 + "$"])
    plot_adaptation({"x": result}, tmp_path / "x.svg")
    titles = [text for text in texts(tmp_path / "x.svg") if "left" in text]
    assert len(titles) > 2 and max(map(len, titles)) <= 54


def test_few_lines_are_named_at_their_ends_and_more_in_a_legend(tmp_path: Path) -> None:
    bands = {name: Band(np.arange(3.0), *np.full((3, 3), height)) for height, name in enumerate("wxyz")}
    plot_bands({"a": bands}, tmp_path / "few.svg", "step", "return", "")
    plot_bands({"a": {**bands, "v": bands["w"]}}, tmp_path / "more.svg", "step", "return", "")
    few, more = ((tmp_path / f"{name}.svg").read_text(encoding="utf-8") for name in ("few", "more"))
    assert 'id="legend_' not in few and {*"wxyz"} <= texts(tmp_path / "few.svg")
    assert 'id="legend_' in more


def test_the_first_steps_are_drawn_large_and_all_steps_below(tmp_path: Path) -> None:
    def drawn(horizon: int, **config: int) -> tuple[int, str]:
        result = AdaptationResult(np.zeros((1, 1)), np.ones((1, 2, horizon)), config=config)
        plot_adaptation({"x": result}, tmp_path / "x.svg")
        figure = (tmp_path / "x.svg").read_text(encoding="utf-8")
        return figure.count('<g id="axes_'), figure

    assert drawn(60)[0] == 1 and drawn(61)[0] == 2
    whole, trial = drawn(60)[1], drawn(60, n_inner_episodes=3)[1]
    assert trial.count("stroke-dasharray") == whole.count("stroke-dasharray") + 2  # borders of its episodes


def test_labels_keep_apart_and_in_order() -> None:
    np.testing.assert_allclose(apart(np.array([1.0, 1.0, 5.0]), gap=2.0), [0.0, 2.0, 5.0])
    np.testing.assert_allclose(apart(np.array([5.0, 1.0, 1.5]), gap=2.0), [5.0, 0.25, 2.25])
    assert apart(np.array([3.0]), gap=2.0).tolist() == [3.0]


def test_matplotlibs_settings_are_left_alone(tmp_path: Path) -> None:
    before = dict(matplotlib.rcParams)
    plot_adaptation({"x": AdaptationResult(np.zeros((1, 1)), np.ones((1, 1, 2)))}, tmp_path / "x.png")
    assert dict(matplotlib.rcParams) == before
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")


def test_errors_name_the_argument() -> None:
    with pytest.raises(ValueError, match="results is empty"):
        plot_adaptation({}, "unused.png")
    with pytest.raises(ValueError, match="curves is empty"):
        plot_learning_curves({"BrunoSAC": []}, "unused.png")
    with pytest.raises(ValueError, match=r"oracle has \['0'\] and lacks task '1': add its return"):
        plot_learning_curves({"x": curve_of([[1, 2]], [0.0, 1.0])}, "unused.png", oracle={"0": 1.0})


def texts(path: Path) -> set[str]:
    """Return the texts of an SVG: matplotlib draws them as paths and repeats them as comments."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return {line.strip()[5:-4] for line in lines if line.strip().startswith("<!-- ")}

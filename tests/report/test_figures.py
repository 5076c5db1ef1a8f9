"""What the figures of a results page draw is read off the records, and methods and tasks are called as people do."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from sb3_bruno.plotting.dots import Dots, plot_dots
from sb3_bruno.report.figures import draw_page, learning_bands, regret_bands, reward_bands
from sb3_bruno.report.methods import called, methods_of
from sb3_bruno.report.task_axis import task_axis, task_bands
from sb3_bruno.runs.record import RunRecord
from sb3_bruno.zoo.called import with_names

SPEEDS = ["2 m/s", "0.5 m/s", "1 m/s", "3 m/s", "2.5 m/s"]


def record(reward: float, tasks: list[str] = SPEEDS, **config: Any) -> RunRecord:
    """Four steps, each of which pays the same; one more for each task later in the list."""
    about = {"config": {"algo": "bruno_sac", "env": "CheetahVel-v0", "env_steps": 9, **config}, "versions": {}}
    about["steps_to_90"] = dict.fromkeys(tasks, 1)
    paid = reward + np.arange(len(tasks))
    pooled = len(tasks) > 4
    means = {"all": paid.mean()} if pooled else dict(zip(tasks, paid, strict=True))
    steps = pd.DataFrame({"step": range(1, 5)})
    rewards = pd.concat([steps.assign(task=name, mean=mean, low=mean, high=mean) for name, mean in means.items()])
    episodes = pd.DataFrame({"task": tasks, "episode": 0, "return_4": 4 * paid})
    learning = pd.DataFrame({"timesteps": 9, "seconds": np.nan, "task": tasks, "return": 4 * paid})
    return RunRecord(about, learning, episodes, rewards)


def test_bands_are_of_seeds() -> None:
    methods = {"BrunoSAC": [record(reward) for reward in (0.0, 1.0, 2.0, 9.0)]}
    (rewards,) = reward_bands(methods)["5 tasks"].values()
    np.testing.assert_allclose(np.stack(rewards)[:, 0], [1, 5.0, 2.75, 5.75])  # each seed pays 2 more on average
    (learning,) = learning_bands(methods)["5 tasks"].values()
    np.testing.assert_allclose(np.stack(learning)[:, 0], [9, 20.0, 11.0, 23.0])


def test_regret_is_what_is_earned_less_than_by_the_one_that_is_told_the_task() -> None:
    told = [record(2.0), record(4.0)]
    assert regret_bands({"BrunoSAC": told}) == {}
    ((title, bands),) = regret_bands({"BrunoSAC": [record(1.0)], "told the task": told}).items()
    assert title == "5 tasks" and list(bands) == ["BrunoSAC"]
    np.testing.assert_allclose(bands["BrunoSAC"].mean, [2.0, 4.0, 6.0, 8.0])


def test_results_stand_over_the_tasks_value_where_it_is_one_number() -> None:
    methods = {"BrunoSAC": [record(-10.0), record(-12.0)]}
    axis = task_axis(methods)
    assert axis is not None and axis.x == "target speed, m/s" and axis.is_miss
    band = task_bands(methods, "return_4", axis)["BrunoSAC"]
    assert band.x.tolist() == [0.5, 1.0, 2.0, 2.5, 3.0]
    np.testing.assert_allclose(band.mean, [10.0, 9.0, 11.0, 7.0, 8.0])  # m/s per step
    other = {"BrunoSAC": [record(-10.0, env="Other-v0")]}
    axis = task_axis(other)
    assert axis is not None and (axis.x, axis.y) == ("task, m/s", "test return")
    np.testing.assert_allclose(task_bands(other, "return_4", axis)["BrunoSAC"].mean, [-36, -32, -40, -24, -28])


@pytest.mark.parametrize("tasks", [SPEEDS[:4], ["1_0", "0_1", "1_1", "2_1", "1_2"], [*SPEEDS, "1 kg"], [*SPEEDS, "up"]])
def test_few_tasks_and_those_that_are_no_numbers_have_no_axis(tasks: list[str]) -> None:
    assert task_axis({"BrunoSAC": [record(0.0, tasks)]}) is None


def test_methods_are_called_as_people_do_without_what_they_share() -> None:
    def names(*configs: dict[str, Any]) -> tuple[list[str], list[str]]:
        methods, shared = called(methods_of([record(0.0, **config) for config in configs]))
        return list(methods), shared

    same = {"a.belief": "mean"}
    assert names({"params": same}) == (["BrunoSAC, belief=mean"], [])
    assert names({"params": same}, {"params": {**same, "x": 1}}) == (["BrunoSAC", "BrunoSAC, x=1"], ["belief=mean"])
    assert names({"params": {"a.x": 1}}, {"params": {"b.x": 1}})[0] == ["bruno_sac (a.x=1)", "bruno_sac (b.x=1)"]


def test_tasks_of_old_records_are_called_as_their_env_does() -> None:
    old = record(0.0, ["1_0", "0_1"], env="CheetahDir-v0")
    new = with_names(old)
    assert new.episodes["task"].tolist() == new.learning["task"].tolist() == ["backward", "forward"]
    assert set(new.rewards["task"]) == set(new.about["steps_to_90"]) == {"backward", "forward"}
    assert with_names(record(0.0, ["2.051", "1", "3", "0.5", "7"])).episodes["task"].tolist() == [
        *("2.051 m/s", "1 m/s", "3 m/s", "0.5 m/s"),
        "7",  # no task of that environment
    ]
    strangers = [record(0.0, ["1", "2"], env=env) for env in ("Unknown-v0", "CartPole-v1", "antigravity:Zen-v0", ":")]
    for kept in (new, *strangers):
        assert with_names(kept) is kept
    assert "antigravity" not in sys.modules


def test_a_method_far_off_the_others_squeezes_none(tmp_path: Path) -> None:
    near = Dots(np.array([7.0, 8.0]), 7.5, 7.0, 8.0)
    far = Dots(np.array([-900.0, -800.0]), -850.0, -900.0, -800.0)
    plot_dots({"a": near, "b": near, "no memory": far}, tmp_path / "far.svg", "return", "")
    plot_dots({"no memory": far, "a": near, "b": near}, tmp_path / "first.svg", "return", "")
    assert "◂ -850" in (tmp_path / "far.svg").read_text(encoding="utf-8")
    assert "◂" not in (tmp_path / "first.svg").read_text(encoding="utf-8")


def test_a_page_keeps_no_figure_of_an_earlier_one(tmp_path: Path) -> None:
    draw_page({"BrunoSAC": [record(-9.0)], "told the task": [record(-8.0)]}, tmp_path)
    assert {path.stem for path in tmp_path.iterdir()} == {"learning_curves", "adaptation", "regret", "methods", "tasks"}
    (tmp_path / "diagnostics.png").touch()
    draw_page({"BrunoSAC": [record(0.0, SPEEDS[:2])]}, tmp_path)
    assert {path.stem for path in tmp_path.iterdir()} == {"learning_curves", "adaptation", "diagnostics"}


def test_runs_that_share_no_evaluation_have_no_learning_curve(tmp_path: Path) -> None:
    early, late = record(-9.0), record(-8.0)
    late.learning["timesteps"] = 10
    draw_page({"BrunoSAC": [early, late]}, tmp_path)
    assert {path.stem for path in tmp_path.iterdir()} >= {"adaptation", "tasks"}
    assert not (tmp_path / "learning_curves.png").exists()

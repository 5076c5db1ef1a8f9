"""The record of a run holds the numbers of its test and of its curve, and a page is made of records."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sb3_bruno.cli import console
from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.evaluation.interquartile import interquartile_mean
from sb3_bruno.report.page import by_method
from sb3_bruno.runs.record import RunRecord

DIRECTIONS = np.array([[1.0, 0.0], [0.0, 1.0]])


def run_folder(folder: Path, seed: int, algo: str = "bruno_sac", tasks: np.ndarray = DIRECTIONS, **config) -> Path:
    """Write a folder as ``train`` and ``evaluate`` do: two evaluations, and a test of 210 steps of reward ``seed``."""
    folder.mkdir(parents=True)
    rewards = np.full((len(tasks), 3, 210), float(seed))
    rewards[0, 0] = -1.0  # the lowest episode
    about = {"algo": algo, "env": "CheetahDir-v0", "env_steps": 400, "seed": seed, **config}
    AdaptationResult(tasks, rewards, about, versions={"torch": "2", "commit": "abcdef012345"}).save(
        folder / "adaptation.json"
    )
    returns = np.arange(2.0 * len(tasks)).reshape(2, -1) + seed
    np.savez(folder / "evaluations.npz", timesteps=[200, 400], results=returns, ep_lengths=np.full(returns.shape, 200))
    np.savez(folder / "evaluation_tasks.npz", tasks=np.tile(np.float32(tasks), (2, 1, 1)))
    return folder


def test_a_record_holds_the_curve_and_the_test_and_reads_back(tmp_path: Path) -> None:
    record = RunRecord.from_run(run_folder(tmp_path / "run", 3))
    record.save(tmp_path / "record")
    read = RunRecord.load(tmp_path / "record")
    assert read.about == record.about and read.about["versions"]["commit"] == "abcdef012345"
    for table, saved in zip(read[1:], record[1:], strict=True):
        pd.testing.assert_frame_equal(table, saved.reset_index(drop=True), check_dtype=False)
    assert read.learning["return"].tolist() == [3.0, 4.0, 5.0, 6.0]
    assert read.learning["task"].tolist() == ["1_0", "0_1"] * 2
    assert read.scores("return_200").to_dict() == pytest.approx({"1_0": (-200 + 2 * 600) / 3, "0_1": 600})
    assert read.measures == ["return_200", "return_210"], "it was tested for 210 steps"
    assert read.rewards.groupby("task", sort=False)["low"].min().to_dict() == {"1_0": -1.0, "0_1": 3.0}


@pytest.mark.parametrize("names", [["None", "nan"], ["NA", "null"], ["all", 'a, "b"'], ["1", "1"], ["a\rb", "#N/A"]])
def test_a_task_may_be_called_what_a_table_takes_for_a_gap(tmp_path: Path, names: list[str]) -> None:
    run = run_folder(tmp_path / "run", 3)
    test = AdaptationResult.load(run / "adaptation.json")
    AdaptationResult(test.tasks, test.rewards, test.config, names=names).save(run / "adaptation.json")
    record = RunRecord.from_run(run)
    record.save(tmp_path / "record")
    read = RunRecord.load(tmp_path / "record")
    for table, saved in zip(read[1:], record[1:], strict=True):
        assert table["task"].tolist() == saved["task"].tolist()
    assert len(read.parts()) == len(read.about["steps_to_90"]) == len(names)


def test_of_several_tests_the_longest_counts_or_the_one_that_is_named(tmp_path: Path) -> None:
    run = run_folder(tmp_path / "run", 3)
    result = AdaptationResult.load(run / "adaptation.json")
    for name, horizon, config in (
        ("adaptation_30_steps", 30, {}),
        ("adaptation_stochastic", 210, {"deterministic": False}),
        ("adaptation_of_less_training", 210, {"env_steps": 200}),
        ("adaptation_train_tasks", 300, {"split": "train"}),
        ("adaptation_beyond_set", 300, {"tasks": "beyond"}),
    ):
        config = {**result.config, **config}
        rewards = np.pad(result.rewards, [(0, 0), (0, 0), (0, 90)])[..., :horizon]
        AdaptationResult(result.tasks, rewards, config).save(run / f"{name}.json")
    assert RunRecord.from_run(run).method == "bruno_sac" and RunRecord.from_run(run).measures[-1] == "return_210"
    assert RunRecord.from_run(run / "adaptation_stochastic.json").method == "bruno_sac (stochastic)"


def test_rewards_of_many_tasks_are_kept_together(tmp_path: Path) -> None:
    record = RunRecord.from_run(run_folder(tmp_path / "run", 2, tasks=np.linspace(0, 3, 30)[:, None]))
    assert record.rewards["task"].unique().tolist() == ["all"] and len(record.rewards) == 210
    assert len(record.scores("return_200")) == 30


def test_many_tasks_are_told_apart_by_whether_training_tasks_surround_them(tmp_path: Path) -> None:
    tasks = np.arange(6.0)[:, None]
    inside = [False, True, True, True, True, False]
    record = RunRecord.from_run(run_folder(tmp_path / "a", 1, tasks=tasks, inside_train_box=inside))
    assert record.parts() == {"inside": ["1", "2", "3", "4"], "outside": ["0", "5"]}
    assert RunRecord.from_run(run_folder(tmp_path / "b", 1, tasks=tasks, inside_train_box=[True] * 6)).parts() == {}
    assert RunRecord.from_run(run_folder(tmp_path / "c", 1)).parts() == {"1_0": ["1_0"], "0_1": ["0_1"]}


def test_the_episodes_of_a_trial_are_kept_apart(tmp_path: Path) -> None:
    record = RunRecord.from_run(run_folder(tmp_path / "run", 2, n_inner_episodes=3))
    assert record.measures == ["episode_1", "episode_2", "episode_3", "return_200", "return_210"]
    assert record.scores("episode_3").to_dict() == pytest.approx({"1_0": (-70 + 2 * 140) / 3, "0_1": 140})


def test_a_method_is_called_by_what_was_chosen_against_its_config(tmp_path: Path) -> None:
    about = {"conf": "oracle", "params": {"n_envs": 20}}
    assert RunRecord.from_run(run_folder(tmp_path / "a", 1, "sac", **about)).method == "sac (oracle, n_envs=20)"
    assert RunRecord.from_run(run_folder(tmp_path / "b", 1, params={}, conf=None)).method == "bruno_sac"
    drawn = run_folder(tmp_path / "c", 1, params={}, conf=None, deterministic=False)
    assert RunRecord.from_run(drawn).method == "bruno_sac (stochastic)"


def test_the_interval_holds_the_interquartile_mean() -> None:
    scores = np.arange(1.0, 9.0)[:, None]
    found = interquartile_mean(scores)
    assert found.value == pytest.approx(np.mean([3, 4, 5, 6]))
    assert 1 < found.low < found.value < found.high < 8
    assert interquartile_mean(scores) == found


def test_every_mean_over_seeds_is_interquartile(tmp_path: Path) -> None:
    seeds = (1, 2, 3, 4, 100)  # of which the middle three count
    records = [RunRecord.from_run(run_folder(tmp_path / str(seed), seed)) for seed in seeds]
    for seed, record in zip(seeds, records, strict=True):
        record.about["steps_to_90"] = {"1_0": seed, "0_1": 3 * seed}
    *_, all_tasks, first, second, lowest, steps, _ = by_method({"bruno_sac": records})[2].split(" | ")
    assert all_tasks.startswith("490.0 (") and (first, second) == ("350.0", "630.0"), "after 210 steps"
    assert lowest == "-210" and steps == "6.0"


def test_a_page_is_made_of_new_and_of_recorded_runs(tmp_path: Path, capsys, monkeypatch) -> None:
    def report(*arguments):
        monkeypatch.setattr(sys, "argv", ["sb3-bruno", "report", *map(str, arguments), "--out", str(tmp_path / "page")])
        console()

    monkeypatch.setitem(interquartile_mean.__kwdefaults__, "n_resamples", 20)  # many take seconds
    clocked = run_folder(tmp_path / "c", 3, "sac", conf="oracle")
    (clocked / "0.monitor.csv").write_text('#{"t_start": 0.0}\nr,l,t\n1,200,60\n1,200,180\n')
    commits = ["1234567890", "fedcba9876-dirty"]
    with monkeypatch.context() as without_figures:  # which take seconds
        without_figures.setattr("sb3_bruno.report.page.draw_page", lambda methods, out: None)
        report(
            run_folder(tmp_path / "a", 1, split="train", wall_seconds=120, trained_at=commits),
            run_folder(tmp_path / "b", 5),
        )
    report(clocked)
    assert RunRecord.load(tmp_path / "page" / "sac_oracle" / "seed3").learning["seconds"].tolist() == [60, 60, 180, 180]
    page = (tmp_path / "page" / "table.md").read_text()
    assert page.strip() in capsys.readouterr().out
    assert "| BrunoSAC | 2 | 400 |" in page and "| told the task | 1 | 400 |" in page
    assert "| bruno_sac | 5 |" in page and "2 / ?" in page and "| 1234567 fedcba9-dirty | abcdef0 |" in page
    assert "mean over the train tasks" in page, "of the runs that know it"
    assert "| ? | abcdef0 |" in page, "where it is not known"
    for name in ("learning_curves.png", "adaptation.png", "wall_time.png", "regret.png", "methods.png"):
        assert (tmp_path / "page" / name).stat().st_size > 10_000
    assert "| 200 steps | 210 steps | behind “told the task” | 210 steps, backward |" in page, "as the env calls it"
    assert not (tmp_path / "page" / "tasks.png").exists(), "tasks are few"
    monkeypatch.setattr("sb3_bruno.report.page.draw_page", lambda methods, out: None)
    report(run_folder(tmp_path / "f", 3, "sac", tasks=DIRECTIONS[1:], conf="forward"))
    of_one_task = "| SAC, forward | 1 | 400 | 333.3 | 350.0 | 280.0 |  | 350.0 |"
    assert of_one_task in (tmp_path / "page" / "table.md").read_text()
    with pytest.raises(SystemExit, match="sb3-bruno evaluate"):
        report(tmp_path)
    with pytest.raises(SystemExit, match="e is a second run of bruno_sac/seed7"):
        report(run_folder(tmp_path / "d", 7), run_folder(tmp_path / "e", 7))
    assert not (tmp_path / "page" / "bruno_sac" / "seed7").exists(), "all or none"
    for other, budget in (
        ({"env_steps": 500}, "500 env steps of Cheetah"),
        ({"env": "Other-v0"}, "400 env steps of Other"),
    ):
        with pytest.raises(SystemExit, match=f"bruno_sac has runs of .*{budget}"):
            report(run_folder(tmp_path / budget, 9, **other))
        assert not (tmp_path / "page" / "bruno_sac" / "seed9").exists(), "nor of another budget"
    with pytest.raises(SystemExit, match="bruno_sac has runs that were tested on different tasks"):
        report(run_folder(tmp_path / "other tasks", 9, tasks=-DIRECTIONS))
    assert not (tmp_path / "page" / "bruno_sac" / "seed9").exists(), "nor of other tasks"
    monkeypatch.setattr(sys, "argv", ["sb3-bruno", "report", "--out", str(tmp_path / "none")])
    with pytest.raises(SystemExit, match="give folders of runs that were tested"):
        console()


def test_names_of_tasks_and_successes_go_from_the_test_to_the_page(tmp_path: Path) -> None:
    run = run_folder(tmp_path / "run", 3)
    result = AdaptationResult.load(run / "adaptation.json")
    successes = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 1.0]])
    named = AdaptationResult(
        result.tasks, result.rewards, result.config, 0, result.versions, ["backward", "forward"], successes
    )
    named.save(run / "adaptation.json")
    record = RunRecord.from_run(run)
    record.save(tmp_path / "record")
    read = RunRecord.load(tmp_path / "record")
    assert read.learning["task"].tolist() == ["backward", "forward"] * 2 and list(read.parts()) == [
        "backward",
        "forward",
    ]
    assert read.measures == ["success_percent", "return_200", "return_210"]
    assert read.scores("success_percent").to_dict() == pytest.approx({"backward": 200 / 3, "forward": 100})
    head, _, row = by_method({read.method: [read]})
    assert "| success, % |" in head and "| 83.3 |" in row and "210 steps, forward" in head

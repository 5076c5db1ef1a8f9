"""``sweep run`` and its neighbours, with trials that take no time."""

import io
import sys

import numpy as np
import optuna
import pytest

from sb3_bruno.cli.main import main
from sb3_bruno.zoo.storage import open_storage
from sb3_bruno.zoo.study import CODE, SETTINGS, load_study
from sb3_bruno.zoo.sweep import SweepExperiment

CHOSEN = ["--storage", "x.log", "--study-name", "s"]
INIT = ["sweep", "init", *CHOSEN, "--env", "PointDir-v0", "-n", 120]
RUN = ["sweep", "run", *CHOSEN, "--max-total-trials", 2]


@pytest.fixture
def quick(monkeypatch):
    """Let a trial return its number at once."""
    monkeypatch.setattr(SweepExperiment, "objective", lambda self, trial: float(trial.number))


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self):
        return True


def test_a_bar_of_trials_is_shown_on_a_terminal_alone(run, quick, capsys, monkeypatch):
    run(*INIT)
    assert run(*RUN)[1] == ""
    assert "trial/s" not in capsys.readouterr().err
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert run("sweep", "run", *CHOSEN, "--max-total-trials", 4)[1] == ""
    last = terminal.getvalue().splitlines()[-1].split("\r")[-1]
    assert last.startswith("s: 100%") and " 4/4 " in last and last.strip().endswith("best 3.00 of trial 3]")
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    assert run("sweep", "run", *CHOSEN, "--n-trials", 3)[1] == ""
    assert " 3/3 " in terminal.getvalue()


def test_a_study_of_other_code_is_warned_of(run, quick, capsys):
    run(*INIT)
    main(list(map(str, RUN)))
    assert "Warning" not in capsys.readouterr().err
    load_study("x.log", "s").set_user_attr(CODE, {"version": "0.0.9", "commit": "abc"})
    main(["sweep", "run", *CHOSEN, "--max-total-trials", "3"])
    told = "Warning: study s was begun with sb3_bruno 0.0.9 at commit abc, and this is "
    assert told in capsys.readouterr().err and len(load_study("x.log", "s").trials) == 3


def test_an_id_with_its_package_is_searched(run, quick, tmp_path):
    printed, mistake = run(*INIT[:-3], "sb3_bruno_envs:PointDir-v0", *INIT[-2:])
    assert mistake == "" and "Made s in x.log" in printed
    settings = load_study("x.log", "s").user_attrs[SETTINGS]
    assert (settings["env"], settings["gym_packages"]) == ("PointDir-v0", ["sb3_bruno_envs"])
    assert run(*RUN)[1] == ""
    _, mistake = run(
        "sweep", "init", "--storage", "y.log", "--study-name", "s", "--env", "no_such:PointDir-v0", "-n", 9
    )
    assert mistake.startswith("sb3-bruno sweep: --gym-packages no_such cannot be imported: ")
    assert not (tmp_path / "y.log").exists()


@pytest.mark.parametrize("command", ["run", "status", "best", "export"])
@pytest.mark.parametrize("storage", ["x.log", "new/x.log"])
def test_no_file_is_made_for_a_study_that_is_not_there(command, storage, run, tmp_path):
    _, mistake = run("sweep", command, "--storage", storage, "--study-name", "s")
    told = f"no study s in {storage}, which is no file: make it with sb3-bruno sweep init"
    assert mistake == f"sb3-bruno sweep: {told}" and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (
            ["--n-jobs", 0],
            "--n-jobs 0: each `sweep run` is one worker, and you may start as many as you like",
        ),
        (["--n-jobs=4"], "--n-jobs=4: each `sweep run` is one worker"),
        (["--sampler", "cmaes"], "--sampler cmaes: a sweep draws by TPE"),
        (["--pruner", "none"], "--pruner none: a sweep prunes below the median"),
        (["--pruner"], "--pruner: a sweep prunes below the median"),
    ],
    ids=str,
)
def test_flags_of_other_searches_are_one_line_with_what_a_sweep_has_instead(arguments, told, run):
    mistake = run("sweep", "run", *CHOSEN, *arguments)[1]
    assert mistake.startswith(f"sb3-bruno sweep: {told}") and "\n" not in mistake


@pytest.mark.parametrize("text", ["__import__('pathlib').Path('pwned').touch()", "dict(a=open('pwned', 'w'))"])
def test_nothing_that_a_storage_holds_is_evaluated(text, run, quick, tmp_path):
    run(*INIT)
    study = load_study("x.log", "s")
    settings = study.user_attrs[SETTINGS]
    study.add_trial(optuna.create_trial(value=1.0))
    study.set_user_attr(SETTINGS, {**settings, "config": {**settings["config"], "policy_kwargs": text}})
    for command in ("run", "best"):
        mistake = run("sweep", command, *CHOSEN)[1]
        assert "is more than plain values" in mistake and "\n" not in mistake
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x.log"]


def test_a_storage_that_cannot_be_written_any_more_is_one_line(run, quick, monkeypatch):
    run(*INIT)

    def refuse(*arguments):
        raise PermissionError(13, "Permission denied", "x.log.lock")

    for function in ("create_new_trial", "set_trial_state_values"):
        with monkeypatch.context() as patch:
            patch.setattr(optuna.storages.JournalStorage, function, refuse)
            mistake = run(*RUN)[1]
        assert mistake.startswith("sb3-bruno sweep: --storage x.log is lost: [Errno 13] Permission denied")
        assert mistake.endswith(": start again when it can be read and written")


def test_an_export_of_a_study_with_odd_names(run, quick, tmp_path):
    name = "ü '\"%s/.."
    arguments = ["--storage", "a b/x y.log", "--study-name", name]
    assert run("sweep", "init", *arguments, "--env", "PointDir-v0", "-n", 120)[1] == ""
    assert run("sweep", "run", *arguments, "--n-trials", 1)[1] == ""
    printed, mistake = run("sweep", "status", *arguments)
    assert mistake == "" and f"{name}: 1 trials 1 complete" in printed
    np.testing.assert_equal(open_storage("a b/x y.log").get_all_studies()[0].study_name, name)

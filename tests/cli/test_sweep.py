"""Sweeps: workers share a study, may be killed at any moment, and no trial is lost or miscounted."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import optuna
import pandas as pd
import pytest
import yaml
from optuna.trial import TrialState
from torch import nn

import sb3_bruno.zoo.study
from sb3_bruno import BrunoEncoder
from sb3_bruno.cli.main import main
from sb3_bruno.zoo.registry import register
from sb3_bruno.zoo.sampler import NETS, SearchSpace
from sb3_bruno.zoo.study import SETTINGS, load_study, open_storage
from sb3_bruno.zoo.sweep import SweepExperiment
from sb3_bruno.zoo.work import PATIENCE
from sb3_bruno.zoo.workers import GIVEN_BACK, OWNER, SurplusTrial, give_back_surplus
from support.commands import ended, start

TINY = ["n_envs:2", "learning_starts:104", "encoder_learning_starts:104", "buffer_size:2000"]


@pytest.fixture(autouse=True, scope="module")
def registered():
    """Our algorithms, environments and search space, as the command line registers them."""
    register()


@pytest.fixture(params=["journal", "postgres"])
def storage(request, tmp_path, monkeypatch):
    if request.param == "journal":
        return str(tmp_path / "sweep.log")
    return request.getfixturevalue("postgres")


def init(storage, name, *arguments):
    command = ["sweep", "init", "--storage", storage, "--study-name", name, "--env", "PointDir-v0", "-n", "120"]
    main([*command, "--n-evaluations", "2", *arguments, "-params", *TINY])


def worker(storage, name, total, prepare):
    flags = ["--storage", storage, "--study-name", name, "--max-total-trials", total]
    return start("sweep", "run", *flags, prepare=prepare)


def beat_fast():
    """Be a worker whose heart beats every second, and whose trials take one more than they need."""
    plain, plain_open = SweepExperiment.objective, sb3_bruno.zoo.study.open_storage
    SweepExperiment.objective = lambda self, trial: (plain(self, trial), time.sleep(1))[0]
    sb3_bruno.zoo.study.open_storage = lambda storage: plain_open(storage, heartbeat=1)


def ask_together():
    """Be a worker that asks for a trial only when another does, too: both have counted the trials before that."""
    plain = optuna.Study.ask

    def wait_and_ask(self, *args, **kwargs):
        Path(f"asks-{os.getpid()}").touch()
        while len(list(Path().glob("asks-*"))) < 2:
            time.sleep(0.01)
        return plain(self, *args, **kwargs)

    optuna.Study.ask = wait_and_ask


def test_two_workers_one_killed_and_every_trial_is_accounted_for(storage, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    name = f"two-{os.getpid()}"
    init(storage, name)
    first, second = (worker(storage, name, 4, beat_fast) for _ in range(2))
    found = optuna.load_study(study_name=name, storage=open_storage(storage))
    killed = wait_for_a_trial_of(first.pid, found)
    first.kill()
    assert ended(first) == -signal.SIGKILL and ended(second) == 0
    assert ended(worker(storage, name, 4, beat_fast)) == 0  # who comes later finds what was lost in the meantime

    trials = found.get_trials()
    states = [trial.state for trial in trials]
    assert not {TrialState.RUNNING, TrialState.WAITING} & set(states)
    assert trials[killed].state == TrialState.FAIL and states.count(TrialState.FAIL) == 1
    again = [trial for trial in trials if trial.system_attrs.get("failed_trial") == killed]
    assert len(again) == 1 and again[0].params == trials[killed].params
    assert states.count(TrialState.COMPLETE) + states.count(TrialState.PRUNED) >= 4

    main(["sweep", "status", "--storage", storage, "--study-name", name])
    assert "1 fail" in capsys.readouterr().out
    main(["sweep", "best", "--storage", storage, "--study-name", name])
    main(["train", "--env", "PointDir-v0", "-conf", "best.yml", "-n", "120", "--eval-freq", "-1"])
    assert (tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1" / "PointDir-v0.zip").is_file()


def wait_for_a_trial_of(pid, found):
    """The number of a trial that trains in process ``pid``, its hyperparameters drawn."""
    for _ in range(2_000):
        for trial in found.get_trials(states=[TrialState.RUNNING]):
            has_drawn = "encoder_update_ratio_pow" in trial.params  # the last to be drawn
            if has_drawn and trial.user_attrs.get(OWNER, {}).get("pid") == pid:
                return trial.number
        time.sleep(0.1)
    raise AssertionError("the worker never began")


def test_of_two_workers_that_race_for_the_last_trial_one_gives_its_own_back(storage, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    name = f"race-{os.getpid()}"
    init(storage, name)
    workers = [worker(storage, name, 1, ask_together) for _ in range(2)]
    assert [ended(process) for process in workers] == [0, 0]
    first, second = optuna.load_study(study_name=name, storage=open_storage(storage)).trials
    assert first.state == TrialState.COMPLETE and GIVEN_BACK not in first.user_attrs
    assert second.state == TrialState.FAIL and GIVEN_BACK in second.user_attrs and second.params == {}
    main(["sweep", "status", "--storage", storage, "--study-name", name])
    assert "2 trials 1 complete, 1 given back" in capsys.readouterr().out


def test_a_trial_that_was_queued_again_keeps_its_place(storage, tmp_path):
    study = optuna.create_study(study_name=f"place-{tmp_path}", storage=open_storage(storage))
    first, lost, third = (study.ask() for _ in range(3))
    for trial in (first, lost, third):
        give_back_surplus(trial, 3)
    study.tell(lost, state=TrialState.FAIL)
    made_in_the_gap = study.ask()  # by a worker that looked before the lost trial was queued again
    study.enqueue_trial({})
    give_back_surplus(made_in_the_gap, 3)
    queued = study.ask()
    with pytest.raises(SurplusTrial, match="4 is one more than 3"):
        give_back_surplus(queued, 3)
    study.tell(queued, state=TrialState.FAIL)
    study.tell(third, state=TrialState.FAIL)  # an error: its place is free
    study.enqueue_trial({})
    study.add_trial(optuna.create_trial(state=TrialState.RUNNING))  # by a worker that looked before that
    late = optuna.Trial(study, study.trials[-1]._trial_id)
    with pytest.raises(SurplusTrial, match="6 is one more than 3"):
        give_back_surplus(late, 3)  # the waiting trial comes first, though it does not run yet
    study.tell(late, state=TrialState.FAIL)
    give_back_surplus(study.ask(), 3)


def test_a_worker_stops_after_its_own_number_of_trials(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    init("x.log", "s", "--n-evaluations", "1")
    run = ["sweep", "run", "--storage", "x.log", "--study-name", "s", "--n-trials"]
    for n_trials, total in ((1, 1), (2, 3)):
        main([*run, str(n_trials)])
        trials = load_study("x.log", "s").trials
        assert len(trials) == total and all(trial.state.is_finished() for trial in trials)
    main([*run, "5", "--max-total-trials", "4"])  # whichever comes first
    assert len(load_study("x.log", "s").trials) == 4
    main(["sweep", "export", "--storage", "x.log", "--study-name", "s"])
    table = pd.read_csv("trials.csv")
    assert table["number"].tolist() == [0, 1, 2, 3] and table["params_net"].isin(NETS).all()
    np.testing.assert_allclose(table["value"], [trial.value for trial in load_study("x.log", "s").trials])


@pytest.mark.parametrize("algo", ["sac", "td3"])
def test_a_search_space_of_rl_zoos_own_is_searched_too(algo, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    chosen = ["--storage", "x.log", "--study-name", "s"]
    small = ["n_envs:1", "learning_starts:100", "buffer_size:2000"]
    env = ["--algo", algo, "--env", "Pendulum-v1", "-n", "120"]
    main(["sweep", "init", *chosen, *env, "--n-evaluations", "1", "-params", *small])
    load_study("x.log", "s").enqueue_trial({"batch_size_pow": 4, "noise_type": None} if algo == "td3" else {})
    main(["sweep", "run", *chosen, "--max-total-trials", "1"])
    main(["sweep", "best", *chosen])
    main(["train", *env, "-conf", "best.yml", "--eval-freq", "-1"])
    assert (tmp_path / "logs" / algo / "Pendulum-v1_1" / "Pendulum-v1.zip").is_file()


def test_the_best_config_is_what_its_trial_trained_with(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = "dict(activation_fn=nn.ELU, net_arch=[8])"  # as rl_zoo3's own configs have it
    init("x.log", "s")
    study = load_study("x.log", "s")
    settings = study.user_attrs[SETTINGS]
    study.set_user_attr(SETTINGS, {**settings, "config": {**settings["config"], "policy_kwargs": text}})
    trial = study.ask()
    space = SearchSpace(BrunoEncoder)
    space.sample(trial, 2, 2, {})
    study.tell(trial, 1.0)
    main(["sweep", "best", "--storage", "x.log", "--study-name", "s"])
    config = yaml.safe_load((tmp_path / "best.yml").read_text())["PointDir-v0"]
    drawn = space.convert(trial.params)
    assert eval(config["policy_kwargs"], {"nn": nn}) == {"activation_fn": nn.ELU, **drawn["policy_kwargs"]}
    assert config["gamma"] == drawn["gamma"]


def test_a_worker_gives_up_when_every_trial_fails(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    init("x.log", "s")
    plain, tried = SweepExperiment.objective, []

    def fail(self, trial):
        tried.append(trial.number)
        if len(tried) == 3:
            return plain(self, trial)
        raise RuntimeError("no disk")

    monkeypatch.setattr(SweepExperiment, "objective", fail)
    with pytest.raises(SystemExit, match=f"{PATIENCE} trials failed one after another"):
        main(["sweep", "run", "--storage", "x.log", "--study-name", "s"])
    assert len(tried) == 3 + PATIENCE
    assert "1 complete" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["init", "--storage", "sqlite:///x.db", "-n", "900"], "give a journal file"),
        (["init", "--storage", "x.log", "-n", "9", "--env", "Nope-v0"], "--env Nope-v0 is not registered"),
        (["init", "--storage", "x.log", "-n", "9", "--env", "PointDir-v0", "-params", "gama:1"], "gama"),
        (["run", "--storage", "x.log"], "no study s in x.log"),
        (["best", "--storage", "x.log"], "no study s in x.log"),
    ],
    ids=str,
)
def test_a_mistake_is_one_line(arguments, line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=line):
        main(["sweep", *arguments, "--study-name", "s"])


def test_a_study_is_made_once(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    init("x.log", "s")
    assert load_study("x.log", "s").user_attrs["settings"]["n_timesteps"] == 120
    with pytest.raises(SystemExit, match="has a study s"):
        init("x.log", "s")

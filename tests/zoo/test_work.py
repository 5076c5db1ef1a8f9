"""A worker loses no trial and is not killed by one that it loses."""

import platform

import optuna
import pytest
from optuna.trial import TrialState

from sb3_bruno.zoo.database import RETRIES
from sb3_bruno.zoo.storage import open_storage
from sb3_bruno.zoo.work import PATIENCE, GaveUp, run_trial, work
from sb3_bruno.zoo.workers import OWNER, requeue_lost_trials


@pytest.fixture
def study(tmp_path):
    return optuna.create_study(study_name="s", storage=open_storage(str(tmp_path / "x.log")), direction="maximize")


@pytest.fixture
def another(study, tmp_path):
    """The study, as another worker has it."""
    return optuna.load_study(study_name="s", storage=open_storage(str(tmp_path / "x.log")))


def states(study):
    return [trial.state.name.lower() for trial in study.trials]


@pytest.mark.parametrize("then", ["returns", "reports", "signs", "raises", "prunes"])
@pytest.mark.parametrize("told", [TrialState.FAIL, TrialState.COMPLETE, TrialState.PRUNED], ids=lambda s: s.name)
def test_a_trial_that_another_finished_does_not_kill_its_worker(told, then, study, another, capsys):
    def objective(trial):
        if trial.number > 0:
            return 1.0
        another.tell(0, 0.5 if told == TrialState.COMPLETE else None, state=told)
        if then == "reports":
            trial.report(0.0, 1)
        if then == "signs":
            trial.set_user_attr("a", 1)
        if then in ("raises", "prunes"):
            raise optuna.TrialPruned if then == "prunes" else RuntimeError("late")
        return 2.0

    work(study, objective, n_trials=2)
    assert states(study) == [told.name.lower(), "complete"] and study.trials[1].value == 1.0
    assert "Trial 0 was taken from this worker" in capsys.readouterr().out


def test_trials_that_were_taken_away_are_no_failures(study, another):
    def objective(trial):
        another.tell(trial.number, state=TrialState.FAIL)
        return 1.0

    work(study, objective, n_trials=PATIENCE + 1)
    assert len(study.trials) == PATIENCE + 1


def test_a_worker_gives_up_after_failures_in_a_row(study):
    def objective(trial):
        if trial.number == 2:
            return 1.0
        raise RuntimeError("no disk")

    with pytest.raises(GaveUp, match=f"{PATIENCE} trials failed one after another"):
        work(study, objective)
    assert states(study) == ["fail", "fail", "complete", *["fail"] * PATIENCE]


def test_what_the_storage_raises_is_not_taken_for_a_lost_trial(study, monkeypatch):
    def refuse(*arguments):
        raise OSError("read-only")

    def objective(trial):
        monkeypatch.setattr(study._storage, "set_trial_state_values", refuse)
        return 1.0

    with pytest.raises(OSError, match="read-only"):
        run_trial(study, objective)


def test_an_interrupted_trial_is_queued_again(study):
    def objective(trial):
        trial.suggest_float("x", 0, 1)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        work(study, objective)
    assert states(study) == ["fail", "waiting"] and study.trials[1].params == study.trials[0].params


def test_the_trial_of_a_dead_worker_is_queued_again_three_times(study):
    gone = {"host": platform.node(), "pid": 2**22 + 1, "started": "boot 1"}  # no such number
    for attempt in range(RETRIES + 1):
        trial = study.ask()
        trial.suggest_float("x", 0, 1)
        trial.set_user_attr(OWNER, gone)
        assert requeue_lost_trials(study) == [attempt]
        assert requeue_lost_trials(study) == []
    assert states(study) == ["fail"] * (RETRIES + 1)
    assert len({trial.params["x"] for trial in study.trials}) == 1

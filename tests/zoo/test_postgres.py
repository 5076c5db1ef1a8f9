"""A PostgreSQL server may restart, and a worker may die before its heart first beats: no trial is lost for good."""

import itertools
import threading
from datetime import datetime, timedelta
from types import SimpleNamespace

import optuna
import psycopg
import pytest
from optuna.storages._rdb.models import TrialModel
from sqlalchemy import event

from sb3_bruno.zoo import database
from sb3_bruno.zoo.storage import open_storage
from sb3_bruno.zoo.study import create_study, load_study
from sb3_bruno.zoo.work import work
from sb3_bruno.zoo.workers import requeue_lost_trials

pytestmark = pytest.mark.filterwarnings("ignore:Heartbeat of storage is supposed to be used with Study.optimize")


@pytest.fixture
def study(postgres, tmp_path):
    return optuna.create_study(study_name=str(tmp_path), storage=open_storage(postgres), direction="maximize")


def states(study):
    return [trial.state.name.lower() for trial in study.get_trials()]


def began(study, trial, seconds):
    """Let a trial have begun so many seconds from now."""
    with study._storage._backend.scoped_session() as session:
        session.get(TrialModel, trial._trial_id).datetime_start = datetime.now() + timedelta(seconds=seconds)
        session.commit()


def test_a_worker_that_died_before_its_first_heartbeat_leaves_no_trial_running(study):
    lost, ahead, young, beats = (study.ask() for _ in range(4))
    study._storage.record_heartbeat(beats._trial_id)
    for trial, seconds in ((lost, -150), (ahead, 150), (young, -90), (beats, -150)):  # ahead: of a clock that is
        began(study, trial, seconds)
    assert sorted(requeue_lost_trials(study)) == [0, 1]
    assert requeue_lost_trials(study) == []
    assert states(study) == ["fail", "fail", "running", "running", "waiting", "waiting"]
    work(study, lambda trial: 1.0, max_total=4)
    assert states(study) == ["fail", "fail", "running", "running", "complete", "complete"]


def test_a_trial_of_another_study_is_left_alone(study, postgres, tmp_path):
    other = optuna.create_study(study_name=f"{tmp_path}/2", storage=open_storage(postgres))
    began(other, other.ask(), -150)
    assert requeue_lost_trials(study) == [] and states(other) == ["running"]


def test_a_trial_that_another_worker_took_does_not_kill_its_worker(study, postgres):
    another = optuna.load_study(study_name=study.study_name, storage=open_storage(postgres))

    def objective(trial):
        if trial.number == 0:
            another.tell(0, state=optuna.trial.TrialState.FAIL)
            trial.report(1.0, 1)
        return 1.0

    work(study, objective, n_trials=2)
    assert states(study) == ["fail", "complete"]


def test_a_restart_of_the_server_fails_no_trial(study, postgres_server):
    def objective(trial):
        postgres_server.stop()
        restart = threading.Timer(1.0, postgres_server.start)
        if trial.number == 0:  # it is back before the worker needs it
            restart.run()
        else:
            restart.start()  # the worker waits for it
        trial.report(1.0, 1)
        return 1.0

    work(study, objective, n_trials=2)
    assert states(study) == ["complete", "complete"]


def test_a_heartbeat_that_the_server_does_not_take_is_not_the_last(study):
    def refuse(dialect, record, address, options):
        raise dialect.loaded_dbapi.OperationalError("stopped")

    kept_in = study._storage._backend
    trial = study.ask()
    kept_in.engine.dispose()
    event.listen(kept_in.engine, "do_connect", refuse, insert=True)
    kept_in.record_heartbeat(trial._trial_id)
    event.remove(kept_in.engine, "do_connect", refuse)
    kept_in.record_heartbeat(trial._trial_id)
    began(study, trial, -150)
    assert requeue_lost_trials(study) == []


def test_a_server_that_stays_away_is_told(monkeypatch):
    ticks = itertools.count()
    monkeypatch.setattr(database, "time", SimpleNamespace(monotonic=lambda: next(ticks), sleep=lambda seconds: None))
    dialect = SimpleNamespace(loaded_dbapi=psycopg, connect=psycopg.connect)
    with pytest.raises(psycopg.OperationalError):
        database.connect_patiently(dialect, None, ("host=localhost port=1",), {})
    assert next(ticks) > database.RESTART


def test_a_study_in_a_database_is_told_with_those_there(postgres, tmp_path):
    settings = {"algo": "bruno_sac", "env": "PointDir-v0", "config": {}, "n_timesteps": 9}
    settings |= {"n_evaluations": 2, "n_startup_trials": 2, "seed": 0}
    name = f"{tmp_path}/'\"; DROP TABLE trials; --%s"
    create_study(postgres, name, settings)
    assert load_study(postgres, name).user_attrs["settings"] == settings
    with pytest.raises(ValueError, match=r"no study nothing in postgresql.*It has .*DROP TABLE"):
        load_study(postgres, "nothing")

"""RL Zoo's own search, ``train -optimize`` and ``--trial-id``, with our algorithms."""

import argparse

import gymnasium as gym
import numpy as np
import optuna
import pandas as pd
import pytest
import yaml
from gymnasium.wrappers import TimeLimit

from sb3_bruno import BrunoEncoder
from sb3_bruno.cli.main import main
from sb3_bruno.zoo.configs import config_file, read_configs
from sb3_bruno.zoo.experiment import TaskExperiment
from sb3_bruno.zoo.registry import register
from sb3_bruno.zoo.sampler import SearchSpace
from sb3_bruno.zoo.saved_yaml import read_saved
from sb3_bruno.zoo.search import begin_or_join
from sb3_bruno.zoo.storage import open_storage
from sb3_bruno_envs import MetaTask, PointDirEnv, TransitionObservation

STUDY = ["--storage", "demo.log", "--study-name", "demo"]
OURS = ["train", "--algo", "bruno_sac", "--env", "PointDir-v0", "-n", "120", "--seed", "1"]
TINY = ["n_envs:2", "learning_starts:100", "buffer_size:2000"]


def searching(env, algo="bruno_sac", **arguments):
    """The experiment that ``train -optimize`` makes, ready to search."""
    register()
    args = argparse.Namespace()
    experiment = TaskExperiment(args, algo, env, "logs", optimize_hyperparameters=True, seed=0, verbose=0, **arguments)
    assert experiment.setup_experiment() is None
    return experiment


def test_a_search_of_rl_zoo_and_a_training_with_what_it_found(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    search = ["--n-trials", "2", "--n-evaluations", "2", "--no-optim-plots", "-optimize"]
    main([*OURS, *STUDY, *search, "--optimization-log-path", "trials", "-params", *TINY])
    study = optuna.load_study(study_name="demo", storage=open_storage("demo.log"))
    assert len(study.trials) == 2 and (tmp_path / "trials" / "trial_1" / "evaluations.npz").is_file()
    (report,) = (tmp_path / "logs" / "bruno_sac").glob("report_*.csv")
    assert len(pd.read_csv(report)) == 2

    main([*OURS, *STUDY, "--trial-id", "0", "--eval-freq", "-1", "-params", *TINY, "gamma:0.5"])
    (run,) = (tmp_path / "logs" / "bruno_sac").glob("*/PointDir-v0/config.yml")
    used = dict(read_saved(run))
    config = read_configs(config_file("bruno_sac"))["PointDir-v0"]
    drawn = SearchSpace(BrunoEncoder).convert({**study.trials[0].params, "n_envs": 2})
    assert used["gamma"] == 0.5  # -params goes over the trial
    assert used["gradient_steps"] == drawn["gradient_steps"]
    assert used["encoder_kwargs"] == config["encoder_kwargs"] | drawn["encoder_kwargs"]
    assert used["replay_buffer_kwargs"] == config["replay_buffer_kwargs"] | drawn["replay_buffer_kwargs"]


@pytest.mark.mujoco
def test_trials_are_judged_on_held_out_training_tasks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    experiment = searching("CheetahVel-v0", n_eval_envs=2)
    learned = experiment.create_envs(2).get_attr("task_distribution")[0].tasks("train")
    judge = experiment.create_envs(1, eval_env=True)
    judged = judge.get_attr("task_distribution")[0].tasks("train")
    assert (len(learned), len(judged), experiment.n_eval_episodes) == (80, 20, 40)
    assert not set(learned.ravel()) & set(judged.ravel())
    met = []
    for _ in judged:
        judge.reset()
        met.append(judge.reset_infos[0]["task"])
    np.testing.assert_array_equal(met, judged)
    assert experiment.seed == 0


def test_what_is_drawn_leaves_the_rest_of_a_dict_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    experiment = searching("CheetahParams-v0")
    before = dict(experiment._hyperparams)
    trial = experiment._hyperparams.copy()
    trial.update({"encoder_kwargs": {"n_weights": 3}, "gamma": 0.9})
    assert trial["encoder_kwargs"] == {"modelled": "next_observations", "n_weights": 3} and trial["gamma"] == 0.9
    assert experiment._hyperparams == before


def test_an_env_without_tasks_is_searched_as_rl_zoo_does(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    experiment = searching("Pendulum-v1", "sac", n_eval_episodes=3)
    assert experiment.n_eval_episodes == 3 and experiment.create_envs(1, eval_env=True).num_envs == 1


def make_directions(n_tasks):
    """An environment of somebody else's: its function takes neither ``tasks`` nor ``draw``."""
    angles = np.linspace(0.0, 2.0 * np.pi, n_tasks, endpoint=False)
    tasks = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return TransitionObservation(MetaTask(TimeLimit(PointDirEnv(), 5), PointDirEnv.set_task, tasks))


@pytest.mark.parametrize("n_tasks", [4, 12])
def test_an_env_that_is_not_ours_is_judged_as_it_is(n_tasks, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    gym.register("Directions-v0", make_directions, kwargs={"n_tasks": n_tasks})
    try:
        config = {"policy": "MlpPolicy", "n_timesteps": 120, "buffer_size": 2_000}
        (tmp_path / "own.yml").write_text(yaml.safe_dump({"Directions-v0": config}))
        experiment = searching("Directions-v0", config="own.yml", n_eval_episodes=5)
        first, judged = experiment.create_envs(1), experiment.create_envs(1, eval_env=True)
        assert experiment.n_eval_episodes == 5
        assert len(judged.get_attr("task_distribution")[0].tasks("train")) == n_tasks
        assert not np.array_equal(first.reset()["observation"], judged.reset()["observation"])  # fresh seeds
    finally:
        del gym.registry["Directions-v0"]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--trial-id", "1"], "give its --storage and --study-name"),
        ([*STUDY, "--trial-id", "1"], "--storage demo.log is no file: give the one of the search"),
        ([*STUDY, "-optimize", "--storage", "demo"], "--storage demo: give a journal file"),
    ],
    ids=["no study", "no such file", "no storage"],
)
def test_a_mistake_is_one_line(arguments, line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=line):
        main([*OURS, *arguments])
    assert not (tmp_path / "logs").exists() and not (tmp_path / "demo.log").exists()


def test_a_trial_that_is_not_there_or_whole_is_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study = optuna.create_study(study_name="demo", storage=open_storage("demo.log"))
    study.ask()
    for trial in ("0", "1"):
        with pytest.raises(SystemExit, match=f"--trial-id {trial}: demo in demo.log has no such trial"):
            main([*OURS, *STUDY, "--trial-id", trial])
    journal = tmp_path / "demo.log"
    whole = journal.read_bytes()
    journal.write_bytes(whole + b'{"op_c')
    with pytest.raises(SystemExit, match=r"--trial-id 1: demo in demo.log has no such trial"):
        main([*OURS, *STUDY, "--trial-id", "1"])
    assert journal.read_bytes() == whole
    journal.write_bytes(b"damage\n" + whole)
    for command in (["--trial-id", "1"], ["-optimize"]):
        with pytest.raises(SystemExit, match=r"--storage demo.log cannot be opened: it is no journal"):
            main([*OURS, *STUDY, *command])


@pytest.mark.parametrize("changed", [["--env", "PointGoal-v0", "-conf", "own.yml"], ["--algo", "bruno_td3"]], ids=str)
def test_a_study_of_another_search_is_not_mixed_with_this_one(changed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.yml").write_text(yaml.safe_dump({"PointGoal-v0": {"policy": "MlpPolicy", "n_timesteps": 120}}))
    begin_or_join("demo.log", "demo", "bruno_sac", "PointDir-v0")
    begin_or_join("demo.log", "demo", "bruno_sac", "PointDir-v0")
    line = r"--study-name demo in demo.log searches for bruno_sac on PointDir-v0, not .*: name another"
    with pytest.raises(SystemExit, match=line):
        main([*OURS, *STUDY, "-optimize", *changed])
    assert not list(tmp_path.glob("logs/*/*"))


def test_a_sweep_is_not_gone_on_with_by_rl_zoos_search(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    main(["sweep", "init", *STUDY, "--env", "PointDir-v0", "-n", "120"])
    with pytest.raises(SystemExit, match=r"--study-name demo in demo.log is a sweep: go on with sb3-bruno sweep run"):
        main([*OURS, *STUDY, "-optimize"])
    with pytest.raises(SystemExit, match=r"demo.log has a study demo: choose another --study-name"):
        main(["sweep", "init", *STUDY, "--algo", "bruno_td3", "--env", "PointDir-v0", "-n", "120"])

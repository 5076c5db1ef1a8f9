"""What a sweep rests on: how a trial is judged, pruned and drawn, and when its worker is gone."""

import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import optuna
import pytest
import yaml
from optuna.trial import TrialState

from sb3_bruno import BrunoSAC
from sb3_bruno.encoders import (
    BrunoEncoder,
    MeanEmbedding,
    ProductOfGaussians,
    RecurrentEncoder,
    SplitAggregator,
    find_encoder,
)
from sb3_bruno.zoo.configs import config_file, merged
from sb3_bruno.zoo.held_out import hold_out, listed_tasks
from sb3_bruno.zoo.processes import is_gone, this_process
from sb3_bruno.zoo.registry import ALGORITHMS, converter_of, register, sampler_of, search_space_of
from sb3_bruno.zoo.sampler import SearchSpace
from sb3_bruno.zoo.study import create_study, load_study
from sb3_bruno.zoo.sweep import SweepExperiment
from sb3_bruno_envs import Family, PointDirEnv, TaskSampler, TaskSet, register_family


@pytest.fixture(autouse=True, scope="module")
def registered():
    """Our algorithms, environments and search space, as the command line registers them."""
    register()


def settings(env="PointDir-v0", algo="bruno_sac", **config):
    base = yaml.safe_load(Path(config_file(algo)).read_text())[env]
    return {
        "algo": algo,
        "env": env,
        "config": {**base, "n_envs": 2, "learning_starts": 60, "buffer_size": 2_000, **config},
        "n_timesteps": 120,
        "n_evaluations": 2,
        "n_startup_trials": 2,
        "seed": 0,
    }


def test_no_trial_is_pruned_in_its_first_third(tmp_path):
    storage = str(tmp_path / "sweep.log")
    create_study(storage, "third", {**settings(), "n_evaluations": 6})
    study = load_study(storage, "third")
    for _ in range(2):
        good = study.ask()
        for evaluation in range(1, 7):
            good.report(1.0, evaluation)
        study.tell(good, 1.0)
    bad = study.ask()
    pruned = []
    for evaluation in range(1, 4):
        bad.report(0.0, evaluation)
        pruned.append(bad.should_prune())
    assert pruned == [False, False, True]


def test_a_trial_is_judged_on_held_out_training_tasks():
    experiment = SweepExperiment(settings("CheetahVel-v0"))
    train = experiment.create_envs(2).get_attr("task_distribution")[0].tasks("train")
    judged = experiment.create_envs(1, eval_env=True).get_attr("task_distribution")[0].tasks("train")
    assert (len(train), len(judged), experiment.n_eval_episodes) == (80, 20, 20)
    assert not set(train.ravel()) & set(judged.ravel())


def test_few_tasks_are_judged_with_fresh_seeds():
    experiment = SweepExperiment(settings())
    first, judged = experiment.create_envs(2), experiment.create_envs(1, eval_env=True)
    assert experiment.n_eval_episodes == 10  # five times both directions
    assert not np.array_equal(first.reset()["observation"][0], judged.reset()["observation"][0])
    assert experiment.seed == 0


@pytest.mark.parametrize(("given", "has_readout"), [({}, False), ({"task_readout": True}, True)])
def test_a_trial_trains_no_read_out_that_nobody_asked_for(monkeypatch, given, has_readout):
    found = []
    monkeypatch.setattr(BrunoSAC, "learn", lambda self, *_: found.append(self.policy.readout is not None) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        SweepExperiment(settings(**given)).objective(optuna.create_study().ask())
    assert found == [has_readout]


def test_an_error_of_a_trial_is_no_pruned_trial():
    study = optuna.create_study()
    experiment = SweepExperiment(settings())
    experiment._hyperparams["batch_size"] = 64
    experiment._hyperparams["critic_input"] = "nothing"  # a ValueError, which rl_zoo3 would count as pruned
    study.optimize(experiment.objective, n_trials=1, catch=(Exception,))
    assert [trial.state for trial in study.trials] == [TrialState.FAIL]


@pytest.mark.parametrize("algorithm", ALGORITHMS.values())
def test_drawn_values_are_those_that_parameters_convert_to_and_build_a_model(algorithm):
    space = SearchSpace(find_encoder(algorithm.default_encoder))
    trial = optuna.create_study().ask()
    drawn = space.sample(trial, 2, 10, {})
    assert space.convert({**trial.params, "n_envs": 10}) == drawn
    assert drawn["gradient_steps"] >= 1
    assert yaml.safe_load(yaml.safe_dump(drawn)) == drawn
    algorithm("MlpPolicy", "PointDir-v0", **drawn)


def test_the_space_is_that_of_the_encoder_that_the_config_chooses():
    config = {"encoder_class": "recurrent"}
    trial = optuna.create_study().ask()
    drawn = sampler_of("bruno_sac", config)(trial, 2, 10, {})
    assert drawn["encoder_kwargs"].keys() == RecurrentEncoder.search_space.keys()
    assert converter_of("bruno_sac", config)({**trial.params, "n_envs": 10}) == drawn


def test_a_value_that_the_encoder_refuses_beside_the_config_is_not_drawn():
    trial = optuna.create_study().ask()
    SearchSpace(BrunoEncoder, {"process": "gaussian", "flow_class": "paper_maf", "extra_dims": 1}).sample(
        trial, 2, 10, {}
    )
    assert trial.distributions["process"].choices == ("gaussian",)
    assert trial.distributions["n_weights"].choices == BrunoEncoder.search_space["n_weights"]


ABLATIONS = [
    ("varibad_sac", {"encoder_kwargs": {"learns_from": "critic"}}),
    ("varibad_sac", {"encoder_kwargs": {"learns_from": "actor"}}),
    ("bruno_sac", {"encoder_class": "mean_embedding", "encoder_kwargs": {"learns_from": "critic"}}),
    ("bruno_td3", {"encoder_class": "mean_embedding", "encoder_kwargs": {"learns_from": "actor"}}),
    ("pearl_sac", {"encoder_kwargs": {"information_bottleneck": False}}),
    ("pearl_sac", {"encoder_kwargs": {"belief": "sample"}}),
    ("bruno_sac", {"encoder_class": "split_aggregator", "encoder_kwargs": {"rnn": False}}),
    ("belief_sac", {"encoder_kwargs": {"head": "mixture"}}),
    ("bruno_crossq", {"encoder_kwargs": {"process": "gaussian", "extra_dims": 2}}),
]


@pytest.mark.parametrize(("algo", "config"), ABLATIONS, ids=str)
def test_what_is_drawn_suits_the_encoder_that_the_config_makes(algo, config):
    trial = optuna.create_study().ask()
    drawn = sampler_of(algo, config)(trial, 2, 10, {})
    assert converter_of(algo, config)({**trial.params, "n_envs": 10}) == drawn
    model = ALGORITHMS[algo]("MlpPolicy", "PointDir-v0", **merged(config, drawn))
    assert ("encoder_update_ratio" in drawn) == (model.encoder.learns_from == "own")
    assert ("context" in trial.params) == (model.encoder.order == "any")


def test_an_argument_of_which_the_encoder_takes_no_value_is_not_drawn():
    space = search_space_of("pearl_sac", {"encoder_kwargs": {"information_bottleneck": False}})
    assert space.searched.keys() == ProductOfGaussians.search_space.keys() - {"kl_weight"}
    wrong = search_space_of("pearl_sac", {"encoder_kwargs": {"latent_dim": 0, "belief": "none"}})
    assert wrong.searched == ProductOfGaussians.search_space  # so that each trial tells what is wrong


def test_of_a_range_only_the_integers_are_drawn_that_the_encoder_takes():
    even = type("Ours", (SplitAggregator,), {"search_space": {"hidden_size": range(8, 14)}})
    assert SearchSpace(even).searched == {"hidden_size": [8, 10, 12]}
    assert SearchSpace(even, {"rnn": False}).searched == {"hidden_size": range(8, 14)}


@pytest.mark.parametrize(("teacher", "order"), [("own", "any"), ("critic", "time")])
def test_what_is_drawn_may_itself_change_whom_the_encoder_learns_from_and_how_it_reads(teacher, order):
    embedding = type("Ours", (MeanEmbedding,), {"search_space": {"learns_from": [teacher]}})
    trial = optuna.create_study().ask()
    assert ("encoder_update_ratio" in SearchSpace(embedding).sample(trial, 2, 10, {})) == (teacher == "own")
    reader = type("Ours", (SplitAggregator,), {"search_space": {"rnn": [order == "time"]}})
    trial = optuna.create_study().ask()
    assert ("replay_buffer_kwargs" in SearchSpace(reader).sample(trial, 2, 10, {})) == (order == "any")


@pytest.fixture
def drift():
    """An environment of somebody else's family: twelve training tasks and three test tasks."""
    angles = np.linspace(0.0, np.pi, 12)
    tasks = TaskSet(np.stack([np.cos(angles), np.sin(angles)], axis=1), [[0.6, 0.8], [-0.6, 0.8], [0.0, -1.0]])
    register_family("Drift-v0", Family(PointDirEnv, tasks, max_episode_steps=5))
    yield "Drift-v0"
    del gym.registry["Drift-v0"]


def test_the_tasks_of_anybodys_family_are_listed_and_held_out(drift):
    assert listed_tasks(drift, {}, "test").shape == (3, 2)
    held_out = hold_out(drift, {})
    assert (held_out.train["tasks"].shape, held_out.judge["tasks"].shape, held_out.n_tasks) == ((10, 2), (2, 2), 2)


@pytest.mark.parametrize(
    ("name", "env_kwargs", "n_train", "n_judge"),
    [
        ("PointGoal-v0", {"dim": 2}, 80, 20),
        ("PointGoal-v0", {"dim": 2, "tasks": "pearl"}, 64, 16),
        pytest.param("CheetahVel-v0", {"tasks": "tavt"}, 80, 20, marks=pytest.mark.mujoco),
    ],
)
def test_the_tasks_of_a_named_set_are_held_out_within_its_box(name, env_kwargs, n_train, n_judge):
    env_id = f"sb3_bruno_envs:{name}"
    whole, held_out = gym.make(env_id, **env_kwargs), hold_out(name, env_kwargs)
    for kwargs, n in ((held_out.train, n_train), (held_out.judge, n_judge)):
        part = gym.make(env_id, **kwargs)
        assert len(part.get_wrapper_attr("task_distribution").tasks("train")) == n
        assert part.get_wrapper_attr("task_space") == whole.get_wrapper_attr("task_space")


def test_an_env_without_a_list_of_tasks_has_none(drift):
    endless = TaskSampler(lambda rng: rng.uniform(-1, 1, size=2), space=gym.spaces.Box(-1, 1, (2,)))
    register_family("Endless-v0", Family(PointDirEnv, endless, max_episode_steps=5))
    try:
        assert len(listed_tasks("Endless-v0", {}, "test")) == 0
    finally:
        del gym.registry["Endless-v0"]
    assert len(listed_tasks("Pendulum-v1", {}, "test")) == 0


def test_an_integer_of_a_search_space_is_drawn_as_one():
    encoder = type("Ours", (RecurrentEncoder,), {"search_space": {"hidden_size": range(8, 33, 8)}})
    trial = optuna.create_study().ask()
    SearchSpace(encoder).sample(trial, 2, 10, {})
    found = trial.distributions["hidden_size"]
    assert (found.low, found.high, found.step) == (8, 32, 8)


def test_a_process_that_ended_is_gone_and_this_one_is_not():
    assert not is_gone(this_process())
    process = subprocess.Popen([sys.executable, "-c", ""])
    owner = {**this_process(), "pid": process.pid}
    process.wait()
    assert is_gone(owner)
    assert is_gone({**this_process(), "started": "another time"})  # another process had this number
    assert not is_gone({**owner, "host": "elsewhere"})

"""Any encoder in any algorithm by one word: what a config says for its own encoder is left out, and nothing else."""

import argparse

import optuna
import pytest
import yaml

from sb3_bruno.encoders import ENCODERS, find_encoder
from sb3_bruno.zoo.another_encoder import OF_ITS_UPDATES, fitted_to_encoder
from sb3_bruno.zoo.configs import config_file, find_config, merged, read_configs
from sb3_bruno.zoo.experiment import TaskExperiment
from sb3_bruno.zoo.registry import ALGORITHMS, register, sampler_of
from sb3_bruno.zoo.saved_yaml import read_saved
from sb3_bruno.zoo.storage import open_storage
from sb3_bruno.zoo.study import SETTINGS, load_study

SMALL = {"n_envs": 1, "policy_kwargs": {"net_arch": [8]}, "buffer_size": 1_000}


@pytest.fixture(autouse=True, scope="module")
def registered():
    """Our algorithms, environments and search space, as the command line registers them."""
    register()


def config_of(algo, env="PointDir-v0", conf=None):
    return find_config(read_configs(config_file(algo, conf)), env)


def model_of(algo, given, **arguments):
    """The model that ``train --env PointDir-v0 -params`` makes, and the hyperparameters that it saves."""
    hyperparams = {**SMALL, **given}
    experiment = TaskExperiment(
        argparse.Namespace(), algo, "PointDir-v0", "logs", hyperparams=hyperparams, seed=0, verbose=0, **arguments
    )
    return experiment.setup_experiment()


@pytest.mark.parametrize("name", ENCODERS)
def test_every_encoder_takes_the_place_of_bruno_by_one_word(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    model, saved = model_of("bruno_sac", {"encoder_class": name})
    assert type(model.encoder) is ENCODERS[name]
    config = config_of("bruno_sac")
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith("The config is for another")]
    if name == "bruno":
        assert not told and saved["encoder_kwargs"] == config["encoder_kwargs"]
        return
    (line,) = told
    assert "leaving out encoder_kwargs.modelled='rewards', encoder_learning_rate=0.00063" in line
    has_own_loss = model.encoder.learns_from == "own"
    for update in OF_ITS_UPDATES:
        assert (saved.get(update) == config[update]) == (f"{update}=" not in line) == has_own_loss
    assert ("taking critic_input='belief'" in line) == (model.encoder.learns_from == "critic")
    assert model.encoder_learning_rate is None and not model.policy.encoder_kwargs


SECTIONS = [(algo, config_of(algo)) for algo in ALGORITHMS]
SECTIONS += [("bruno_sac", config_of("bruno_sac", env)) for env in ("CheetahDir-v0", "SparsePointGoal-v0", "Wind-v0")]


@pytest.mark.parametrize("name", ENCODERS)
def test_what_is_left_of_any_config_suits_the_encoder(name):
    encoder = ENCODERS[name]
    for algo, config in SECTIONS:
        fitted = fitted_to_encoder(algo, config, {"encoder_class": name})
        if encoder is find_encoder(ALGORITHMS[algo].default_encoder):
            assert fitted == config
            continue
        assert not {"encoder_kwargs", "encoder_learning_rate"} & fitted.keys()
        of_actor_critic = {key for key in config if not key.startswith("encoder_") and key != "critic_input"}
        assert all(fitted[key] == config[key] for key in of_actor_critic)
        if encoder.learns_from != "own":
            assert not set(OF_ITS_UPDATES) & fitted.keys()
        if encoder.learns_from == "critic":
            assert fitted.get("critic_input", "belief") == "belief"


@pytest.mark.parametrize("teacher", ["critic", "actor"])
@pytest.mark.parametrize(
    ("algo", "encoder"), [("varibad_sac", {}), ("bruno_sac", {"encoder_class": "mean_embedding"})], ids=str
)
def test_an_encoder_that_others_now_teach_has_no_updates_of_its_own(algo, encoder, teacher, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    model, saved = model_of(algo, {**encoder, "encoder_kwargs": {"learns_from": teacher}})
    assert model.encoder.learns_from == teacher and not set(OF_ITS_UPDATES) & saved.keys()
    if algo == "varibad_sac":  # the same encoder, so that the config's other arguments are of use
        assert saved["encoder_kwargs"] == {**config_of(algo)["encoder_kwargs"], "learns_from": teacher}


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"encoder_class": "recurrent", "encoder_batch_size": 16}, "`encoder_batch_size=16` is for encoders that"),
        ({"encoder_class": "recurrent", "critic_input": "task"}, "`critic_input='task'` teaches an encoder"),
        ({"encoder_class": "recurrent", "encoder_kwargs": {"modelled": "both"}}, "`encoder_kwargs` has no `modelled`"),
        ({"encoder_class": "recurrent", "replay_buffer_kwargs": {"context": "iid"}}, "`context='iid'` shuffles"),
        ({"encoder_class": "recurent"}, "`encoder_class='recurent'` is unknown"),
        ({"encoder_kwargs": {"process": "kernal"}}, "`process` must be one of"),
        ({"encoder_kwargs": {"proces": "kernel"}}, "`encoder_kwargs` has no `proces`: did you mean `process`"),
    ],
    ids=str,
)
def test_what_the_user_says_is_never_left_out_but_refused(given, line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=line):
        model_of("bruno_sac", given)


@pytest.mark.parametrize("given", [{"encoder_kwargs": 5}, {"encoder_kwargs": "dict()"}], ids=str)
def test_arguments_that_are_none_are_refused_as_ever(given, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TypeError, match="is no dict"):
        model_of("bruno_sac", given)


KERNEL_REFUSES = {"flow_class", "extra_dims"}  # those of the paper's process


@pytest.mark.parametrize(
    ("algo", "env", "conf", "given", "left_out"),
    [
        ("pearl_sac", "PointGoal-v0", None, {"information_bottleneck": False}, {"kl_weight"}),
        ("bruno_sac", "CheetahDir-v0", None, {"process": "kernel_student_t"}, KERNEL_REFUSES),
        ("bruno_sac", "CheetahDir-v0", "paper", {"process": "kernel", "modelled": "both"}, KERNEL_REFUSES),
        ("bruno_sac", "CheetahDir-v0", None, {"process": "kernel", "extra_dims": 2}, set()),  # it is the user's
        ("bruno_sac", "CheetahDir-v0", None, {"belief": "mean"}, set()),
    ],
    ids=str,
)
def test_the_fewest_arguments_go_that_the_encoder_refuses_beside_the_users(algo, env, conf, given, left_out):
    config = config_of(algo, env, conf)
    fitted = fitted_to_encoder(algo, config, {"encoder_kwargs": given})
    assert config["encoder_kwargs"].keys() - fitted["encoder_kwargs"].keys() == left_out
    del fitted["encoder_kwargs"]
    assert fitted.items() <= config.items()


def test_critics_read_the_belief_and_episodes_keep_their_order_where_the_encoder_needs_it(capsys):
    searching = config_of("bruno_sac", "SparsePointGoal-v0")
    assert searching["critic_input"] == "task"
    recurrent = {"encoder_class": "recurrent"}
    assert fitted_to_encoder("bruno_sac", searching, recurrent)["critic_input"] == "belief"
    both = {**searching, "critic_input": "both"}
    assert fitted_to_encoder("bruno_sac", both, recurrent)["critic_input"] == "both"
    assert fitted_to_encoder("bruno_sac", searching, {"encoder_class": "recurrent_vae"})["critic_input"] == "task"
    paper = config_of("bruno_sac", "CheetahDir-v0", "paper")
    capsys.readouterr()
    fitted = fitted_to_encoder("bruno_sac", paper, recurrent)
    assert fitted["replay_buffer_kwargs"] == {**paper["replay_buffer_kwargs"], "context": "episode"}
    assert "taking replay_buffer_kwargs.context='episode', critic_input='belief'" in capsys.readouterr().out
    in_any_order = {"encoder_class": "split_aggregator", "encoder_kwargs": {"rnn": False}}
    assert fitted_to_encoder("bruno_sac", paper, in_any_order)["replay_buffer_kwargs"]["context"] == "iid"


def test_nothing_is_left_out_where_the_config_chose_the_encoder(capsys):
    config = {"encoder_class": "recurrent", "encoder_kwargs": {"hidden_size": 8}, "encoder_batch_size": 4}
    for given in ({"encoder_class": "recurrent"}, {"gamma": 0.5}, {"encoder_kwargs": {"cell": "lstm"}}):
        assert fitted_to_encoder("bruno_sac", config, given) == config
    assert fitted_to_encoder("sac", config, {"encoder_class": "bruno"}) == config  # which has no encoder, and says so
    assert capsys.readouterr().out == ""
    back = fitted_to_encoder("bruno_sac", config, {"encoder_class": None})  # to the algorithm's own
    assert back == {"encoder_class": "recurrent", "encoder_batch_size": 4}


def test_a_sweep_searches_another_encoder_and_a_training_takes_what_it_drew(run, tmp_path):
    chosen = ["--storage", "x.log", "--study-name", "s"]
    env = ["--env", "PointDir-v0", "-n", 40]
    small = ["n_envs:1", "policy_kwargs:dict(net_arch=[8])", "buffer_size:1000", "encoder_class:recurrent"]
    printed, mistake = run("sweep", "init", *chosen, *env, "--n-evaluations", 1, "-params", *small)
    assert mistake == "" and "leaving out encoder_kwargs.modelled='rewards'" in printed
    study = load_study("x.log", "s")
    config = study.user_attrs[SETTINGS]["config"]
    assert config["critic_input"] == "belief" and not set(OF_ITS_UPDATES) & config.keys()
    for _ in range(2):  # rl_zoo3 loads trial 0 as if there was none
        trial = study.ask()
        drawn = sampler_of("bruno_sac", config)(trial, 2, 1, {})
        study.tell(trial, 1.0)
    assert run("train", *chosen, *env, "--trial-id", 1, "--eval-freq", -1, "-params", *small)[1] == ""
    used = dict(read_saved(tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1" / "PointDir-v0" / "config.yml"))
    assert used["encoder_kwargs"] == drawn["encoder_kwargs"] and used["gamma"] == drawn["gamma"]


def test_rl_zoos_search_takes_another_encoder_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = {**SMALL, "encoder_class": "causal_transformer"}
    search = {"optimize_hyperparameters": True, "storage": "x.log", "study_name": "s", "hyperparams": given}
    experiment = TaskExperiment(argparse.Namespace(), "bruno_sac", "PointDir-v0", "logs", verbose=0, **search)
    experiment.setup_experiment()
    trial = optuna.load_study(study_name="s", storage=open_storage("x.log")).ask()
    drawn = sampler_of("bruno_sac", experiment._hyperparams)(trial, 2, 1, {})
    used = merged(experiment._hyperparams, drawn)
    ALGORITHMS["bruno_sac"](env="PointDir-v0", **used)
    assert used["encoder_kwargs"].keys() == ENCODERS["causal_transformer"].search_space.keys()


def test_a_config_of_the_users_own_is_fitted_as_ours_are(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = {**config_of("bruno_sac"), "encoder_class": "mean_embedding", "encoder_kwargs": {"latent_dim": 3}}
    (tmp_path / "mine.yml").write_text(yaml.safe_dump({"PointDir-v0": config}))
    model, saved = model_of("bruno_td3", {"encoder_class": "random_features"}, config="mine.yml")
    assert type(model.encoder) is ENCODERS["random_features"] and "encoder_kwargs" not in saved

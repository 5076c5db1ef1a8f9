"""Our configs and our command line, as a user of RL Zoo meets them."""

import re
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import yaml
from stable_baselines3.common.monitor import load_results

from sb3_bruno import BrunoSAC, RecurrentEncoder
from sb3_bruno.cli.main import main
from sb3_bruno.diagnostics.result import Diagnostics
from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.evaluation.eval_callback import load_learning_curve
from sb3_bruno.zoo.configs import DEFAULT, config_file, config_name, configs_folder, find_config, read_configs
from sb3_bruno.zoo.registry import ALGORITHMS
from sb3_bruno.zoo.saved_yaml import read_saved
from sb3_bruno_envs import CHEETAH_VEL_TASKS
from sb3_bruno_envs.classic.wind import WIND
from support.tiny_runs import tiny

CONFIGS = sorted(configs_folder().rglob("*.yml"))


RIVALS = {name: f"bruno_{name.rpartition('_')[2]}" for name in ALGORITHMS if not name.startswith("bruno")}
"""Algorithms with another encoder, and the one of ours whose sections and numbers their configs have."""
ALIKE = {*RIVALS, "markov", "oracle"}
"""Files and folders whose numbers are ours, as another test shows. Two environments run."""


def of_config(path):
    """(-conf, algorithm, environment) of every entry of a config file: an environment without one for the default."""
    folder = None if path.parent == configs_folder() else path.parent.name
    entries = yaml.safe_load(path.read_text())
    if {path.stem, folder} & ALIKE:
        return [(folder, path.stem, env) for env in ("PointDir-v0", "CheetahParams-v0")]
    others = [env for env in ("PointGoal-v0", "SparsePointGoal-v0") if env not in entries]
    envs = [env for env in entries if env != DEFAULT] + others[:1]
    return [(folder, path.stem, env) for env in envs]


@pytest.mark.parametrize(("conf", "algo", "env"), [entry for path in CONFIGS for entry in of_config(path)])
def test_every_config_runs(run, tmp_path, conf, algo, env):
    arguments = ["--algo", algo, "--env", env, "-n", 400, "--eval-freq", -1, "--seed", 1]
    if conf is not None:
        arguments += ["-conf", conf]
    if algo == "ppo_lstm":
        arguments += ["-params", "n_steps:50", "n_epochs:1"]
    else:
        arguments += ["-params", "learning_starts:200", "gradient_steps:2", "buffer_size:2000", "train_freq:10"]
    # The paper's activation is a function, which no agent file holds.
    with pytest.warns(UserWarning, match="activation_fn") if conf == "paper" else nullcontext():
        assert run("train", *arguments)[1] == ""
    folder = tmp_path / "logs" / algo / f"{env}_1"
    assert (folder / f"{env}.zip").is_file()
    saved = read_saved(folder / env / "config.yml")
    given = find_config(read_configs(config_file(algo, conf)), env)
    assert set(given) <= set(saved)


ITS_OWN = {"encoder_kwargs", "encoder_learning_rate"}  # of another encoder


@pytest.mark.parametrize(("rival", "ours"), RIVALS.items())
def test_a_rival_has_every_section_of_ours_and_its_actor_critic(rival, ours):
    theirs, ours = (yaml.safe_load((configs_folder() / f"{name}.yml").read_text()) for name in (rival, ours))
    assert theirs.keys() == ours.keys()

    def actor_critic(config):
        return {key: value for key, value in config.items() if not key.startswith("encoder_") and key != "critic_input"}

    for env, config in theirs.items():
        assert actor_critic(config) == actor_critic(ours[env]), env


def test_siblings_and_oracle_have_the_numbers_of_bruno_sac():
    ours = yaml.safe_load((configs_folder() / "bruno_sac.yml").read_text())
    for path in (*(configs_folder() / f"{name}.yml" for name in ALGORITHMS), *configs_folder().glob("*/sac.yml")):
        for env, config in yaml.safe_load(path.read_text()).items():
            for key in (config.keys() & ours[env].keys()) - {"policy_kwargs", "critic_input", *ITS_OWN}:
                assert config[key] == ours[env][key], f"{path.name} {env} {key}"


@pytest.mark.parametrize(("conf", "observe"), [("oracle", "task"), ("markov", "plain")])
def test_the_oracle_sees_the_task_and_the_markov_agent_nothing_of_it(conf, observe):
    entries = read_configs(config_file("sac", conf))
    assert {find_config(entries, env)["env_kwargs"]["observe"] for env in entries} == {observe}


def test_a_config_file_chooses_the_encoder_by_its_name(run, tmp_path):
    config = {"policy": "MlpPolicy", "n_timesteps": 120, "n_envs": 2, "encoder_class": "recurrent"}
    config |= {"encoder_kwargs": {"hidden_size": 8}, "learning_starts": 100, "batch_size": 16}
    config["policy_kwargs"] = {"net_arch": [8]}
    (tmp_path / "mine.yml").write_text(yaml.safe_dump({"PointDir-v0": config}))
    chosen = ["--algo", "bruno_sac", "--env", "PointDir-v0"]
    assert run("train", *chosen, "-conf", "mine.yml", "--eval-freq", -1)[1] == ""
    model = BrunoSAC.load(tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1" / "PointDir-v0.zip")
    assert isinstance(model.encoder, RecurrentEncoder) and model.encoder.belief_dim == 8
    assert "mean" in run("evaluate", *chosen, "--episodes", 1)[0]


def test_train_evaluate_enjoy_record_and_plot(run, tmp_path):
    assert run(*tiny())[1] == ""
    folder = tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1"
    assert load_learning_curve(folder).timesteps.tolist() == [240, 480]
    assert {"task_index", "task"} <= set(load_results(str(folder)).columns)
    printed, _ = run("evaluate", "--env", "PointDir-v0", "--episodes", 2, "--video")
    assert "steps to 90 %" in printed
    assert AdaptationResult.load(folder / "adaptation.json").rewards.shape == (2, 2, 30)
    assert all((folder / f"adaptation.{suffix}").stat().st_size > 1_000 for suffix in ("mp4", "gif"))
    assert "reward" in run("diagnose", "--env", "PointDir-v0", "--episodes", 2)[0]
    assert Diagnostics.load(folder / "diagnostics.npz").log_scores.shape == (2, 2, 30)
    assert "none/bruno_sac folder was not found" in run("enjoy", "-f", "none")[1]  # also after a training
    shown = run("enjoy", "--env", "PointDir-v0", "--no-render", "-n", 60)[0]
    assert "Mean reward" in shown
    assert re.search(r"^after 0 transitions: (left|right) 0\.\d\d, (left|right) 0\.\d\d$", shown, re.MULTILINE)
    assert run("record-video", "--env", "PointDir-v0", "-n", 10)[1] == ""
    assert list((folder / "videos").glob("*.mp4"))
    assert run(*tiny("-conf", "oracle", algo="sac"))[1] == ""
    assert "sac has no belief" in run("diagnose", "--algo", "sac", "--env", "PointDir-v0")[1]
    assert run("plot", "-a", "bruno_sac", "sac", "-e", "PointDir-v0")[1] == ""
    assert (tmp_path / "curves.png").stat().st_size > 10_000


def test_every_evaluation_meets_every_test_task_equally_often(run, tmp_path):
    flags = ["--eval-freq", 64, "--eval-episodes", 5, "--n-eval-envs", 2]
    assert run(*tiny(*flags, env="PointDir-v0", steps=128))[1] == ""
    curve = load_learning_curve(tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1")
    assert curve.returns.shape == (2, 8)  # twice the two test tasks in each environment
    for tasks in curve.tasks:
        assert np.unique(tasks, axis=0, return_counts=True)[1].tolist() == [4, 4]


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A log folder with two runs of PointDir, each evaluated once, after 320 env steps."""
    folder = tmp_path_factory.mktemp("runs") / "logs"
    for seed, steps in ((1, 480), (2, 600)):
        main(list(map(str, tiny("-f", folder, "--eval-freq", 320, "--seed", seed, steps=steps))))
    return folder


@pytest.mark.parametrize(
    ("flags", "seed", "env_steps"),
    [([], 2, 600), (["--exp-id", 1], 1, 480), (["--exp-id", 1, "--load-best"], 1, 320), (["--load-best"], 2, 320)],
    ids=str,
)
def test_evaluate_takes_the_run_and_the_model_asked_for(run, logs, tmp_path, flags, seed, env_steps):
    arguments = ["--env", "PointDir-v0", "-f", logs, "--episodes", 1, "--steps", 5, "--out", tmp_path]
    assert run("evaluate", *arguments, *flags)[1] == ""
    config = AdaptationResult.load(tmp_path / "adaptation.json").config
    assert (config["seed"], config["env_steps"]) == (seed, env_steps)


@pytest.mark.mujoco
def test_evaluate_tests_on_the_split_asked_for(run, tmp_path):
    assert run(*tiny("--eval-freq", -1, env="CheetahVel-v0", steps=20))[1] == ""
    for flags, split in (([], "test"), (["--split", "test"], "test"), (["--split", "train"], "train")):
        run("evaluate", "--env", "CheetahVel-v0", "--episodes", 1, "--steps", 1, "--out", tmp_path, *flags)
        found = AdaptationResult.load(tmp_path / "adaptation.json")
        np.testing.assert_array_equal(found.tasks, CHEETAH_VEL_TASKS.tasks(split))
        assert found.config["split"] == split


def test_evaluate_tests_on_a_named_set_of_the_family(run, tmp_path):
    assert run(*tiny("--eval-freq", -1, env="Wind-v0", steps=20))[1] == ""
    flags = ["--env", "Wind-v0", "--episodes", 1, "--steps", 1]
    run("evaluate", *flags, "--tasks", "beyond")
    found = AdaptationResult.load(tmp_path / "logs" / "bruno_sac" / "Wind-v0_1" / "adaptation_1_steps_beyond_set.json")
    np.testing.assert_array_equal(found.tasks, WIND.task_sets["beyond"].tasks("test"))
    assert found.config["tasks"] == "beyond" and not any(found.config["inside_train_box"])
    assert "beyonds" in run("evaluate", *flags, "--tasks", "beyonds")[1]


def test_evaluate_draws_actions_if_asked_to_the_same_for_a_seed(run, logs, tmp_path):
    def tested(*flags):
        run("evaluate", "--env", "PointDir-v0", "-f", logs, "--episodes", 1, "--steps", 5, "--out", tmp_path, *flags)
        return AdaptationResult.load(tmp_path / "adaptation.json")

    mode, drawn, again = tested(), tested("--stochastic"), tested("--stochastic")
    assert (mode.config["deterministic"], drawn.config["deterministic"]) == (True, False)
    np.testing.assert_array_equal(drawn.rewards, again.rewards)
    assert (drawn.rewards != mode.rewards).any()


def test_a_run_is_named_by_where_it_differs_from_the_config(run, tmp_path, monkeypatch):
    config = yaml.safe_load((configs_folder() / "bruno_sac.yml").read_text())["PointDir-v0"]
    encoder_kwargs = "encoder_kwargs:{'process':'gaussian'}"
    assert run(*tiny(), f"gamma:{config['gamma']}", "tau:0.5", encoder_kwargs)[1] == ""
    run("evaluate", "--env", "PointDir-v0", "--episodes", 1, "--steps", 5, "--out", tmp_path)
    given = AdaptationResult.load(tmp_path / "adaptation.json").config["params"]
    assert given["tau"] == 0.5 and "gamma" not in given and "n_timesteps" not in given
    of_encoder = {name: value for name, value in given.items() if name.startswith("encoder_kwargs")}
    assert of_encoder == {"encoder_kwargs.process": "gaussian"}

    newer = tmp_path / "zoo_configs"
    newer.mkdir()
    changed = {"gamma": 0.5, "tau": 0.5, "encoder_kwargs": {**config["encoder_kwargs"], "belief": "mean"}}
    (newer / "bruno_sac.yml").write_text(yaml.safe_dump({"PointDir-v0": {**config, **changed}}))
    monkeypatch.setattr("sb3_bruno.zoo.configs.configs_folder", lambda: newer)
    run("evaluate", "--env", "PointDir-v0", "--episodes", 1, "--steps", 5, "--out", tmp_path)
    given = AdaptationResult.load(tmp_path / "adaptation.json").config["params"]
    assert given["gamma"] == config["gamma"] and "tau" not in given
    assert given["encoder_kwargs.belief"] is None  # which the config alone has


@pytest.mark.parametrize("conf", ["oracle", configs_folder() / "oracle" / "sac.yml"])
def test_what_sb3_writes_into_policy_kwargs_names_no_run_nor_does_where_its_config_lies(run, tmp_path, conf):
    run("train", "--algo", "sac", "--env", "PointDir-v0", "-conf", conf, "-n", 64, "--eval-freq", -1)
    run("evaluate", "--algo", "sac", "--env", "PointDir-v0", "--episodes", 1, "--steps", 5, "--out", tmp_path)
    config = AdaptationResult.load(tmp_path / "adaptation.json").config
    assert (config["conf"], config["params"]) == ("oracle", {})


@pytest.mark.parametrize(
    ("conf", "name"),
    [(None, None), ("markov", "markov"), ("best.yml", "best"), ("/home/me/sweeps/best.yml", "sweeps/best")],
)
def test_a_config_is_called_the_same_on_every_machine(conf, name):
    assert config_name("sac", conf) == name


def test_learning_rates_fall_where_the_config_says_so(run, tmp_path, monkeypatch):
    assert run(*tiny(), "learning_rate:'lin_1e-3'", "encoder_learning_rate:'lin_2e-3'")[1] == ""
    monkeypatch.setitem(sys.modules, "rl_zoo3.utils", None)  # where it is not installed
    model = BrunoSAC.load(tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1" / "PointDir-v0.zip")
    for schedule, first in ((model.lr_schedule, 1e-3), (model.encoder_lr_schedule, 2e-3)):
        assert [schedule(left) for left in (1.0, 0.5, 0.0)] == pytest.approx([first, first / 2, 0.0])


def test_entries_of_a_dict_go_over_the_configs(run, tmp_path):
    assert run(*tiny(), "encoder_kwargs:dict(belief='mean')")[1] == ""
    config = yaml.safe_load(Path(config_file("bruno_sac")).read_text())["PointDir-v0"]["encoder_kwargs"]
    model = BrunoSAC.load(tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1" / "PointDir-v0.zip")
    assert model.policy.encoder_kwargs == {**config, "belief": "mean"}
    assert config  # else nothing could have been lost


def test_an_agent_is_trained_on(run, tmp_path):
    run(*tiny("--save-replay-buffer"))
    first = tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1" / "PointDir-v0.zip"
    assert run(*tiny("-i", first))[1] == ""
    assert BrunoSAC.load(first.parents[1] / "PointDir-v0_2" / "PointDir-v0.zip").num_timesteps == 480


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["train", "--env", "Pointdir-v0"], "did you mean PointDir-v0?"),
        (
            ["train", "--env", "SomebodyElses-v0"],
            "SomebodyElses-v0 is not registered: name the package that does by --gym-packages",
        ),
        (["train", "--env", "my_envs:SomebodyElses-v0"], "--gym-packages my_envs cannot be imported"),
        (
            ["enjoy", "--env", "SomebodyElses-v0"],
            "SomebodyElses-v0 is not registered: name the package that does by --gym-packages",
        ),
        (["record-video", "--env", "SomebodyElses-v0"], "name the package that does by --gym-packages"),
        (["train", "--env", "PointDir-v0", "-n", "9", "-params", "learning_rat:1"], "`learning_rat`: did you mean"),
        (
            ["train", "-conf", "none.yml"],
            "-conf none.yml is neither a file nor one of our folders (markov, oracle, paper)",
        ),
        (["train", "-conf", "oracle"], "-conf oracle has no config of --algo bruno_sac: it has sac"),
        (["train", "--resume", "none"], "--resume none: no checkpoint.pkl there"),
        (["train", "--resume", "none", "-n", "9"], "leave out -n 9"),
        (["train", "--env", "PointDir-v0", "-params", "policy_kwargs:'dict(activation_fn=nn.Tanhh)'"], "'Tanhh'"),
        (["train", "--env", "PointDir-v0", "-params", "env_wrapper:'gymnasium.wrappers.Nope'"], "'Nope'"),
        (["train", "--algo", "tqc", "--env", "PointDir-v0"], "You must use `MultiInputPolicy`"),
        (["evaluate", "-f", "none"], "none/bruno_sac folder was not found"),
        (["enjoy", "-f", "none"], "none/bruno_sac folder was not found"),
        (["record-video", "-f", "none"], "none/bruno_sac folder was not found"),
        (["plot", "-f", "none"], "no evaluated run of CheetahDir-v0"),
    ],
    ids=" ".join,
)
def test_a_mistake_is_one_line_and_leaves_no_folder(run, tmp_path, arguments, line):
    _, mistake = run(*arguments)
    assert line in mistake and "\n" not in mistake
    assert not list(tmp_path.rglob("PointDir*"))

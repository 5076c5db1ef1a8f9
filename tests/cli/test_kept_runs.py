"""A run's folder says what it was, whatever the config says since; a damaged file is told in one line."""

import shutil

import pytest
import yaml

from sb3_bruno import BrunoSAC
from sb3_bruno.cli.main import main
from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.runs.origin import trained_at
from support.tiny_runs import tiny

TESTS = [[command, "--env", "PointDir-v0", "--episodes", 1] for command in ("evaluate", "diagnose")]
WATCHES = [["enjoy", "--env", "PointDir-v0", "--no-render", "-n", 3], ["record-video", "--env", "PointDir-v0", "-n", 3]]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A folder with a run whose observations are normalised."""
    folder = tmp_path_factory.mktemp("normalised")
    flags = tiny("--eval-freq", -1, "--checkpoint-freq", 32, "-f", folder / "logs", steps=64)
    main([*map(str, flags), "normalize:True"])
    return folder


@pytest.fixture
def normalised(trained, tmp_path):
    """A copy of that run, to damage."""
    shutil.copytree(trained / "logs", tmp_path / "logs")
    return tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1"


def evaluate(run, folder, *flags):
    """Test the latest run of PointDir; return its settings, as kept."""
    printed, mistake = run("evaluate", "--env", "PointDir-v0", "--episodes", 1, "--out", folder, *flags)
    assert mistake == "", printed
    return AdaptationResult.load(folder / "adaptation.json").config


def test_a_resumed_run_keeps_its_config(run, tmp_path):
    entry = {"n_timesteps": 120, "n_envs": 2, "policy": "MlpPolicy", "learning_rate": 1e-3, "learning_starts": 96}
    (tmp_path / "my.yml").write_text(yaml.safe_dump({"PointDir-v0": entry}))
    flags = ["--env", "PointDir-v0", "--checkpoint-freq", 60, "--seed", 1]
    assert run("train", *flags, "-conf", "my.yml", "-params", "gamma:0.5")[1] == ""
    folder = tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1"
    before = (folder / "PointDir-v0" / "config.yml").read_text()
    (tmp_path / "my.yml").write_text(yaml.safe_dump({"PointDir-v0": {**entry, "learning_rate": 9e-3, "n_envs": 3}}))
    assert run("train", "--resume", folder)[1] == ""
    assert (folder / "PointDir-v0" / "config.yml").read_text() == before
    model = BrunoSAC.load(folder / "PointDir-v0.zip")
    assert (model.lr_schedule(1.0), model.gamma, model.num_timesteps) == (1e-3, 0.5, 120)


@pytest.mark.parametrize("damage", [lambda whole: whole[:1_000], lambda whole: b"\x80\x05N."])
def test_a_checkpoint_that_cannot_be_read_is_told_in_one_line(run, normalised, damage):
    versions = trained_at(normalised)
    (normalised / "checkpoint.pkl").write_bytes(damage((normalised / "checkpoint.pkl").read_bytes()))
    mistake = run("train", "--resume", normalised)[1]
    assert "checkpoint.pkl is damaged, or no checkpoint of this version" in mistake and "\n" not in mistake
    assert trained_at(normalised) == versions and (normalised / "PointDir-v0.zip").is_file()


def test_a_run_is_named_by_what_its_environment_was_made_with(run, tmp_path):
    run(*tiny("--env-kwargs", "max_episode_steps:20", "--eval-freq", -1, steps=64))
    assert evaluate(run, tmp_path)["params"]["env_kwargs.max_episode_steps"] == 20


def test_a_normalised_run_is_named_by_that_alone(run, normalised, tmp_path):
    params = evaluate(run, tmp_path)["params"]
    assert {name: value for name, value in params.items() if name.startswith("norm")} == {"normalize": True}


def test_a_trial_is_not_cut(run):
    run(*tiny("--eval-freq", -1, env="SparsePointGoal-v0", steps=120))
    mistake = run("evaluate", "--env", "SparsePointGoal-v0", "--steps", 30)[1]
    assert mistake == "sb3-bruno evaluate: --steps 30: a trial is as long as its 3 episodes, so leave it out"


@pytest.mark.parametrize("flags", [["--episodes", 0], ["--steps", -5], ["--steps", "many"]], ids=str)
def test_what_is_counted_is_at_least_one(flags, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["evaluate", *map(str, flags)])
    assert "is not a whole number of 1 or more" in capsys.readouterr().err


def test_an_agent_that_cannot_be_loaded_is_told_in_one_line(run, normalised):
    path = normalised / "PointDir-v0.zip"
    for damaged, line in ((path.with_suffix(".agent"), "cannot be loaded as an agent"), (path, "loaded as bruno_sac")):
        damaged.write_bytes(damaged.read_bytes()[:1_000])
        mistake = run("evaluate", "--env", "PointDir-v0")[1]
        assert damaged.name in mistake and line in mistake and "\n" not in mistake
        damaged.unlink()


@pytest.mark.parametrize(
    ("name", "content", "commands", "line"),
    [
        ("vecnormalize.pkl", None, TESTS, "vecnormalize.pkl, which normalises observations, cannot be read"),
        ("vecnormalize.pkl", b"", TESTS, "vecnormalize.pkl, which normalises observations, cannot be read"),
        ("config.yml", None, [*WATCHES, *TESTS], "has no config.yml, which `sb3-bruno train` writes"),
        ("config.yml", b"- 1", [*WATCHES, *TESTS], "config.yml cannot be read"),
        ("config.yml", b"{}", [*WATCHES, *TESTS], "config.yml cannot be read: it has no n_timesteps: train again"),
        ("args.yml", None, [*WATCHES, *TESTS], "has no args.yml"),
        ("args.yml", b"{}", [*WATCHES, *TESTS], "args.yml cannot be read: it has no conf_file, env_kwargs"),
    ],
)
def test_an_agent_is_not_tested_otherwise_than_it_was_trained(run, normalised, name, content, commands, line):
    (normalised / "PointDir-v0.agent").unlink()  # which would bring its own statistics
    path = normalised / "PointDir-v0" / name
    path.unlink() if content is None else path.write_bytes(content)
    for command in commands:
        mistake = run(*command)[1]
        assert line in mistake and "\n" not in mistake


def test_a_run_whose_config_is_gone_is_not_resumed(run, normalised):
    (normalised / "PointDir-v0" / "config.yml").unlink()
    mistake = run("train", "--resume", normalised)[1]
    assert "has no config.yml, which `sb3-bruno train` writes: train there" in mistake and "\n" not in mistake


def test_curves_of_other_steps_are_not_plotted_together(run, tmp_path):
    for frequency in (160, 80):
        run(*tiny("--eval-freq", frequency, steps=160))
    assert "were evaluated at different steps" in run("plot", "-e", "PointDir-v0")[1]
    (tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1" / "evaluations.npz").write_bytes(b"PK")
    assert "holds no evaluations with tasks" in run("plot", "-e", "PointDir-v0")[1]


@pytest.mark.parametrize("conf", ["oracle", "markov"])
def test_a_video_is_of_the_environment_that_was_trained_in(run, tmp_path, conf):
    run("train", "--algo", "sac", "--env", "PointDir-v0", "-conf", conf, "-n", 64, "--eval-freq", -1)
    assert run("record-video", "--algo", "sac", "--env", "PointDir-v0", "-n", 5)[1] == ""
    assert list((tmp_path / "logs" / "sac" / "PointDir-v0_1" / "videos").glob("*.mp4"))


def test_an_agent_whose_training_diverged_is_told_as_that(run, tmp_path):
    run(*tiny("--eval-freq", -1, steps=64))
    path = tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1" / "PointDir-v0.zip"
    path.with_suffix(".agent").unlink()
    model = BrunoSAC.load(path)
    next(model.policy.actor.parameters()).data.fill_(float("nan"))
    model.save(path)
    mistake = run("evaluate", "--env", "PointDir-v0")[1]
    assert "PointDir-v0.zip" in mistake and "finite" in mistake and "train it again" in mistake
    assert "env" not in mistake.replace("sb3-bruno evaluate", "") and "\n" not in mistake


def test_a_training_prints_few_lines(run):
    printed, _ = run(*tiny("--eval-freq", -1, steps=720))
    few = len(printed.splitlines())
    assert few < 60
    printed, _ = run(*tiny("--eval-freq", -1, "--log-interval", 4, steps=720))
    assert len(printed.splitlines()) > 2 * few

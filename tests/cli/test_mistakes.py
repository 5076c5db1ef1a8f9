"""What is wrong in a command is one line that names flag, value and remedy, and leaves no folder behind."""

import importlib.util
import os
import sys

import pytest
import yaml

from sb3_bruno.cli.main import COMMANDS, main
from sb3_bruno.cli.params import read_param
from support.tiny_runs import tiny

POINT = ["train", "--env", "PointDir-v0"]
SECTION = {"policy": "MlpPolicy", "n_timesteps": 64}


@pytest.fixture
def told(run, tmp_path, capsys):
    """Run a command that cannot work; return its one line."""

    def call(*arguments):
        before = [path for path in tmp_path.rglob("*") if path.is_file()]
        with pytest.raises(SystemExit) as end:
            main(list(map(str, arguments)))
        printed = capsys.readouterr().err
        line = printed.strip() if end.value.code == 2 else str(end.value.code)
        assert line.startswith(f"sb3-bruno {arguments[0]}: ") and "\n" not in line
        assert [path for path in tmp_path.rglob("*") if path.is_file()] == before
        assert not list(tmp_path.glob("logs/*/*_2")), "nor a run"
        return line

    return call


@pytest.mark.parametrize(
    ("flags", "line"),
    [
        (["-n", "-5"], "-n/--n-timesteps: '-5' is not a whole number of 1 or more"),
        (["-n", "0"], "'0' is not a whole number of 1 or more"),
        (["-n", "1.5"], "'1.5' is not a whole number of 1 or more"),
        (["-n", "many"], "'many' is not a whole number of 1 or more"),
        (["-n", "inf"], "'inf' is not a whole number of 1 or more"),
        (["-n"], "-n/--n-timesteps: expected one argument"),
        (["--n-time", "-5"], "'-5' is not a whole number of 1 or more"),
        (["--eval-episodes", "0"], "--eval-episodes: '0' is not"),
        (["--n-eval-envs", "-1"], "--n-eval-envs: '-1' is not"),
        (["--eval-freq", "often"], "--eval-freq: 'often' is not a whole number"),
        (["--checkpoint-freq", "-1"], "--checkpoint-freq: '-1' is not a whole number of 0 or more"),
        (["--log-interval", "0"], "'0' is not a whole number of 1 or more, or -1, or -2"),
        (["--num-threads", "0"], "--num-threads: '0' is not"),
        (["--seed", "-2"], "--seed: '-2' is not a whole number from 0 to 4294967295, or -1"),
        (["--seed", "4294967296"], "--seed: '4294967296' is not"),
        (["--device", "gpu"], "--device: 'gpu' is no device of torch: give auto, cpu or cuda"),
        (["--device", "cuda:99"], "--device: there is no 'cuda:99' here: give auto or cpu"),
        (["--vec-env", "many"], "--vec-env: invalid choice: 'many'"),
        (["--algo", "bruno_sca"], "--algo: invalid choice: 'bruno_sca'"),
        (["-i", "none.zip"], "'none.zip' is no file of an agent"),
        (["--n-timestep5", "3"], "--n-timestep5 is unknown: did you mean --n-timesteps?"),
        (["--resum", "logs"], "--resum is unknown: did you mean --resume?"),
        (["--checkpoint-frq=7"], "--checkpoint-frq=7 is unknown: did you mean --checkpoint-freq?"),
        (["-f", ""], "'' is no folder: give its name, . for this one"),
        (["-f", 300 * "a"], "aa' cannot be written: File name too long: give another"),
        (["-f", __file__], "--log-folder: '" + __file__ + "' cannot be written"),
        (["-params", "gamma=1"], "-params gamma=1: write gamma:1"),
        (["-params", "gamma"], "-params gamma: give NAME:VALUE"),
        (["-params", ":1"], "-params :1: give NAME:VALUE"),
        (["-params", "gamma:"], "-params gamma:: "),
        (["-params", "gamma:1/0"], "-params gamma:1/0: ZeroDivisionError"),
        (["-params", "gamma:0.9", "gamma:0.8"], "gamma is given twice"),
        (["-params", "gamma:0.9", "-params", "gamma:0.8"], "gamma is given twice"),
        (["-params", "learning_rate:lin-1e-3"], "learning_rate='lin-1e-3' is no schedule: write lin_1e-3"),
        (["-params", "encoder_learning_rate:exp_1e-3"], "encoder_learning_rate='exp_1e-3' is no schedule"),
        (["-params", "learning_rate:'1e-3'"], "YAML takes 1e-3 for text, so write 0.001 or !!float 1e-3"),
        (["-params", "learning_rate:high"], "learning_rate='high' is no schedule"),
        (["-params", "learning_rat:1"], "`learning_rat`: did you mean `learning_rate`?"),
        (["-params", "batch_size:many"], "`batch_size='many'` is no whole number"),
        (["-params", "batch_size:0"], "`batch_size=0` is too small"),
        (["-params", "buffer_size:1e5"], "`buffer_size=100000.0` is no whole number"),
        (["-params", "n_envs:0"], "`n_envs=0` is too small"),
        (["-params", "n_envs:2.5"], "`n_envs=2.5` is no whole number"),
        (["-params", "critic_input:beliefs"], "beliefs"),
        (["-params", "policy_kwargs:dict(net_ach=[8])"], "`policy_kwargs` has no `net_ach`: did you mean `net_arch`?"),
        (["-params", "encoder_kwargs:dict(proces='gaussian')"], "did you mean `process`?"),
        (
            ["--env-kwargs", "splt:test"],
            "--env-kwargs splt:'test': PointDir-v0 has no argument splt: did you mean split?",
        ),
        (["--env-kwargs", "split:tset"], "split='tset' is unknown: use 'train' or 'test'"),
        (["-conf", "orcale"], "-conf orcale is neither a file nor one of our folders (markov, oracle, paper): did you"),
        (["-conf", ".."], "-conf .. is neither a file nor one of our folders"),
        (["-conf", ""], "-conf is neither a file nor one of our folders"),
        (["-conf", "json"], "-conf json cannot be read: AttributeError"),
        (["--tensorboard-log", __file__], "cannot be written"),
        (["--gym-packages", "no_such_package"], "--gym-packages no_such_package cannot be imported"),
    ],
    ids=lambda value: " ".join(value)[-40:] if isinstance(value, list) else "",
)
def test_a_training_that_cannot_be(told, flags, line):
    assert line in told(*POINT, *flags)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["train", "--env", "Pendulum-v1"], "--env Pendulum-v1 has no hidden task: "),
        (
            ["train", "--env", "CartPole-v1"],
            "--env CartPole-v1 has Discrete actions: --algo bruno_sac needs",
        ),
        (["train", "--env", "Pointdir-v0"], "did you mean PointDir-v0?"),
        (["train", "--env", "no_such_package:Mine-v0"], "--gym-packages no_such_package cannot be imported"),
        (["evaluate", "--algo", "bruno_sca"], "--algo bruno_sca is unknown: did you mean bruno_sac?"),
        (["evaluate", "--env", "PointDri-v0"], "did you mean PointDir-v0?"),
        (["evaluate", "-f", "none"], "none/bruno_sac folder was not found: train there, or give another -f"),
        (["evaluate", "--step", "x"], "--steps: 'x' is not a whole number of 1 or more"),
        (["evaluate", "--spilt", "test"], "--spilt is unknown: did you mean --split?"),
        (["evaluate", "--split", "tset"], "--split: invalid choice: 'tset'"),
        (["evaluate", "--out", ""], "'' is no folder: give its name"),
        (["plot", "--out", 300 * "a"], "aa' cannot be written: File name too long"),
        (["plot", "--out", 300 * "a" + "/x.png"], "aa' cannot be written: File name too long"),
        (["evaluate", "--seed", "-1"], "--seed: '-1' is not a whole number from 0"),
        (
            ["evaluate", "--out", f"{__file__}/x"],
            f"/x' cannot be written, for {__file__} is no folder",
        ),
        (["diagnose", "--out", __file__], "cannot be written"),
        (["diagnose", "--out", "/proc/x"], "'/proc/x' cannot be written, for nothing can be made in /proc"),
        (["evaluate", "--out", "/proc/x/y"], "cannot be written, for nothing can be made in /proc"),
        (["evaluate", "--out", "/proc"], "cannot be written, for nothing can be made in /proc"),
        (["report", "--out", "/proc/x"], "cannot be written, for nothing can be made in /proc"),
        (["plot", "--out", "/proc/x.png"], "'/proc' cannot be written, for nothing can be made in /proc"),
        (["train", "-f", "/proc/x"], "cannot be written, for nothing can be made in /proc"),
        (["report", "--out", __file__], "cannot be written"),
        (["plot", "--out", os.path.dirname(__file__)], "is a folder: give a file in it"),
        (["report", "none"], "no adaptation.json in none: test the run by `sb3-bruno evaluate` first"),
        (["enjoy", "-f", "none", "-n", "-5"], "'-5' is not a whole number of 1 or more"),
        (["record-video", "-f", "none", "--n-envs", "0"], "--n-envs: '0' is not"),
        (["record-video", "-f", "none", "-n", "x"], "'x' is not a whole number"),
    ],
    ids=lambda value: " ".join(value)[-40:] if isinstance(value, list) else "",
)
def test_a_command_that_cannot_be(told, arguments, line):
    assert line in told(*arguments)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("", "holds no environments: write the environment's id"),
        ("- a\n- b\n", "holds no environments"),
        ("3", "holds no environments"),
        ("PointDir-v0:\n", "holds no hyperparameters of PointDir-v0"),
        ("PointDir-v0: [1]\n", "holds no hyperparameters of PointDir-v0"),
        ("PointDir-v0: {a: [}\n", "cannot be read as YAML"),
        (yaml.safe_dump({"Mine-v0": SECTION}), "has no PointDir-v0: give another file by -conf"),
        (yaml.safe_dump({"PointDir-v0": {"n_timesteps": 64}}), "the config has no policy: add it"),
        (yaml.safe_dump({"PointDir-v0": {"policy": "MlpPolicy"}}), "the config has no n_timesteps: add it"),
        (yaml.safe_dump({"PointDir-v0": {**SECTION, "batch_size": "many"}}), "`batch_size='many'`"),
        (yaml.safe_dump({"PointDir-v0": {**SECTION, "n_timesteps": -1}}), "`n_timesteps=-1` is too small"),
    ],
)
def test_a_config_that_cannot_be_read(told, tmp_path, text, line):
    (tmp_path / "my.yml").write_text(text)
    assert line in told(*POINT, "-conf", "my.yml")


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("critic_input:belief", "belief"),
        ("critic_input:'belief'", "belief"),
        ("learning_rate:lin_1e-3", "lin_1e-3"),
        ("learning_rate:1e-3", 1e-3),
        ("env_wrapper:gymnasium.wrappers.TimeLimit", "gymnasium.wrappers.TimeLimit"),
        ("use_sde:true", True),
        ("use_sde:false", False),
        ("encoder_tau:none", None),
        ("policy_kwargs:dict(net_arch=[8])", {"net_arch": [8]}),
        ("env_kwargs:{'split':'test'}", {"split": "test"}),
    ],
)
def test_text_needs_no_quotes(word, value):
    assert read_param(word, "-params") == (word.partition(":")[0], value)


def test_a_run_that_goes_on_takes_no_other_flags(run, told, tmp_path):
    run(*tiny("--eval-freq", -1, "--checkpoint-freq", 64, steps=120))
    folder = tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1"
    for flags in (["-n", "1000"], ["--checkpoint-freq", "10"]):
        assert f"--resume goes on with the run's own flags: leave out {' '.join(flags)}" in told(
            "train", "--resume", folder, *flags
        )


def test_a_number_may_be_written_short(run, tmp_path):
    assert run(*tiny("--eval-freq", -1, steps="1e2"))[1] == ""
    assert run("train", "--env", "PointDir-v0", "-conf", "none", "-n", "1e2")[1].count("-conf none")


def test_a_misspelt_command_is_told_the_nearest(run):
    assert run("trian")[1] == "sb3-bruno: unknown command 'trian': did you mean train?"
    assert run("?")[1] == f"sb3-bruno: unknown command '?': there are {', '.join(COMMANDS)}"
    assert run("--version") == ("sb3-bruno 0.1.0\n", "0")


def test_a_library_that_is_missing_is_told_before_the_work(told, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *rest: None if name == "matplotlib" else found(name))
    for command in ("evaluate", "diagnose", "plot", "report"):
        assert "matplotlib is not installed: pip install 'sb3_bruno[zoo]'" in told(command)


def test_enjoy_without_a_display_names_what_works(run, told, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    run(*tiny("--eval-freq", -1, steps=64))
    assert "give --no-render, or make a video by `sb3-bruno record-video`" in told("enjoy", "--env", "PointDir-v0")
    assert run("enjoy", "--env", "PointDir-v0", "--no-render", "-n", 5)[1] == ""

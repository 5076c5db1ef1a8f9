"""What RL Zoo saves with a run is read as data, whoever wrote it."""

from collections import OrderedDict
from pathlib import Path

import pytest
import yaml
from stable_baselines3 import HerReplayBuffer
from torch import nn, optim

from sb3_bruno import BrunoEncoder
from sb3_bruno.zoo.saved_run import SavedRun
from sb3_bruno.zoo.saved_yaml import read_saved

ROOT = Path(__file__).parents[2]


def test_what_a_run_saves_comes_back(tmp_path):
    saved = OrderedDict(
        gamma=0.9,
        train_freq=(1, "episode"),
        policy_kwargs={"activation_fn": nn.ReLU, "optimizer_class": optim.Adam, "net_arch": [64, {"pi": []}]},
        encoder_class=BrunoEncoder,
        replay_buffer_class=HerReplayBuffer,
        inner=OrderedDict(a=None),
        empty=OrderedDict(),
    )
    (tmp_path / "config.yml").write_text(yaml.dump(saved))
    assert read_saved(tmp_path / "config.yml") == saved


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("!!python/object/apply:pathlib.Path.touch [&p !!python/object/apply:pathlib.Path [pwned]]", "could not deter"),
        ("a: !!python/object/apply:os.system ['touch pwned']", "could not determine a constructor"),
        ("a: !!python/object/new:subprocess.Popen [[touch, pwned]]", "could not determine a constructor"),
        ("a: !!python/module:antigravity", "could not determine a constructor"),
        ("a: !!python/name:os.system", "os.system is no network, optimiser or buffer"),
        ("a: !!python/name:subprocess.Popen", "subprocess.Popen is no network"),
        ("a: !!python/name:antigravity.geohash", "antigravity.geohash is no network"),
        ("a: !!python/name:eval", "eval is no network"),
        ("!!python/object/apply:collections.OrderedDict [3]", "not iterable"),
        ("a: [1", "ParserError"),
        ("[1, 2]", "it holds no settings by name"),
        ("", "it holds no settings by name"),
        ("a: \0", "ReaderError"),
        ('a: !!bool "x"', "KeyError"),
        ('a: !!timestamp "x"', "AttributeError"),
        ("a: " + "[" * 5_000, "RecursionError"),
        ("a: &a [1]\nb: [" + "*a, " * 30 + "]", "more than 20 aliases"),
        ("a: [" + "1, " * 100_000 + "]", "more than 200,000 bytes"),
    ],
)
@pytest.mark.parametrize("name", ["args.yml", "config.yml"])
def test_what_is_no_data_is_refused_and_nothing_is_called(name, text, problem, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for file in ("args.yml", "config.yml"):
        Path(file).write_text(text if file == name else "a: 1")
    with pytest.raises(ValueError, match=rf"{name} cannot be read: .*{problem}.*: train again"):
        SavedRun.load(tmp_path)
    assert not Path("pwned").exists()


@pytest.mark.parametrize("command", ["evaluate", "enjoy", "record-video"])
def test_no_command_calls_what_a_run_saved(command, run, tmp_path):
    folder = tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1"
    (folder / "PointDir-v0").mkdir(parents=True)
    (folder / "PointDir-v0.zip").touch()
    for file in ("args.yml", "config.yml"):
        (folder / "PointDir-v0" / file).write_text("a: !!python/object/apply:os.system ['touch pwned']")
    _, mistake = run(command, "--env", "PointDir-v0")
    assert "could not determine a constructor" in mistake and "\n" not in mistake
    assert not (tmp_path / "pwned").exists()


def test_nobody_reads_yaml_in_a_way_that_calls_what_it_holds():
    sources = [path for folder in ("sb3_bruno", "envs", "benchmarks") for path in (ROOT / folder).rglob("*.py")]
    words = ("unsafe_load", "full_load", "yaml.UnsafeLoader", "yaml.Loader", "yaml.FullLoader", " eval(", " exec(")
    assert not [(path.name, word) for path in sources for word in words if word in path.read_text()]


def test_a_config_that_a_run_names_is_not_imported(tmp_path, monkeypatch):
    (tmp_path / "evil").mkdir()
    (tmp_path / "evil" / "__init__.py").write_text("raise SystemExit('run')")
    monkeypatch.syspath_prepend(tmp_path)
    arguments = {"conf_file": "evil.x", "env_kwargs": {}, "hyperparams": {}}
    assert SavedRun(arguments, {"n_timesteps": 9}).choices("bruno_sac", "PointDir-v0")["params"] == {}

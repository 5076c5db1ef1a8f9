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
from sb3_bruno.zoo.trust import check_settings

ROOT = Path(__file__).parents[2]
TWICE = "\n".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]" for i in range(1, 10))
NEEDED = {"args.yml": {"conf_file": None, "env_kwargs": None, "hyperparams": None}, "config.yml": {"n_timesteps": 9}}


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
        ("a: &a [*a]", "or itself"),
        ("a0: &a0 [" + "1, " * 1_000 + "]\n" + TWICE, "more than 100,000 values"),
        ("a: !!python/name:%1B]0;owned%07", r"\\x1b\]0;owned\\x07 is no network"),
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


WRONG = {
    "args.yml": {
        "algo": (5, None, ["bruno_sac"]),
        "conf_file": (5, ["a.yml"], {}),
        "env_kwargs": (5, "x", [1], {5: 5}),
        "gym_packages": (5, "os", None, [5], [["os"]], {}),
        "hyperparams": (5, "x", [1]),
    },
    "config.yml": {
        "env_kwargs": (5, "x", {5: 5}),
        "env_wrapper": (5, {}, [5], [["a.B"]], {"a.B": 5}, {"a.B": None}, {"a.B": {}, "c.D": {}}, {5: {}}),
        "vec_env_wrapper": (5, {}),
        "normalize": (5, [True], {5: 5}),
    },
}


@pytest.mark.parametrize(
    ("file", "name", "value"),
    [(file, name, value) for file, names in WRONG.items() for name, values in names.items() for value in values],
)
def test_a_setting_of_a_wrong_kind_is_refused_by_file_name_and_value(file, name, value, tmp_path):
    for written, needed in NEEDED.items():
        settings = {**needed, name: value} if written == file else needed
        (tmp_path / written).write_text(yaml.dump(settings))
    with pytest.raises(ValueError, match=rf"{file} cannot be read: its {name} is .+, and not .+: train again"):
        SavedRun.load(tmp_path)


def test_a_setting_without_a_name_is_refused(tmp_path):
    for file, needed in NEEDED.items():
        (tmp_path / file).write_text(yaml.dump({**needed, 5: 5}))
    with pytest.raises(ValueError, match=r"args.yml cannot be read: it has the setting 5, which is no name"):
        SavedRun.load(tmp_path)


def test_what_json_has_no_value_for_is_told_as_text():
    hyperparams = {"n_timesteps": 9, "clip": float("inf"), "dims": {(1, 2): (3,)}, "net": nn.ReLU}
    told = SavedRun(NEEDED["args.yml"], hyperparams).choices("bruno_sac", "PointDir-v0")["hyperparameters"]
    assert told == {"n_timesteps": 9, "clip": "inf", "dims": {"(1, 2)": [3]}, "net": str(nn.ReLU)}


@pytest.mark.parametrize(
    ("hyperparams", "told"),
    [
        ({"env_wrapper": "sb3_bruno_envs.Nope"}, "the wrapper 'sb3_bruno_envs.Nope'"),
        ({"env_wrapper": "sb3_bruno_envs.__loader__"}, "the wrapper 'sb3_bruno_envs.__loader__'"),
        ({"env_wrapper": [{"sb3_bruno_envs.register_family": {}}]}, "the wrapper 'sb3_bruno_envs.register_family'"),
        ({"vec_env_wrapper": "sb3_bruno_envs.Trial"}, "the wrapper 'sb3_bruno_envs.Trial'"),
        ({"env_wrapper": "os\x1b[31m.x"}, r"the wrapper 'os\\x1b\[31m.x'"),
        ({"env_wrapper": {"sb3_bruno_envs.Trial": {"n_episodes": 10**8}}}, "'n_episodes'=100000000"),
        ({"env_kwargs": {"max_episode_steps": 10**12}}, "'max_episode_steps'=1000000000000, and .* 100,000 at most"),
        ({"env_kwargs": {"max_episode_steps": 1e12}}, "'max_episode_steps'="),
        ({"env_kwargs": {"tasks": [[1.0, float("nan")]]}}, "'tasks'=nan"),
    ],
)
def test_settings_of_others_have_nothing_run_but_our_wrappers_and_not_for_long(hyperparams, told):
    saved = SavedRun(NEEDED["args.yml"], {"n_timesteps": 9, "normalize": False, **hyperparams})
    with pytest.raises(ValueError, match=f"params asks for {told}.*--trust"):
        check_settings(saved, Path("params"))


def test_our_own_wrappers_need_no_trust():
    wrappers = [{"sb3_bruno_envs.Trial": {"n_episodes": 3}}, "sb3_bruno_envs.TransitionObservation"]
    hyperparams = {"normalize": True, "env_wrapper": wrappers, "env_kwargs": {"max_episode_steps": 1_000}}
    check_settings(SavedRun(NEEDED["args.yml"], hyperparams), Path("params"))


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

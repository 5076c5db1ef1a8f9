"""Commands prefer an agent file, and load no pickle from a folder that is not trusted."""

import pickle
import shutil
from pathlib import Path

import pytest
import yaml
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.save_util import load_from_zip_file
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno import BrunoSAC
from sb3_bruno.cli.main import main
from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.export import load_agent
from sb3_bruno.zoo.saved_yaml import read_saved
from support.tiny_runs import tiny

ENV = ["--env", "PointDir-v0"]
COMMANDS = [
    ["evaluate", "--episodes", 1, "--steps", 2],
    ["diagnose", "--episodes", 1, "--steps", 2],
    ["enjoy", "--no-render", "-n", 3],
    ["record-video", "-n", 3],
]
EACH = pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
OF_EACH_KIND = pytest.mark.parametrize(
    "command", COMMANDS[::2], ids=lambda command: command[0]
)  # the others share code
BEST = pytest.mark.parametrize("best", [[], ["--load-best"]], ids=["last", "best"])


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A log folder with a run, and its best model."""
    folder = tmp_path_factory.mktemp("trained") / "logs"
    main([*map(str, tiny("--eval-freq", 40, "-f", folder, steps=64)), "normalize:True"])
    return folder


@pytest.fixture
def elsewhere(trained, tmp_path):
    """A copy of that run in a folder that is not trusted."""
    shutil.copytree(trained, tmp_path / "downloads")
    return tmp_path / "downloads" / "bruno_sac" / "PointDir-v0_1"


@pytest.fixture
def no_pickles(monkeypatch):
    """Fail as soon as a pickle is loaded."""

    def refuse(*args, **kwargs):
        raise AssertionError("a pickle was loaded")

    for module, name in ((VecNormalize, "load"), (BaseAlgorithm, "load"), (pickle, "load"), (pickle, "loads")):
        monkeypatch.setattr(module, name, refuse)


def test_a_training_writes_it_beside_the_zip(trained):
    run = trained / "bruno_sac" / "PointDir-v0_1"
    for name, n_steps in (("PointDir-v0", 64), ("best_model", 40)):
        agent, model = load_agent(run / f"{name}.agent"), BrunoSAC.load(run / f"{name}.zip")
        assert agent.num_timesteps == model.num_timesteps == n_steps
        for weights, expected in zip(agent.policy.parameters(), model.policy.parameters(), strict=True):
            assert weights.equal(expected)


@EACH
@pytest.mark.usefixtures("no_pickles")
def test_commands_prefer_it(run, elsewhere, command):
    for path in (*elsewhere.glob("*.zip"), *elsewhere.rglob("*.pkl")):
        path.unlink()
    assert run(*command, *ENV, "-f", "downloads")[1] == ""


@OF_EACH_KIND
@pytest.mark.usefixtures("no_pickles")
def test_commands_prefer_that_of_the_best_model(run, elsewhere, command):
    (elsewhere / "PointDir-v0.agent").unlink()
    assert run(*command, *ENV, "-f", "downloads", "--load-best")[1] == ""


def test_a_test_of_it_is_a_test_of_the_zip(run, elsewhere):
    tests = []
    for _ in range(2):
        assert run("evaluate", *ENV, "-f", "downloads", "--episodes", 1, "--out", "out", "--trust")[1] == ""
        tests.append(AdaptationResult.load("out/adaptation.json"))
        (elsewhere / "PointDir-v0.agent").unlink(missing_ok=True)
    assert (tests[0].rewards == tests[1].rewards).all()
    assert tests[0].config == tests[1].config


@OF_EACH_KIND
@BEST
def test_a_pickle_elsewhere_needs_trust(run, elsewhere, command, best):
    for path in elsewhere.glob("*.agent"):
        path.unlink()
    mistake = run(*command, *ENV, "-f", "downloads", *best)[1]
    file = elsewhere / ("best_model.zip" if best else "PointDir-v0.zip")
    assert f"{file.relative_to(Path.cwd())} would be loaded as a pickle" in mistake
    assert "give --trust" in mistake and "\n" not in mistake
    assert run(*command, *ENV, "-f", "downloads", *best, "--trust")[1] == ""
    elsewhere.parents[1].rename(elsewhere.parents[2] / "logs")
    assert run(*command, *ENV, *best)[1] == ""


def test_an_agent_elsewhere_is_trained_on_with_trust(run, elsewhere):
    pretrained = elsewhere / "PointDir-v0.zip"
    assert "as a pickle" in run(*tiny("-i", pretrained, steps=64))[1]
    assert run(*tiny("-i", pretrained, "--trust", steps=64))[1] == ""


def test_a_folder_of_others_agents_is_not_fetched_without_trust(run):
    for command in COMMANDS[2:]:
        assert "as a pickle" in run(*command, *ENV, "-f", "rl-trained-agents")[1]


@OF_EACH_KIND
@pytest.mark.parametrize(
    ("file", "entries", "line"),
    [
        ("args.yml", {"gym_packages": ["antigravity"]}, "asks for the package 'antigravity'"),
        ("args.yml", {"env_kwargs": {"max_episode_steps": 10**12}}, "asks for 'max_episode_steps'=1000000000000"),
        ("config.yml", {"env_wrapper": "os.system"}, "asks for the wrapper 'os.system'"),
        ("config.yml", {"env_wrapper": [{"subprocess.Popen": {}}]}, "asks for the wrapper 'subprocess.Popen'"),
        ("config.yml", {"vec_env_wrapper": "builtins.eval"}, "asks for the wrapper 'builtins.eval'"),
        ("config.yml", {"normalize": "print('run')"}, "asks for the expression"),
    ],
)
def test_settings_elsewhere_have_no_code_run(run, elsewhere, command, file, entries, line):
    path = elsewhere / "PointDir-v0" / file
    saved = read_saved(path)
    path.write_text(yaml.dump({**saved, **entries}))
    printed, mistake = run(*command, *ENV, "-f", "downloads")
    assert line in mistake and "--trust" in mistake and "\n" not in mistake
    assert "run" not in printed


@OF_EACH_KIND
@pytest.mark.parametrize(
    ("file", "entries", "line"),
    [
        ("args.yml", {"env_kwargs": 5}, "args.yml cannot be read: its env_kwargs is 5"),
        ("args.yml", {"env_kwargs": {"id": "x"}}, "multiple values"),
        ("args.yml", {"env_kwargs": {"observe": 5}}, "observe=5 is unknown: use"),
        ("config.yml", {"env_wrapper": {"sb3_bruno_envs.Trial": {"x": 1}}}, "unexpected keyword argument 'x'"),
        ("config.yml", {"env_wrapper": "sb3_bruno_envs.Nope"}, "Nope"),
    ],
)
def test_settings_that_make_no_environment_are_told_in_one_line(run, elsewhere, command, file, entries, line):
    path = elsewhere / "PointDir-v0" / file
    path.write_text(yaml.dump({**read_saved(path), **entries}))
    mistake = run(*command, *ENV, "-f", "downloads", "--trust")[1]
    assert line in mistake and "\n" not in mistake


def test_our_own_wrappers_and_packages_that_are_named_need_no_trust(run, elsewhere):
    path = elsewhere / "PointDir-v0" / "args.yml"
    text = path.read_text()
    path.write_text(text.replace("- - gym_packages\n    - []", "- - gym_packages\n    - - colorsys"))
    assert text != path.read_text()
    assert "colorsys" in run("evaluate", *ENV, "-f", "downloads", "--episodes", 1, "--steps", 2)[1]
    named = ["--gym-packages", "colorsys"]
    assert run("evaluate", *ENV, "-f", "downloads", "--episodes", 1, "--steps", 2, *named)[1] == ""


def test_wrappers_of_packages_that_are_named_need_no_trust(run, elsewhere):
    path = elsewhere / "PointDir-v0" / "config.yml"
    saved, evaluate = read_saved(path), ["evaluate", *ENV, "-f", "downloads", "--episodes", 1, "--steps", 2]
    for wrapper, packages, mistaken in (
        ("gymnasium.wrappers.PassiveEnvChecker", ["gymnasium"], False),
        ("gymnasium.wrappers.PassiveEnvChecker", ["gym", "colorsys"], True),
        ("gymnasium.make", ["gymnasium"], True),  # is no wrapper
    ):
        path.write_text(yaml.dump({**saved, "env_wrapper": wrapper}))
        assert (f"asks for the wrapper '{wrapper}'" in run(*evaluate, "--gym-packages", *packages)[1]) == mistaken


def test_an_agent_of_another_algorithm_is_told(run, elsewhere):
    elsewhere.parent.rename(elsewhere.parents[1] / "pearl_sac")
    mistake = run("evaluate", "--algo", "pearl_sac", *ENV, "-f", "downloads")[1]
    assert "is an agent of BrunoSAC: give another --algo than pearl_sac" in mistake


def test_what_is_no_plain_data_ends_no_training(run, tmp_path):
    (tmp_path / "my.py").write_text(
        "from torch import nn\n"
        "policy_kwargs = dict(net_arch=[8], activation_fn=lambda: nn.ReLU())\n"
        "options = dict(policy='MlpPolicy', n_timesteps=64, learning_starts=60, policy_kwargs=policy_kwargs)\n"
        "hyperparams = {'PointDir-v0': options}\n"
    )
    with pytest.warns(UserWarning, match=r"PointDir-v0\.agent is not written, so there is the zip alone\. .*<lambda>"):
        assert run("train", *ENV, "-conf", "my.py", "--eval-freq", -1)[1] == ""
    run_folder = tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1"
    assert not (run_folder / "PointDir-v0.agent").exists()
    assert load_from_zip_file(run_folder / "PointDir-v0.zip")[0]["num_timesteps"] == 64

"""An environment of somebody's own: every command that needs it imports the package that registers it."""

import shlex
import sys

import gymnasium as gym
import numpy as np
import pytest
import yaml

from sb3_bruno.encoders import ENCODERS
from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.evaluation.eval_callback import load_learning_curve

PACKAGE = (
    "import gymnasium as gym\n"
    "from gymnasium.envs.registration import register\n"
    "register('Mine-v0', lambda **kwargs: gym.make('sb3_bruno_envs:PointDir-v0', **kwargs))\n"
)
TRAIN = ["train", "--env", "Mine-v0", "--gym-packages", "my_envs", "-conf", "my.yml"]
STUDY = ["--storage", "x.log", "--study-name", "s"]


def forget():
    """Be as a new process, which has not imported the package."""
    sys.modules.pop("my_envs", None)
    gym.registry.pop("Mine-v0", None)
    ENCODERS.pop("mine", None)


@pytest.fixture(autouse=True)
def package(tmp_path, monkeypatch):
    """The file of a package that registers Mine-v0, and a config of it."""
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "my_envs.py"
    file.write_text(PACKAGE)
    entry = {"n_timesteps": 64, "policy": "MlpPolicy", "learning_starts": 56, "buffer_size": 2_000, "batch_size": 16}
    (tmp_path / "my.yml").write_text(yaml.safe_dump({"Mine-v0": entry}))
    yield file
    forget()


def test_it_is_trained_evaluated_and_recorded(run, tmp_path):
    assert run(*TRAIN)[1] == ""
    for command, *flags in (["evaluate", "--episodes", 1], ["record-video", "-n", 5, "--gym-packages", "my_envs"]):
        forget()
        assert run(command, "--env", "Mine-v0", *flags)[1] == ""
    result = AdaptationResult.load(tmp_path / "logs" / "bruno_sac" / "Mine-v0_1" / "adaptation.json")
    np.testing.assert_array_equal(result.tasks, [[-1, 0], [1, 0]])


def test_it_is_searched_by_workers_that_import_it_themselves(run):
    flags = ["--env", "Mine-v0", "--gym-packages", "my_envs", "-conf", "my.yml", "-n", 64, "--n-evaluations", 1]
    assert run("sweep", "init", *STUDY, *flags)[1] == ""
    forget()
    printed, mistake = run("sweep", "run", *STUDY, "--max-total-trials", 1)
    assert mistake == "" and "1 complete" in printed


def test_the_line_that_a_sweep_ends_with_trains_as_it_stands(run, tmp_path):
    flags = ["--algo", "belief_sac", "--env", "my_envs:Mine-v0", "-conf", "my.yml", "-n", 64, "--n-evaluations", 1]
    printed, mistake = run("sweep", "init", *STUDY, *flags)
    assert mistake == ""
    start = shlex.split(printed.partition("start workers with sb3-bruno ")[2])
    assert run(*start, "--max-total-trials", 1)[1] == ""
    printed, mistake = run("sweep", "best", *STUDY, "--out", "the best.yml")
    assert mistake == ""
    line = printed.strip().rpartition("Saved the best.yml: ")[2]
    assert line == "sb3-bruno train --algo belief_sac --env my_envs:Mine-v0 -conf 'the best.yml'"
    forget()
    assert run(*shlex.split(line)[1:])[1] == ""
    assert (tmp_path / "logs" / "belief_sac" / "Mine-v0_1" / "Mine-v0.zip").is_file()


def test_the_line_names_all_packages(run, package, tmp_path):
    (tmp_path / "my_encoders.py").write_text("")
    flags = ["--env", "my_envs:Mine-v0", "--gym-packages", "my_encoders", "-conf", "my.yml", "-n", 64]
    run("sweep", "init", *STUDY, *flags, "--n-evaluations", 1)
    run("sweep", "run", *STUDY, "--max-total-trials", 1)
    line = run("sweep", "best", *STUDY)[0].strip().splitlines()[-1]
    assert line.endswith("train --algo bruno_sac --env Mine-v0 --gym-packages my_encoders my_envs -conf best.yml")


def test_a_family_is_evaluated_on_its_test_tasks_while_it_is_trained(run, package, tmp_path):
    package.write_text(
        "from sb3_bruno_envs import Family, PointDirEnv, TaskSet, register_family\n"
        "TASKS = TaskSet([[-1.0, 0.0], [1.0, 0.0]], [[0.0, 1.0], [0.6, 0.8], [-0.6, 0.8]])\n"
        "MINE = Family(PointDirEnv, TASKS, max_episode_steps=10)\n"
        "register_family('Mine-v0', MINE)\n"
    )
    assert run(*TRAIN, "--eval-freq", 64, "--eval-episodes", 1)[1] == ""
    curve = load_learning_curve(tmp_path / "logs" / "bruno_sac" / "Mine-v0_1")
    np.testing.assert_allclose(curve.tasks[0], [[0.0, 1.0], [0.6, 0.8], [-0.6, 0.8]], rtol=1e-6)


def test_an_encoder_that_the_package_names_is_searched_and_trained(run, package, tmp_path):
    named = "from sb3_bruno.encoders import ENCODERS, RecurrentEncoder\nENCODERS['mine'] = RecurrentEncoder\n"
    package.write_text(PACKAGE + named)
    entry = yaml.safe_load((tmp_path / "my.yml").read_text())["Mine-v0"]
    (tmp_path / "my.yml").write_text(yaml.safe_dump({"Mine-v0": {**entry, "encoder_class": "mine"}}))
    flags = ["--env", "Mine-v0", "--gym-packages", "my_envs"]
    init = ["sweep", "init", *STUDY, *flags, "-conf", "my.yml", "-n", 64, "--n-evaluations", 1]
    keep = ["sweep", "best", *STUDY]
    train = ["train", *flags, "-conf", "best.yml", "--eval-freq", -1]
    evaluate = ["evaluate", "--env", "Mine-v0", "--episodes", 1]
    for command in (init, ["sweep", "run", *STUDY, "--max-total-trials", 1], keep, train, evaluate):
        forget()
        assert run(*command)[1] == ""
    best = yaml.safe_load((tmp_path / "best.yml").read_text())["Mine-v0"]
    assert best["encoder_class"] == "mine" and best["encoder_kwargs"].keys() == {"cell", "hidden_size"}


@pytest.mark.parametrize("damage", [None, "import no_such_library", "1 / 0"], ids=["gone", "no library", "error"])
def test_a_package_that_cannot_be_imported_is_one_line(run, package, damage):
    assert run(*TRAIN, "--eval-freq", -1)[1] == ""
    flags = ["--env", "Mine-v0", "--gym-packages", "my_envs", "-conf", "my.yml", "-n", 64]
    assert run("sweep", "init", *STUDY, *flags)[1] == ""
    forget()
    package.write_text(damage) if damage else package.unlink()
    for command, *flags in (
        ["evaluate", "--env", "Mine-v0"],
        ["diagnose", "--env", "Mine-v0"],
        ["record-video", "--env", "Mine-v0", "--gym-packages", "my_envs"],
        ["sweep", "run", *STUDY],
    ):
        mistake = run(command, *flags)[1]
        assert mistake.startswith(f"sb3-bruno {command}: --gym-packages my_envs cannot be imported: ")
        assert "\n" not in mistake

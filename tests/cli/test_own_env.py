"""An environment of somebody's own, registered by any function: it needs no config, and no flag twice."""

import sys

import gymnasium as gym
import numpy as np
import pytest
import yaml

from sb3_bruno.diagnostics.result import Diagnostics
from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.evaluation.eval_callback import load_learning_curve
from support.tiny_runs import tiny

PACKAGE = """
import gymnasium as gym
from sb3_bruno_envs import MetaTask, PointDirEnv, TaskSet, TransitionObservation

TASKS = TaskSet([[1.0, 0.0], [0.8, 0.6]], [[-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])


def hide(env):
    return TransitionObservation(MetaTask(env, PointDirEnv.set_task, TASKS))


def make(render_mode=None):
    return hide(PointDirEnv(render_mode=render_mode))


gym.register("Own-v0", make, max_episode_steps=10)
gym.register("Bare-v0", PointDirEnv, max_episode_steps=10)
"""
TEST_TASKS = [[-1, 0], [0, 1], [0, -1]]


def forget():
    """Be as a new process, which has not imported the package."""
    sys.modules.pop("own_envs", None)
    for env_id in ("Own-v0", "Bare-v0"):
        gym.registry.pop(env_id, None)


@pytest.fixture(autouse=True)
def package(tmp_path, monkeypatch):
    """The package, which takes no ``split``, and whose test tasks lie outside the box of its training tasks."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "own_envs.py").write_text(PACKAGE)
    yield
    forget()


def test_it_is_trained_by_the_default_and_its_package_is_remembered(run, tmp_path, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    printed, mistake = run(*tiny("--gym-packages", "own_envs", "--checkpoint-freq", 240, env="Own-v0"))
    assert mistake == "", printed
    assert "bruno_sac.yml has no section of Own-v0: taking the one called default" in printed
    folder = tmp_path / "logs" / "bruno_sac" / "Own-v0_1"
    np.testing.assert_array_equal(np.unique(load_learning_curve(folder).tasks, axis=1)[0], sorted(TEST_TASKS))
    for command, *flags in (
        ["evaluate", "--episodes", 1],
        ["evaluate", "--episodes", 1, "--steps", 5],
        ["evaluate", "--episodes", 1, "--split", "train", "--stochastic"],
        ["diagnose", "--episodes", 2],
        ["enjoy", "-n", 5, "--no-render"],
        ["record-video", "-n", 5],
    ):
        forget()
        printed, mistake = run(command, "--env", "Own-v0", *flags)
        assert mistake == "", (command, printed)
    whole = AdaptationResult.load(folder / "adaptation.json")
    np.testing.assert_array_equal(whole.tasks, TEST_TASKS)
    assert whole.horizon == 10 and AdaptationResult.load(folder / "adaptation_5_steps.json").horizon == 5
    assert len(AdaptationResult.load(folder / "adaptation_train_tasks_stochastic.json").tasks) == 2
    found = Diagnostics.load(folder / "diagnostics.npz")
    assert (len(found.tasks), len(found.outside_tasks)) == (2, 3), (
        "all test tasks lie outside: the others are training's"
    )
    forget()
    assert run("train", "--resume", folder)[1] == ""


def test_its_package_may_be_named_with_it(run, tmp_path):
    assert run(*tiny("--eval-freq", -1, env="own_envs:Own-v0", steps=64))[1] == ""
    forget()
    assert run("evaluate", "--env", "own_envs:Own-v0", "--episodes", 1)[1] == ""
    assert (tmp_path / "logs" / "bruno_sac" / "Own-v0_1" / "adaptation.json").is_file()
    assert run(*tiny("--eval-freq", -1, env="sb3_bruno_envs:PointDir-v0", steps=64))[1] == ""


def test_the_wrapper_of_a_config_may_hide_the_task(run, tmp_path):
    config = {"policy": "MlpPolicy", "n_timesteps": 64, "env_wrapper": "own_envs.hide"}
    (tmp_path / "my.yml").write_text(yaml.safe_dump({"Bare-v0": config}))
    assert run(*tiny("-conf", "my.yml", "--eval-freq", 64, env="own_envs:Bare-v0", steps=64))[1] == ""
    curve = load_learning_curve(tmp_path / "logs" / "bruno_sac" / "Bare-v0_1")
    np.testing.assert_array_equal(np.unique(curve.tasks[0], axis=0), sorted(TEST_TASKS))
    assert run("evaluate", "--env", "Bare-v0", "--episodes", 1)[1] == ""

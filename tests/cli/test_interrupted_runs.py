"""A training that is interrupted or killed can be resumed, is not taken for a finished one, and disturbs no other."""

import argparse
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import torch as th
from stable_baselines3.common.monitor import load_results

from sb3_bruno import BrunoSAC
from sb3_bruno.evaluation.eval_callback import load_learning_curve
from sb3_bruno.resume import ResumeCallback
from sb3_bruno.resume.interrupt import InterruptibleResumeCallback
from sb3_bruno.runs.folder import RunFolder, is_unfinished
from sb3_bruno.runs.origin import ORIGIN, trained_at
from sb3_bruno.zoo.experiment import TaskExperiment
from sb3_bruno.zoo.registry import register
from sb3_bruno.zoo.trained import load_trained
from support.commands import ended, start
from support.tiny_runs import tiny


@pytest.fixture
def interrupted(monkeypatch):
    """Have a number of signals sent to this process after 200 env steps."""

    def interrupt(number, times=1):
        step = InterruptibleResumeCallback._on_step

        def send(callback):
            if callback.num_timesteps == 200:
                for _ in range(times):
                    os.kill(os.getpid(), number)
            return step(callback)

        monkeypatch.setattr(InterruptibleResumeCallback, "_on_step", send)

    return interrupt


def test_an_interrupted_run_tells_how_to_go_on_and_does_so(run, tmp_path, interrupted, monkeypatch):
    whole, parts = (tmp_path / "logs" / "bruno_sac" / f"PointDir-v0_{i}" for i in (1, 2))
    assert run(*tiny("--eval-freq", -1, steps=64))[1] == ""
    interrupted(signal.SIGTERM)
    printed, code = run(*tiny("--eval-freq", -1, steps=216))
    assert code == "130"
    assert "Interrupted at 200 of 216 env steps: go on by `sb3-bruno train --resume logs/bruno_sac/PointDir" in printed
    assert is_unfinished(parts) and not is_unfinished(whole)
    with pytest.warns(UserWarning, match=r"PointDir-v0_2 is unfinished: .* Taken instead: .*PointDir-v0_1"):
        assert load_trained("bruno_sac", "PointDir-v0").folder.name == whole.name
    with pytest.warns(UserWarning, match=r"PointDir-v0_2 is unfinished: this is the agent as it was"):
        assert load_trained("bruno_sac", "PointDir-v0", exp_id=2).folder.name == parts.name
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    assert "Going on at 200 of 216" in run("train", "--resume", parts)[0]
    assert not is_unfinished(parts)
    assert BrunoSAC.load(parts / "PointDir-v0.zip").num_timesteps == 216


def test_an_interrupt_without_a_checkpoint_says_that_there_is_none(run, tmp_path, interrupted):
    interrupted(signal.SIGINT, times=2)
    printed, code = run(*tiny("--eval-freq", -1))
    assert code == "130" and "train anew, for it saved no checkpoint" in printed
    mistake = run("evaluate", "--env", "PointDir-v0")[1]
    assert "PointDir-v0_1 is unfinished: go on with it by" in mistake and "\n" not in mistake
    assert "PointDir-v0_1 is unfinished" in run("enjoy", "--env", "PointDir-v0", "--no-render", "-n", 5)[1]


def test_an_interrupt_before_the_training_leaves_no_folder(run, tmp_path, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(BrunoSAC, "_setup_model", interrupt)
    assert run(*tiny("--eval-freq", -1))[1] == "130"
    assert not list(tmp_path.iterdir())


def test_two_trainings_that_start_together_have_folders_of_their_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    register()
    names = argparse.Namespace(), "bruno_sac", "PointDir-v0", "logs"
    first, second = (TaskExperiment(*names, eval_freq=0, verbose=0, seed=0, device="cpu") for _ in range(2))
    assert first.save_path == second.save_path
    first.setup_experiment()
    (tmp_path / first.save_path / "agent.zip").touch()
    monkeypatch.setattr(BrunoSAC, "_setup_model", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        second.setup_experiment()
    assert second.save_path.endswith("PointDir-v0_2") and second.params_path.startswith(second.save_path)
    assert (tmp_path / first.save_path / "agent.zip").exists() and not os.path.exists(second.save_path)


def test_a_run_in_use_is_not_resumed(run, tmp_path):
    run(*tiny("--checkpoint-freq", 200))
    folder = tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1"
    held = RunFolder(folder)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    mistake = run("train", "--resume", folder)[1]
    assert f"{folder} is in use: process {os.getpid()} on" in mistake and "\n" not in mistake
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
    held.release()
    assert run("train", "--resume", folder)[1] == ""


@pytest.mark.slow
def test_ctrl_c_in_a_terminal_reaches_the_training_and_not_its_subprocesses(run, tmp_path):
    arguments = [*map(str, tiny("--vec-env", "subproc", "--eval-freq", -1, steps=100_000)), "n_envs:2"]
    command = [sys.executable, "-c", "from sb3_bruno.cli import console; console()", *arguments]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True, start_new_session=True)
    folder = tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1"
    while process.poll() is None and not is_unfinished(folder):
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to all processes
    printed, _ = process.communicate()
    assert process.returncode == 130 and f"--resume logs/bruno_sac/{folder.name}" in printed
    assert (folder / "checkpoint.pkl").is_file()


def die_at_280():
    """Be a training that is killed after 280 env steps."""
    plain = ResumeCallback._on_step

    def die(callback):
        if callback.num_timesteps == 280:
            os.kill(os.getpid(), signal.SIGKILL)
        return plain(callback)

    ResumeCallback._on_step = die


def test_a_killed_run_is_resumed_exactly(run, tmp_path):
    arguments = tiny("--checkpoint-freq", 160)
    run(*arguments)
    whole, parts = (tmp_path / "logs" / "bruno_sac" / f"PointDir-v0_{i}" for i in (1, 2))
    assert ended(start(*arguments, prepare=die_at_280)) == -signal.SIGKILL
    killed_at = (parts / "checkpoint.pkl").stat().st_mtime_ns
    printed, mistake = run("train", "--resume", parts)
    assert mistake == "" and "at 160 of 480 env steps" in printed
    assert (parts / "checkpoint.pkl").stat().st_mtime_ns > killed_at  # its own --checkpoint-freq, not the default
    origins = [json.loads((folder / ORIGIN).read_text()) for folder in (whole, parts)]
    assert origins[0]["command"] == origins[1]["command"]
    assert [len(origin["versions"]) for origin in origins] == [1, 2]
    assert trained_at(whole) == trained_at(parts) and len(trained_at(parts)) == 1
    uninterrupted, resumed = (BrunoSAC.load(folder / "PointDir-v0.zip") for folder in (whole, parts))
    for name, value in uninterrupted.policy.state_dict().items():
        assert th.equal(value, resumed.policy.state_dict()[name]), name
    for expected, found in zip(load_learning_curve(whole), load_learning_curve(parts), strict=True):
        np.testing.assert_array_equal(found, expected)
    returns = [np.sort(load_results(str(folder)).r) for folder in (whole, parts)]
    np.testing.assert_array_equal(*returns)

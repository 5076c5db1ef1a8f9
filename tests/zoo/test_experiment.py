"""A training run is told what it needs by its arguments, and leaves nothing behind for the next one."""

import argparse

import pytest
import rl_zoo3.train
from rl_zoo3.exp_manager import ExperimentManager

from sb3_bruno import BrunoSAC
from sb3_bruno.zoo.experiment import RunOptions, TaskExperiment
from sb3_bruno.zoo.registry import register
from support.tiny_runs import tiny


def test_a_resumed_run_says_nothing_to_the_next_one(run, tmp_path):
    assert run(*tiny("--checkpoint-freq", 200))[1] == ""
    assert run("train", "--resume", tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1")[1] == ""
    assert rl_zoo3.train.ExperimentManager is ExperimentManager
    experiment = TaskExperiment(argparse.Namespace(), "bruno_sac", "PointDir-v0", "logs")
    assert experiment.save_path.endswith("PointDir-v0_2")


def test_two_experiments_have_options_of_their_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    register()
    for checkpoint_freq, n_checkpoints in ((500, 1), (0, 0)):
        options = RunOptions(checkpoint_freq)
        experiment = TaskExperiment(
            argparse.Namespace(), "bruno_sac", "PointDir-v0", "logs", eval_freq=0, options=options, verbose=0
        )
        experiment.create_callbacks()
        assert [callback.save_freq for callback in experiment.callbacks] == [checkpoint_freq] * n_checkpoints


def test_an_error_after_the_start_keeps_its_traceback(run, monkeypatch):
    def fail(self, *args, **kwargs):
        raise ValueError("no disk")

    monkeypatch.setattr(BrunoSAC, "learn", fail)
    with pytest.raises(ValueError, match="no disk"):
        run(*tiny("--eval-freq", -1))

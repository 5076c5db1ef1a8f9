"""A training that finds the disk full goes on while it can, and ends in a line that names the run and how to go on."""

import resource

import pytest

from sb3_bruno.evaluation.eval_callback import load_learning_curve
from sb3_bruno.resume.interrupt import InterruptibleResumeCallback
from sb3_bruno.runs.folder import is_unfinished
from support.full_disk import full_disk
from support.tiny_runs import tiny


@pytest.mark.filterwarnings("ignore:.*agent is not written")
def test_it_is_resumed_from_the_last_checkpoint_once_there_is_room(run, tmp_path, monkeypatch):
    step, room = InterruptibleResumeCallback._on_step, resource.getrlimit(resource.RLIMIT_FSIZE)[1]

    def fill(callback):
        if callback.num_timesteps == 200:
            resource.setrlimit(resource.RLIMIT_FSIZE, (5_000, room))
        return step(callback)

    monkeypatch.setattr(InterruptibleResumeCallback, "_on_step", fill)
    with full_disk(room), pytest.warns(UserWarning, match="no checkpoint at 240 env steps, for path=logs/bruno_sac/"):
        mistake = run(*tiny("--checkpoint-freq", 80))[1]
    folder = "logs/bruno_sac/PointDir-v0_1"
    problem = f"sb3-bruno train: {folder} cannot be written (File too large): free some space"
    assert mistake == f"{problem}, then go on by `sb3-bruno train --resume {folder}`."
    assert is_unfinished(tmp_path / folder) and not list((tmp_path / folder).glob(".unfinished*"))
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    printed, mistake = run("train", "--resume", folder)
    assert mistake == "" and "Going on at 160 of 480" in printed
    assert not is_unfinished(tmp_path / folder)
    assert load_learning_curve(tmp_path / folder).timesteps.tolist() == [240, 480]

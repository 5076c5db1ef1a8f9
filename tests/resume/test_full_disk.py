"""A checkpoint that the disk has no room for does not end a training, and costs nothing that was saved before."""

import os
import signal

import pytest
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import EveryNTimesteps

from sb3_bruno.files.whole import NotWritten
from sb3_bruno.resume import ResumeCallback, resume
from sb3_bruno.resume.interrupt import InterruptibleResumeCallback
from support.full_disk import full_disk
from support.tiny_models import make_point


@pytest.fixture
def model():
    kwargs = {"train_freq": 7, "learning_starts": 200, "buffer_size": 200}
    return SAC("MultiInputPolicy", make_point(), policy_kwargs={"net_arch": [8]}, seed=0, **kwargs)


KINDS = {
    "called by learn": lambda path: ResumeCallback(path, 20),
    "child of an event": lambda path: EveryNTimesteps(20, ResumeCallback(path)),
}


@pytest.mark.parametrize("kind", KINDS)
def test_training_goes_on_and_the_older_checkpoint_stays_until_there_is_room(tmp_path, model, kind):
    path, callback = tmp_path / "checkpoint.pkl", KINDS[kind](tmp_path / "checkpoint.pkl")
    model.learn(28, callback)
    older = path.read_bytes()
    told = rf"no checkpoint at 4\d env steps, for path={path} cannot be written \(File too large\): free some space"
    with full_disk(), pytest.warns(UserWarning, match=f"{told}. Training goes on, and tries again at the next"):
        model.learn(28, callback, reset_num_timesteps=False)
    assert model.num_timesteps == 56 and path.read_bytes() == older and list(tmp_path.iterdir()) == [path]
    model.learn(28, callback, reset_num_timesteps=False)
    assert resume(path, make_point()).num_timesteps > 56


@pytest.mark.parametrize(
    ("has_older", "remedy"), [(True, "then resume from the older"), (False, "then train anew, for there is no older")]
)
def test_an_interrupt_whose_checkpoint_finds_no_room_is_an_error(tmp_path, model, has_older, remedy):
    class Interrupted(InterruptibleResumeCallback):
        def _on_step(self):
            if self.num_timesteps == 10:
                os.kill(os.getpid(), signal.SIGINT)
            return super()._on_step()

    path = tmp_path / "checkpoint.pkl"
    if has_older:
        path.write_bytes(b"older")
    callback = Interrupted(path)
    told = rf"path={path} cannot be written \(File too large\): free some space, {remedy}"
    with full_disk(), pytest.raises(NotWritten, match=told), callback.listening():
        model.learn(28, callback)
    assert [file.read_bytes() for file in tmp_path.iterdir()] == ([b"older"] if has_older else [])

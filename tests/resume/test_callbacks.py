"""A ResumeCallback saves wherever SB3 calls it from, always at the start of a rollout, and when it is interrupted."""

import os
import signal

import numpy as np
import pytest
import torch as th
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback, CallbackList, EvalCallback, EveryNTimesteps

from sb3_bruno import RecurrentSAC
from sb3_bruno.resume import ResumeCallback, resume
from sb3_bruno.resume.interrupt import InterruptibleResumeCallback
from support.tiny_models import make_point, tiny

STEPS = 90
SLOW = {"train_freq": 7, "learning_starts": 20, "buffer_size": 200}  # most steps are in the middle of a rollout


def recurrent():
    return RecurrentSAC("MlpPolicy", make_point(), **tiny(RecurrentSAC, **SLOW))


def plain():
    return SAC("MultiInputPolicy", make_point(), policy_kwargs={"net_arch": [8]}, seed=0, **SLOW)


def assert_same_weights(found, expected):
    for name, value in expected.policy.state_dict().items():
        assert th.equal(value, found.policy.state_dict()[name]), name


@pytest.fixture(scope="module")
def whole():
    return recurrent().learn(STEPS)


def evaluating(**kwargs):
    return EvalCallback(make_point(), eval_freq=40, n_eval_episodes=1, verbose=0, **kwargs)


class OnEvenCalls(BaseCallback):
    """A user's own, which calls its child as SB3's event callbacks do."""

    def __init__(self, child):
        super().__init__()
        self.child = child

    def _init_callback(self):
        self.child.init_callback(self.model)

    def _on_step(self):
        return self.n_calls % 2 == 1 or self.child.on_step()


NESTS = {
    "EveryNTimesteps": lambda child: EveryNTimesteps(40, child),
    "in a list": lambda child: [evaluating(), EveryNTimesteps(40, child)],
    "list in EveryNTimesteps": lambda child: EveryNTimesteps(40, CallbackList([child])),
    "after an evaluation": lambda child: evaluating(callback_after_eval=child),
    "on a new best": lambda child: CallbackList([evaluating(callback_on_new_best=child)]),
    "list on a new best": lambda child: evaluating(callback_on_new_best=CallbackList([child])),
    "event in event": lambda child: EveryNTimesteps(20, EveryNTimesteps(40, child)),
}


@pytest.mark.parametrize("nest", NESTS)
@pytest.mark.filterwarnings("ignore:Training and eval env")
def test_a_child_of_an_event_saves_at_the_start_of_the_next_rollout(tmp_path, whole, nest):
    path = tmp_path / "checkpoint.pkl"
    recurrent().learn(50, NESTS[nest](ResumeCallback(path)))
    resumed = resume(path, make_point())
    assert resumed.num_timesteps == 42, "the first multiple of 7 after step 40"
    evaluates = "evaluation" in nest or "best" in nest or "in a list" in nest
    if not evaluates:  # an evaluation draws random numbers
        assert_same_weights(resumed.learn(STEPS - 42, reset_num_timesteps=False), whole)


def test_two_children_of_one_event_both_save_and_sb3s_algorithms_are_served_alike(tmp_path):
    paths = [tmp_path / "a.pkl", tmp_path / "b.pkl"]
    model = plain()
    model.learn(50, EveryNTimesteps(40, CallbackList([ResumeCallback(path) for path in paths])))
    for path in paths:
        assert resume(path, make_point()).num_timesteps == 42


def test_a_model_that_is_saved_between_event_and_rollout_is_unharmed(tmp_path):
    class Save(BaseCallback):
        def _on_step(self):
            self.model.save(tmp_path / "model.zip")
            return True

    model = plain()
    model.learn(45, EveryNTimesteps(40, CallbackList([ResumeCallback(tmp_path / "checkpoint.pkl"), Save()])))
    SAC.load(tmp_path / "model.zip")


def test_a_second_learn_saves_again(tmp_path):
    path = tmp_path / "checkpoint.pkl"
    callback = EveryNTimesteps(20, ResumeCallback(path))
    model = plain()
    for argument, saved_at in ((callback, 21), (callback, 42), ([callback], 63)):  # events at 20, 40, 60
        model.learn(28, argument, reset_num_timesteps=False)
        assert resume(path, make_point()).num_timesteps == saved_at


def test_a_callback_that_tells_nothing_of_rollouts_is_refused_with_a_remedy(tmp_path):
    with pytest.raises(ValueError, match="beside that callback"):
        plain().learn(5, OnEvenCalls(ResumeCallback(tmp_path / "checkpoint.pkl")))


class Send(BaseCallback):
    """Sends this process a signal at some step, as a terminal or a scheduler does."""

    def __init__(self, number, at, times=1):
        super().__init__()
        self.number, self.at, self.times = number, at, times

    def _on_step(self):
        if self.num_timesteps == self.at:
            for _ in range(self.times):
                os.kill(os.getpid(), self.number)
        return True


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_goes_on_exactly_though_no_checkpoint_was_due(tmp_path, whole, number):
    path = tmp_path / "checkpoint.pkl"
    callback = InterruptibleResumeCallback(path, 10_000)
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), callback.listening():
        recurrent().learn(STEPS, [callback, Send(number, at=38)])
    assert signal.getsignal(number) is before
    resumed = resume(path, make_point())
    assert resumed.num_timesteps == 42
    assert_same_weights(resumed.learn(STEPS - 42, reset_num_timesteps=False), whole)


def test_a_second_interrupt_stops_at_once(tmp_path):
    path = tmp_path / "checkpoint.pkl"
    callback, model = InterruptibleResumeCallback(path, 10_000), plain()
    with pytest.raises(KeyboardInterrupt), callback.listening():
        model.learn(STEPS, [callback, Send(signal.SIGINT, at=38, times=2)])
    assert model.num_timesteps == 38 and not path.exists()


def test_signals_that_are_ignored_stay_so(tmp_path):
    callback, model = InterruptibleResumeCallback(tmp_path / "checkpoint.pkl", 10_000), plain()
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as in the background of a script
    try:
        with callback.listening():
            model.learn(42, [callback, Send(signal.SIGINT, at=20)])
    finally:
        signal.signal(signal.SIGINT, before)
    assert model.num_timesteps == 42 and np.isfinite(model.replay_buffer.rewards).all()


@pytest.mark.parametrize("name", [".", "file/checkpoint.pkl", 300 * "a"], ids=["a folder", "in a file", "too long"])
def test_a_path_that_cannot_be_written_is_refused_before_the_training(tmp_path, name):
    (tmp_path / "file").touch()
    model = RecurrentSAC("MlpPolicy", make_point(), **tiny(RecurrentSAC))
    with pytest.raises(ValueError, match=r"path=.* cannot be written \(.*\): give another file"):
        model.learn(10, ResumeCallback(tmp_path / name, save_freq=20))
    assert model.num_timesteps == 0 and [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("path", [None, 5, b"checkpoint.pkl"])
def test_a_path_that_is_none_is_refused(path):
    with pytest.raises(ValueError, match=f"path={path!r} is no path: give the name of the checkpoint file"):
        ResumeCallback(path, 5)


@pytest.mark.parametrize("save_freq", ["a", True, None, 0, np.nan])
def test_a_frequency_that_counts_no_steps_is_refused(save_freq):
    with pytest.raises(ValueError, match=f"save_freq={save_freq!r} is not positive: give the env steps between two"):
        ResumeCallback("checkpoint.pkl", save_freq)


def test_a_checkpoint_that_is_there_stays_until_the_next(tmp_path):
    path = tmp_path / "checkpoint.pkl"
    path.write_bytes(b"older")
    RecurrentSAC("MlpPolicy", make_point(), **tiny(RecurrentSAC)).learn(10, ResumeCallback(path, save_freq=20))
    assert path.read_bytes() == b"older"


def test_what_cannot_be_saved_is_named(tmp_path):
    model = plain()
    model.phone = (step for step in range(3))  # a generator
    with pytest.raises(ValueError, match=r"attributes \['phone'\] cannot be pickled .*: keep them elsewhere"):
        model.learn(50, ResumeCallback(tmp_path / "checkpoint.pkl", 20))
    assert not list(tmp_path.iterdir())

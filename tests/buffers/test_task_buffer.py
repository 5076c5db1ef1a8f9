"""The task buffer, filled with observation = number of the transition, so that a wrong row shows."""

import copy
import pickle

import numpy as np
import pytest
import torch as th
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.buffers.extended_obs import ExtendedObs
from sb3_bruno.buffers.task_ring import _RING as RING
from sb3_bruno.encoders import BrunoEncoder
from support.stream import LAYOUT, Recorder, Stream


@pytest.mark.parametrize("context", ["iid", "recent", "episode"])
@pytest.mark.parametrize("n_envs", [1, 3])
@pytest.mark.parametrize("steps", [5, 33, 34, 90])  # before, at and after the ring of 100 // 3 rows is full
def test_samples_are_whole_transitions_of_their_task(context, n_envs, steps):
    stream = Stream(n_envs, context=context, n_sequences=4, sequence_length=8)
    for step in range(steps):
        tasks = [(step // 7 + env) % 3 for env in range(n_envs)]
        stream.add(tasks, dones=[step % 7 == 6] * n_envs)
    live = range(max(0, stream.count - stream.buffer.buffer_size * n_envs), stream.count)
    for _ in range(20):
        numbers, _ = stream.check(stream.buffer.sample(32))
        assert set(numbers) <= set(live)


def test_every_transition_can_be_drawn_and_none_is_lost():
    stream = Stream(2, n_sequences=4, sequence_length=8)
    for step in range(40):
        stream.add([step // 20, 2], dones=[step == 19, False])
    drawn = np.concatenate([stream.check(stream.buffer.sample(32))[0] for _ in range(150)])
    assert set(drawn) == set(range(80))


def test_tasks_are_equally_likely_and_transitions_uniform_within():
    stream = Stream(n_sequences=8, sequence_length=8)
    for step in range(90):
        stream.add([float(step >= 80)])
    drawn = np.concatenate([stream.check(stream.buffer.sample(64))[0] for _ in range(300)])
    assert 0.45 < np.mean(drawn >= 80) < 0.55
    counts = np.bincount(drawn[drawn < 80], minlength=80)
    assert counts.min() / counts.mean() > 0.6 and counts.max() / counts.mean() < 1.5


def test_context_sizes_of_exchangeable_sequences_are_uniform_from_nothing():
    stream = Stream(n_sequences=8, sequence_length=8)
    for _ in range(50):
        stream.add([0])
    sizes = np.concatenate([stream.check(stream.buffer.sample(64))[1][:, 0] for _ in range(20)])
    np.testing.assert_array_equal(np.bincount(sizes.astype(int)), [160] * 8)


def test_recent_context_reaches_back_so_far_and_no_further():
    stream = Stream(context="recent", n_recent=10, n_sequences=4, sequence_length=16)
    for step in range(60):
        stream.add([step % 2])
    numbers = np.concatenate([stream.check(stream.buffer.sample(64))[0] for _ in range(20)])
    assert set(numbers) == set(range(40, 60))


def test_the_caller_keeps_the_observations_that_it_gave():
    stream, shown = Stream(), np.full((1, 1), 7.0, np.float32)
    info = {"task": [0], "trial_final_observation": np.float32([3.0])}
    stream.buffer.add({"observation": shown}, {"observation": shown}, shown, shown[0], np.array([False]), [info])
    assert shown == 7.0
    assert stream.buffer.next_observations[0] == 3.0


def test_a_time_limit_is_no_termination():
    stream = Stream(n_sequences=1)
    stream.add([0], dones=[True], timeouts=[True]).add([0], dones=[True])
    samples = stream.buffer.sample(64)
    numbers, _ = stream.check(samples)
    np.testing.assert_array_equal(samples.dones[:, 0], numbers == 1)


def test_an_evicted_task_is_no_longer_drawn():
    stream = Stream(buffer_size=10, n_sequences=4)
    for step in range(25):
        stream.add([step // 5])
    assert len(stream.buffer.tasks) == 2
    numbers, _ = stream.check(stream.buffer.sample(64))
    assert numbers.min() >= 15


def test_minus_zero_is_zero():
    stream = Stream()
    stream.add([0.0]).add([-0.0])
    assert len(stream.buffer.tasks) == 1


@pytest.mark.parametrize("batch_size", [1, 3, 16, 50, 200])
def test_batch_size_is_the_number_of_transitions(batch_size):
    stream = Stream(n_sequences=16, sequence_length=8)
    for _ in range(30):
        stream.add([0])
    assert len(stream.check(stream.buffer.sample(batch_size))[0]) == batch_size


def copy_of(stream, buffer):
    """The same stream into another buffer."""
    other = copy.copy(stream)
    other.buffer = buffer
    return other


def test_pickling_keeps_everything_but_the_encoder():
    stream = Stream(2, context="episode")
    for step in range(30):
        stream.add([step // 10, 5], dones=[step % 10 == 9, False], inner_ends=[False, step % 8 == 3])
    copied = pickle.loads(pickle.dumps(stream.buffer))
    with pytest.raises(RuntimeError, match="bind_buffer"):
        copied.sample(4)
    copied.set_encoder(Recorder(), LAYOUT)
    for _ in range(5):
        for one, two in zip(stream.buffer.sample(32), copied.sample(32), strict=True):
            if one is not None:
                assert th.equal(one, two)
    for each in (stream, copy_of(stream, copied)):  # and both go on alike, over the end of the ring
        for step in range(60):
            each.add([step, 5], dones=[step % 7 == 0, False], inner_ends=[step % 7 == 3, False])
    for name in RING:
        np.testing.assert_array_equal(getattr(stream.buffer, name), getattr(copied, name))


def test_an_empty_ring_takes_no_room_in_a_file():
    small = Stream(buffer_size=1_000_000)
    small.add([0])
    assert len(pickle.dumps(small.buffer)) < 5_000_000  # the index knows every slot; the ring would take 40 MB more


def test_samples_are_normalised_as_the_agent_observes():
    class Normalize(VecNormalize):
        def __init__(self):
            self.norm_obs = self.norm_reward = True
            self.norm_obs_keys = ["observation", "reward"]
            rms = {"observation": (2.0, 4.0), "reward": (30.0, 100.0)}
            self.obs_rms = {key: type("Rms", (), {"mean": mean, "var": var}) for key, (mean, var) in rms.items()}
            self.ret_rms = type("Rms", (), {"var": 25.0})
            self.epsilon, self.clip_obs, self.clip_reward = 0.0, 1e6, 1e6

    stream = Stream()
    for _ in range(5):
        stream.add([0])
    slots = np.arange(5)
    transitions = stream.buffer.transitions(slots, Normalize())
    np.testing.assert_allclose(transitions.observations[:, 0], (slots - 2) / 2)
    np.testing.assert_allclose(transitions.next_observations[:, 0], (slots + 0.5 - 2) / 2)
    np.testing.assert_allclose(transitions.rewards[:, 0], (10 * slots - 30) / 10)
    np.testing.assert_allclose(transitions.actions[:, 0], slots / 1_000)  # not among the keys
    samples = stream.buffer.sample(32, Normalize())
    number = samples.observations[:, 0] * 2 + 2
    np.testing.assert_allclose(samples.rewards[:, 0], number * 10 / 5, rtol=1e-5)


@pytest.mark.parametrize("context", ["iid", "recent"])
def test_no_belief_rests_on_the_transition_that_it_is_used_at(context):
    stream = Stream(context=context, n_sequences=2, sequence_length=20, n_recent=25)
    for step in range(60):
        stream.add([step % 2])  # thirty of each
    for _ in range(20):
        slots = stream.buffer._exchangeable_rows(2)[0].slots
        assert all(len(set(row)) == 20 for row in slots.tolist())
    few = Stream(context=context, n_sequences=2, sequence_length=20, n_recent=25)
    few.add([0]).add([0])
    assert set(few.buffer._exchangeable_rows(2)[0].slots.ravel()) == {0, 1}  # too few: some are drawn more than once


def test_samples_rest_on_the_encoder_of_the_moment():
    stream = Stream(n_sequences=2)
    for _ in range(20):
        stream.add([0])
    encoder = BrunoEncoder(1, 1, process="gaussian", belief="mean_var")  # variances of the process alone
    layout = ExtendedObs(1, encoder.belief_dim, 1)
    stream.buffer.set_encoder(encoder, layout)
    before = stream.buffer.sample(64).next_observations[:, layout.belief]
    with th.no_grad():
        encoder.process.log_var.add_(3.0)
    stream.buffer.forget_beliefs()
    after = stream.buffer.sample(64).next_observations[:, layout.belief]
    assert after[:, -1].mean() > 5 * before[:, -1].mean()


def test_one_encode_serves_samples_until_its_steps_are_used_up_or_the_data_change():
    stream = Stream(n_sequences=4, sequence_length=8)
    for _ in range(50):
        stream.add([0])
    encodes = []
    encode = stream.buffer._encode
    stream.buffer._encode = lambda *args: encodes.append(args) or encode(*args)
    sizes = np.concatenate([stream.check(stream.buffer.sample(16))[1][:, 0] for _ in range(2)])
    assert len(encodes) == 1
    assert np.bincount(sizes.astype(int)).tolist() == [4] * 8  # every step of the four sequences, once
    stream.buffer.sample(16)
    assert len(encodes) == 2
    stream.add([0]).buffer.sample(16)
    assert len(encodes) == 3


def test_a_step_without_a_task_is_refused():
    stream = Stream()
    with pytest.raises(ValueError, match='no "task"'):
        stream.buffer.add(
            {"observation": np.zeros((1, 1))},
            {"observation": np.zeros((1, 1))},
            *[np.zeros((1, 1))] * 2,
            [False],
            [{}],
        )
    assert stream.buffer.size() == 0 and len(stream.buffer.tasks) == 0


def test_an_empty_buffer_says_so():
    stream = Stream()
    with pytest.raises(RuntimeError, match="empty"):
        stream.buffer.sample(4)
    stream.add([0])
    stream.buffer.reset()
    with pytest.raises(RuntimeError, match="empty"):
        stream.buffer.sample_sequences(4)


@pytest.mark.parametrize(
    "bad",
    [
        {"n_sequences": 0},
        {"sequence_length": 0},
        {"n_recent": 0},
        {"context": "last"},
        {"optimize_memory_usage": True},
    ],
)
def test_bad_arguments_are_named(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        Stream(**bad)

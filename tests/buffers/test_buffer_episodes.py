"""The task buffer's episodes: contexts of what the agent itself had seen, trials, and episodes that still run."""

import pickle

import numpy as np
import pytest

from support.stream import LAYOUT, Recorder, Stream


@pytest.mark.parametrize("n_envs", [1, 3])
def test_episode_context_is_what_the_agent_itself_had_seen(n_envs):
    stream = Stream(n_envs, 150, context="episode", n_sequences=4)
    for step in range(40):
        phases = [step + 2 * env for env in range(n_envs)]  # episodes of 9 steps that end at different times
        stream.add([env + phase // 9 for env, phase in enumerate(phases)], dones=[phase % 9 == 8 for phase in phases])
    drawn = set()
    for _ in range(60):
        numbers, seen = stream.check(stream.buffer.sample(32))
        drawn |= set(numbers)
        for number, (size, total) in zip(numbers, seen, strict=True):
            before = [other for other in range(number) if stream.episode_of[other] == stream.episode_of[number]]
            assert size == len(before) == stream.step_of[number]
            assert total == sum(before)
    assert drawn == set(range(stream.count))


def test_an_episode_that_lost_its_first_rows_begins_at_the_first_that_is_left():
    stream = Stream(buffer_size=10, context="episode", n_sequences=4)
    for _ in range(25):
        stream.add([0])
    for _ in range(20):
        numbers, seen = stream.check(stream.buffer.sample(16))
        np.testing.assert_array_equal(seen[:, 0], numbers - 15)


def test_running_episodes_are_those_since_the_last_reset():
    stream = Stream(2)
    for step in range(7):
        stream.add([0, 1], dones=[step == 3, False])
    slots, lengths = stream.buffer.episodes.running()
    assert lengths.tolist() == [3, 7]
    observed = stream.buffer.transitions(slots).observations[..., 0].numpy()
    assert observed[0, :3].tolist() == [8, 10, 12]
    assert observed[1].tolist() == [1, 3, 5, 7, 9, 11, 13]
    stream.add([0, 1], dones=[True, True])
    assert stream.buffer.episodes.running()[1].tolist() == [0, 0]
    stream.add([0, 1])
    stream.buffer.episodes.cut()
    assert stream.buffer.episodes.running()[1].tolist() == [0, 0]


@pytest.mark.parametrize("context", ["iid", "recent"])
def test_an_inner_end_is_not_done_and_values_flow_on_from_where_the_next_inner_episode_begins(context):
    stream = Stream(2, context=context, n_sequences=4, sequence_length=8)
    for step in range(30):
        stream.add([0, 1], dones=[step % 15 == 14] * 2, inner_ends=[step % 15 in (4, 9), step % 15 == 7])
    for _ in range(5):
        samples = stream.buffer.sample(32)
        numbers, _ = stream.check(samples)
        np.testing.assert_array_equal(samples.dones[:, 0], numbers // 2 % 15 == 14)
    slots = np.arange(60)
    arrivals = stream.buffer.transitions(slots).next_observations[:, 0]  # what the encoder learns from
    np.testing.assert_allclose(arrivals, slots + 0.5)


def test_where_inner_episodes_begin_is_forgotten_with_their_ends_and_pickled_with_them():
    stream = Stream(buffer_size=10, n_sequences=1, sequence_length=10)
    for step in range(14):
        stream.add([0], inner_ends=[step in (2, 12)])
    stream.buffer = pickle.loads(pickle.dumps(stream.buffer))
    stream.buffer.set_encoder(Recorder(), LAYOUT)
    numbers, _ = stream.check(stream.buffer.sample(10))
    assert sorted(numbers) == list(range(4, 14))
    assert stream.buffer.restarts(np.array([2]), None).tolist() == [[-9.0]]  # of transition 12, in the place of 2


@pytest.mark.parametrize("buffer_size", [200, 51])  # with all of the trials, and with the first rows of one lost
def test_episode_context_is_the_whole_trial_without_the_transitions_whose_end_was_not_shown(buffer_size):
    stream, inner = Stream(context="episode", buffer_size=buffer_size, n_sequences=4), set()
    for step in range(97):  # trials of 20 steps with inner ends after 5 and 12, the last one still running
        inner |= {step} if step % 20 in (4, 11) else set()
        stream.add([step // 20], dones=[step % 20 == 19], inner_ends=[step in inner])
    for _ in range(20):
        samples = stream.buffer.sample(32)
        for number, before, after in zip(
            samples.observations[:, 0].numpy().astype(int),
            samples.observations[:, LAYOUT.belief].numpy(),
            samples.next_observations[:, LAYOUT.belief].numpy(),
            strict=True,
        ):
            start = max(number - number % 20, 97 - buffer_size)
            for belief, end in ((before, number), (after, number + 1)):
                seen = set(range(start, end)) - inner
                np.testing.assert_allclose(belief, [len(seen), sum(seen)])


def test_running_trials_go_on_over_inner_ends():
    stream = Stream(2)
    for step in range(7):
        stream.add([0, 1], inner_ends=[step == 3, step == 6])
    slots, lengths = stream.buffer.episodes.running()
    assert lengths.tolist() == [7, 7]
    assert stream.buffer.absorbed(slots).tolist() == [[1, 1, 1, 0, 1, 1, 1], [1, 1, 1, 1, 1, 1, 0]]


def test_a_target_encoder_tells_the_beliefs_at_inner_ends_too():
    class Doubled(Recorder):
        def belief(self, statistics):
            return 2 * statistics[0]

    stream = Stream(n_sequences=1, sequence_length=10)
    stream.buffer.set_encoder(Recorder(), LAYOUT, target_encoder=Doubled())
    for step in range(10):
        stream.add([0], inner_ends=[step in (3, 7)])
    samples = stream.buffer.sample(10)
    now, later = samples.observations[:, LAYOUT.belief], samples.next_observations[:, LAYOUT.belief]
    ended = np.isin(samples.observations[:, 0], (3, 7))
    np.testing.assert_allclose(later[ended], 2 * now[ended])
    np.testing.assert_allclose(later[~ended, 0], 2 * (now[~ended, 0] + 1))

"""Beliefs in a long episode cost no more than in one of 384 steps, and still rest on all that came before."""

import numpy as np
import pytest

from sb3_bruno.buffers.long_episodes import EARLIER, WINDOW, newest, shortened
from support.stream import Stream


def stream_of(length, n_envs=1, **kwargs):
    stream = Stream(n_envs, n_envs * length, context="episode", n_sequences=4, **kwargs)
    for step in range(length):
        stream.add(list(range(n_envs)), inner_ends=[step % 50 == 49] * n_envs)
    return stream


def test_an_episode_of_384_steps_is_read_whole():
    stream = stream_of(EARLIER + WINDOW)
    rows, _ = stream.buffer.episode_rows(4, bounded=True)
    assert rows.slots.shape == (4, 384) and rows.is_read.all() and (rows.counts == 1).all()


@pytest.mark.parametrize("n_envs", [1, 3])
@pytest.mark.parametrize("length", [385, 500, 1_000, 5_000])
def test_a_belief_in_a_long_episode_counts_all_that_came_before(n_envs, length):
    stream = stream_of(length, n_envs)
    drawn = set()
    for _ in range(10):
        stream.buffer.forget_beliefs()  # and draw anew
        numbers, seen = stream.check(stream.buffer.sample(64))
        steps = np.array([stream.step_of[number] for number in numbers])
        drawn |= set(steps)
        absorbed = steps - steps // 50  # those of the inner ends are not
        np.testing.assert_allclose(seen[:, 0], absorbed, rtol=0.06, atol=3)
    assert stream.buffer._encoded.time == 384
    assert min(drawn) < 0.25 * length and max(drawn) > 0.75 * length


def test_every_step_is_read_as_often_as_others():
    rng, length = np.random.default_rng(0), 1_000
    times, slots = np.zeros(length), np.arange(length)[None]
    for _ in range(4_000):
        rows = shortened(slots, np.array([length]), rng.integers(length, size=1), rng)
        times[rows.slots[rows.is_read]] += 1
    middle = times[WINDOW:-WINDOW]
    assert middle.min() / middle.mean() > 0.8 and middle.max() / middle.mean() < 1.2
    assert times.min() > 0


def test_short_and_long_episodes_share_a_batch():
    slots = np.minimum(np.arange(600), [[9], [599]])
    rows = shortened(slots, np.array([10, 600]), np.array([3, 450]), np.random.default_rng(0))
    assert rows.counts.sum(axis=1).tolist()[0] == 10 and rows.is_read[0].sum() == 10
    begin = rows.slots[1][rows.is_read[1]][0]
    assert (
        rows.slots[1][rows.is_read[1]].tolist() == list(range(begin, begin + WINDOW)) and begin <= 450 < begin + WINDOW
    )
    np.testing.assert_allclose(rows.counts[1, : (rows.counts[1] > 0).sum() - WINDOW].sum(), begin, rtol=1e-5)


def test_the_sample_estimates_the_sum_over_all_earlier_steps_without_bias():
    rng, length, errors = np.random.default_rng(0), 2_000, []
    for _ in range(400):
        rows = shortened(np.arange(length)[None], np.array([length]), np.array([1_500]), rng)
        begin = int(rows.slots[rows.is_read].min())
        counts = np.where(rows.is_read, 0, rows.counts)
        assert counts.sum() == pytest.approx(begin)
        errors.append((counts * rows.slots).sum() / np.arange(begin).sum() - 1)
    assert abs(np.mean(errors)) < 3 * np.std(errors) / 20 and np.std(errors) < 0.05


def test_the_newest_steps_are_in_the_window_and_a_sample_stands_for_the_others():
    slots = np.minimum(np.arange(5_000), [[4_999], [9], [0]])
    rows = newest(slots, np.array([5_000, 10, 0]), np.random.default_rng(0))
    assert rows.slots.shape == (3, EARLIER + WINDOW)
    assert rows.slots[0, -WINDOW:].tolist() == list(range(5_000 - WINDOW, 5_000))
    np.testing.assert_allclose(rows.counts.sum(axis=1), [5_000, 10, 0], rtol=1e-5)

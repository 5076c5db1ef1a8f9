"""One task in five is spared: always the same, and between others that are not."""

from zlib import crc32

import numpy as np
import pytest

from sb3_bruno.buffers.sampled_episodes import sample_episodes
from sb3_bruno.buffers.spared_tasks import spared_tasks
from support.stream import Stream

RNG = np.random.default_rng(0)
ELEVEN = np.linspace(-1, 1, 11)[:, None]
CIRCLE = np.stack([np.cos(a := np.linspace(0, 6, 24)), np.sin(a)], axis=1)
WITH_CONSTANTS = np.concatenate([ELEVEN, np.full((11, 2), [0.0, 9.81])], axis=1)
GRID = np.stack(np.meshgrid(np.arange(5), np.arange(5)), axis=-1).reshape(-1, 2)
FLAGGED = np.stack([np.arange(20) % 2, np.linspace(0, 3, 20)], axis=1)
"""An entry of which every task is at an end."""


def spared_of(tasks):
    tasks = np.asarray(tasks, dtype=np.float32)
    return tasks[spared_tasks(tasks, np.array([crc32(task.tobytes()) for task in tasks], dtype=np.uint32))]


def sorted_rows(tasks):
    return sorted(map(tuple, np.asarray(tasks).tolist()))


def is_at_an_end(tasks, of):
    varies = np.ptp(of, axis=0) > 0
    return ((tasks == of.min(axis=0)) | (tasks == of.max(axis=0)))[:, varies].any()


@pytest.mark.parametrize("n", range(2, 60))
def test_a_fifth_is_spared_and_none_at_the_ends(n):
    for low, high in ((-1.0, 1.0), (0.0, 3.0), (5.0, 15.0), (1e-3, 2e-3)):
        tasks = np.linspace(low, high, n, dtype=np.float32)[:, None]
        spared = spared_of(tasks)
        assert len(spared) == n // 5 and not is_at_an_end(spared, tasks)


@pytest.mark.parametrize(("tasks", "n_spared"), [(CIRCLE, 4), (WITH_CONSTANTS, 2), (GRID, 5), (RNG.random((40, 6)), 8)])
def test_tasks_of_several_numbers_are_spared_between_others(tasks, n_spared):
    tasks = np.asarray(tasks, dtype=np.float32)
    spared = spared_of(tasks)
    assert len(spared) == n_spared and not is_at_an_end(spared, tasks)


@pytest.mark.parametrize("tasks", [FLAGGED, GRID[:10], np.eye(12), [[0, 1], [1, 0], [0, 2], [2, 0], [1, 1]]])
def test_the_others_always_reach_both_ends_of_every_entry(tasks):
    tasks = np.asarray(tasks, dtype=np.float32)
    spared = {tuple(task) for task in spared_of(tasks)}
    taught = np.array([task for task in tasks if tuple(task) not in spared])
    assert (taught.min(axis=0) == tasks.min(axis=0)).all() and (taught.max(axis=0) == tasks.max(axis=0)).all()


def test_of_an_entry_with_nothing_between_its_ends_tasks_are_spared_that_share_them():
    assert len(spared_of(FLAGGED)) == 4
    assert len(spared_of(np.eye(12))) == 0  # each is alone at an end


def test_fewer_are_spared_where_the_others_are_needed():
    tasks = RNG.random((6, 8))
    n_between = sum(not is_at_an_end(task[None], tasks) for task in tasks)
    assert len(spared_of(tasks)) == min(1, n_between)


@pytest.mark.parametrize("tasks", [ELEVEN, CIRCLE, GRID, FLAGGED, RNG.random((300, 3))], ids=len)
def test_they_are_the_same_in_whatever_order_tasks_come(tasks):
    expected = sorted_rows(spared_of(tasks))
    assert sorted_rows(spared_of(RNG.permutation(tasks))) == expected


def test_most_stay_spared_while_tasks_come():
    tasks = RNG.random((1_000, 1))
    before, after = (set(sorted_rows(spared_of(tasks[:n]))) for n in (900, 1_000))
    assert len(before & after) > 0.9 * len(before)


def spared_in(stream, tasks):
    """Store two transitions of each task, an episode each; return which tasks of sampled episodes are spared."""
    for task in np.repeat(tasks, 2):
        stream.add([float(task)], dones=[True])
    told = sample_episodes(stream.buffer, 200, bounded=True, rng=np.random.default_rng(1), env=None)
    return set(told.sequences.tasks[told.is_spared].flatten().tolist())


def test_the_episodes_of_spared_tasks_say_so():
    stream = Stream(buffer_size=20)
    assert spared_in(stream, range(4)) == set()  # of fewer than five
    for first in (0, 3, 8):  # all others have gone from the buffer
        tasks = np.arange(first, first + 10)
        assert spared_in(stream, tasks) == set(spared_of(tasks[:, None]).ravel().tolist())

"""A Ctrl-C, or an error, in the middle of storing a step shifts nothing."""

import os
import signal
import threading

import numpy as np
import pytest
from stable_baselines3.common.buffers import ReplayBuffer

from sb3_bruno.buffers.task_index import TaskIndex
from sb3_bruno.buffers.uninterrupted import uninterrupted
from support.stream import Stream


def fill(stream, n_steps):
    for _ in range(n_steps):
        step = stream.count // 2
        stream.add([step // 9 % 4] * 2, dones=[step % 9 == 8] * 2)


def check(stream):
    for _ in range(30):
        numbers, seen = stream.check(stream.buffer.sample(32))
        for number, (size, _) in zip(numbers, seen, strict=True):
            assert size == stream.step_of[number]


@pytest.mark.parametrize("place", [ReplayBuffer, TaskIndex])
def test_a_ctrl_c_comes_through_once_the_step_is_stored(place, monkeypatch):
    name = {ReplayBuffer: "add", TaskIndex: "put"}[place]
    stream, original = Stream(2, 200, context="episode", n_sequences=4), getattr(place, name)

    def interrupted(self, *args, **kwargs):
        os.kill(os.getpid(), signal.SIGINT)
        return original(self, *args, **kwargs)

    fill(stream, 30)
    monkeypatch.setattr(place, name, interrupted)
    with pytest.raises(KeyboardInterrupt):
        fill(stream, 1)
    monkeypatch.setattr(place, name, original)
    assert stream.buffer.pos == stream.count // 2
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    fill(stream, 30)
    check(stream)


def test_an_error_while_storing_leaves_the_index_where_the_ring_is(monkeypatch):
    stream, original = Stream(2, 100, context="episode", n_sequences=4), ReplayBuffer.add
    fill(stream, 20)

    def fail(*_args, **_kwargs):
        raise MemoryError

    monkeypatch.setattr(ReplayBuffer, "add", fail)
    before = stream.buffer.episodes.lengths.tolist(), len(stream.buffer.tasks), stream.buffer.inner_ends.copy()
    with pytest.raises(MemoryError):
        stream.buffer.add(*(np.ones((2, 1)),) * 3, np.ones(2), np.zeros(2, dtype=bool), [{"task": [7]}] * 2)
    monkeypatch.setattr(ReplayBuffer, "add", original)
    after = stream.buffer.episodes.lengths.tolist(), len(stream.buffer.tasks), stream.buffer.inner_ends
    assert before[:2] == after[:2] and (before[2] == after[2]).all()
    fill(stream, 20)
    check(stream)


def test_outside_the_main_thread_there_is_nothing_to_hold_back():
    handlers = []

    def look():
        with uninterrupted():
            handlers.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert handlers == [signal.default_int_handler]


def test_the_buffer_extends_by_what_it_holds():
    stream = Stream()
    for step in range(10):
        stream.add([1], dones=[step == 5])
    buffer = stream.buffer
    buffer.episodes.cut()
    infos = [[{"task": [1], "TimeLimit.truncated": False}]] * 10
    parts = (buffer.observations, buffer.next_observations, buffer.actions, buffer.rewards, buffer.dones)
    buffer.extend(*(part[:10].copy() for part in parts), infos)
    assert buffer.size() == 20
    np.testing.assert_array_equal(buffer.observations[:10], buffer.observations[10:20])
    assert buffer.episodes.holding(np.array([12]))[1].tolist() == [6]

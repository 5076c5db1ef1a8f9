"""The index of slots by task against a plain dictionary of lists."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sb3_bruno.buffers.task_index import TaskIndex


def vector(task: int) -> np.ndarray:
    return np.array([task], dtype=np.float32)


@given(st.integers(1, 12), st.lists(st.integers(0, 5), max_size=120))
def test_a_ring_of_slots_is_grouped_as_a_dictionary_would(n_slots, stream):
    index, held = TaskIndex(n_slots), {}
    for i, task in enumerate(stream):
        slot = i % n_slots
        for slots in held.values():
            if slot in slots:
                slots.remove(slot)
        held.setdefault(task, []).append(slot)
        held = {task: slots for task, slots in held.items() if slots}
        index.put(slot, vector(task))
        assert len(index) == len(held)
        assert index.queue_of(slot).task == vector(task)
        found = {int(queue.task[0]): queue.slots.tolist() for queue in index._live}
        assert found == held  # in the order of arrival too


def test_an_endless_stream_of_tasks_leaves_nothing_behind():
    index = TaskIndex(10)
    for i in range(10_000):
        index.put(i % 10, vector(i))
    assert len(index) == 10
    assert len(index._queues) <= 11
    assert len(index._of_task) == len(index._live) == 10


def test_a_long_lived_queue_keeps_to_its_size():
    index = TaskIndex(50)
    for i in range(10_000):
        index.put(i % 50, vector(0))
    assert len(index._live[0]._slots) <= 128


def test_tasks_are_drawn_uniformly_however_uneven():
    index = TaskIndex(101)
    for slot in range(100):
        index.put(slot, vector(0))
    index.put(100, vector(1))
    drawn = [queue.task[0] for queue in index.draw(4_000, np.random.default_rng(0))]
    assert 0.45 < np.mean(drawn) < 0.55

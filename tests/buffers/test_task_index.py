"""The index of slots by task against a plain dictionary of lists."""

import pickle

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sb3_bruno.buffers.task_index import TaskIndex


def vector(task: int) -> np.ndarray:
    return np.array([task], dtype=np.float32)


def held_by(index: TaskIndex) -> dict[int, list[int]]:
    """The slots of every task, oldest first."""
    numbers = index._live[: len(index)].astype(np.int64)
    slots = [index.slots(numbers[[i]], np.arange(n)[None])[0] for i, n in enumerate(index.counts(numbers))]
    return {int(task[0]): row.tolist() for task, row in zip(index.tasks(numbers), slots, strict=True)}


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
        assert index.tasks(index.number_of(slot)) == vector(task)
        assert held_by(index) == held
    assert held_by(pickle.loads(pickle.dumps(index))) == held


@given(st.integers(0, 2**32 - 1))
def test_so_it_is_while_queues_of_uneven_length_move_and_are_packed(seed):
    rng, n_slots = np.random.default_rng(seed), 300
    index, task_of = TaskIndex(n_slots), {}
    for i in range(1_000):
        task = int(rng.geometric(0.05))
        index.put(i % n_slots, vector(task))
        task_of[i] = task
    expected: dict[int, list[int]] = {}
    for i in range(700, 1_000):
        expected.setdefault(task_of[i], []).append(i % n_slots)
    assert held_by(index) == expected


def test_an_endless_stream_of_tasks_leaves_nothing_behind():
    index = TaskIndex(10)
    for i in range(10_000):
        index.put(i % 10, vector(i))
    assert len(index) == len(held_by(index)) == 10
    assert len(index._numbers.vectors) <= 32 and len(index._queued) <= 100


def test_a_long_lived_queue_keeps_to_its_size():
    index = TaskIndex(50)
    for i in range(10_000):
        index.put(i % 50, vector(0))
    assert len(index._queued) <= 200


def test_tasks_are_drawn_uniformly_however_uneven():
    index = TaskIndex(101)
    for slot in range(100):
        index.put(slot, vector(0))
    index.put(100, vector(1))
    drawn = index.tasks(index.draw(4_000, np.random.default_rng(0)))
    assert 0.45 < np.mean(drawn) < 0.55

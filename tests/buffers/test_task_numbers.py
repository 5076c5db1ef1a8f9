"""The numbers of tasks against a plain dictionary."""

import pickle
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sb3_bruno.buffers import task_numbers
from sb3_bruno.buffers.task_numbers import TaskNumbers


def vector(task):
    return np.array([task, -task], dtype=np.float32)


@pytest.mark.parametrize("checksum", [task_numbers.crc32, lambda key: 7], ids=["", "all alike"])
@given(st.lists(st.integers(0, 5), max_size=60))
def test_tasks_are_numbered_as_by_a_dictionary(checksum, stream):
    """Every second time that a task comes, it is closed."""
    numbers, expected = TaskNumbers(), {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(task_numbers, "crc32", checksum)
        patch.setattr(task_numbers, "N_REMEMBERED", 2)
        for task in stream:
            assert numbers.find(vector(task)) == expected.get(task)
            if task in expected:
                numbers.close(expected.pop(task))
            else:
                expected[task] = numbers.open(vector(task))
            assert len(numbers) == len(expected) == len(set(expected.values()))
            for copy in (numbers, pickle.loads(pickle.dumps(numbers))):
                assert [copy.find(vector(other)) for other in range(6)] == [expected.get(other) for other in range(6)]
                assert all((copy.vectors[number] == vector(other)).all() for other, number in expected.items())


def test_a_closed_number_is_given_again():
    numbers = TaskNumbers()
    for task in range(1_000):
        number = numbers.open(vector(task))
        numbers.close(number)
    assert number == 0 and len(numbers) == 0 and len(numbers.vectors) <= 16


def test_a_task_takes_few_bytes():
    tracemalloc.start()
    numbers = TaskNumbers()
    for task in range(20_000):
        numbers.open(vector(task))
    used, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    of_its_own = vector(0).nbytes + 4
    assert used < 20_000 * of_its_own * 1.2 + 300_000  # of those remembered

"""What a read-out takes the task for is compared with the task: entry by entry, or by the task's probability."""

import numpy as np

from sb3_bruno.algorithms.task_estimate import TaskEstimate, TaskLabels
from sb3_bruno.diagnostics.readout import compare_readout
from sb3_bruno.diagnostics.verdict import TRUE_TASK

IS_KNOWN = np.array([[[True, True, False]]])  # one task, one episode, which ends after a step


def test_entries_are_compared_in_their_own_units():
    mean, std = np.float32([[[1.0, 5.0], [2.0, 4.0], [9.0, 9.0]]]), np.full((1, 3, 2), 0.5, np.float32)
    estimate = TaskEstimate(mean, std, None, None, TaskLabels(("x", "mass"), ("m", "")))
    entries, misses, holds = compare_readout(np.array([[2.0, 4.75]]), [estimate], IS_KNOWN)
    assert entries == ["x, m", "mass"]
    np.testing.assert_array_equal(misses[0, 0], [[1.0, 0.25], [0.0, 0.75], [np.nan, np.nan]])
    np.testing.assert_array_equal(holds[0, 0], [[0.0, 1.0], [1.0, 1.0], [np.nan, np.nan]])  # 0.82 to either side
    unnamed = estimate._replace(labels=TaskLabels())
    assert compare_readout(np.array([[2.0, 4.75]]), [unnamed], IS_KNOWN).entries == ["task[0]", "task[1]"]


def test_of_few_tasks_the_true_ones_probability_counts():
    numbers = np.zeros((1, 3, 2), np.float32)
    tasks, chances = np.float32([[1, 0], [0, 1]]), np.float32([[[0.5, 0.5], [0.75, 0.25], [0.0, 1.0]]])
    estimate = TaskEstimate(numbers, numbers, tasks, chances, TaskLabels((), (), ("backward", "forward")))
    entries, misses, holds = compare_readout(np.array([[0.0, 1.0]]), [estimate], IS_KNOWN)
    assert entries == [TRUE_TASK]
    np.testing.assert_array_equal(misses[0, 0, :, 0], [0.5, 0.75, np.nan])
    np.testing.assert_array_equal(holds[0, 0, :, 0], [0.0, 0.0, np.nan])

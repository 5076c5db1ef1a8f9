"""What the agent believes is written in the task's own words and units, beside the truth."""

import numpy as np

from sb3_bruno.algorithms.task_estimate import TaskEstimate, TaskLabels
from sb3_bruno.live.history import History
from sb3_bruno.live.session import Moment
from sb3_bruno.live.words import chances, color_of, numbers, place_of


def estimate(mean, std, names=(), units=(), probabilities=None):
    arrays = (np.array([array], dtype=np.float32) for array in (mean, std))
    chance = None if probabilities is None else np.array([probabilities], dtype=np.float32)
    return TaskEstimate(*arrays, None, chance, TaskLabels(names, units))


def moment(step, told=None, task=None, surprise=None, evidence=None):
    return Moment(step, task, "", float(step), 0.0, told, surprise, evidence)


def test_a_number_has_its_name_its_spread_its_unit_and_the_truth():
    told = numbers(estimate([1.912], [0.104], ("speed",), ("m/s",)), np.array([2.0]))
    assert "speed 1.91 ± 0.10 m/s" in told and "true 2" in told


def test_numbers_without_names_are_counted():
    told = numbers(estimate([1.0, 2.0], [0.5, 0.5]), None)
    assert "task[0] 1.00 ± 0.50" in told and "task[1] 2.00 ± 0.50" in told and "true" not in told


def test_the_true_one_of_a_few_tasks_is_marked():
    told = chances(["forward", "<b>back"], [0.99, 0.01], truth=0)
    assert "forward 0.99 ◂ true" in told and "&lt;b&gt;back 0.01<" in told


def test_a_task_is_found_among_others_up_to_rounding():
    tasks = np.array([[1.0, 0.0], [0.0, 1.0]])
    assert [place_of(task, tasks) for task in ([0.0, 1.0], [1.0, 1e-7], [0.5, 0.5])] == [1, 0, -1]


def test_no_colour_is_missing():
    assert color_of(0) == color_of(7) != color_of(1)


def test_the_history_keeps_the_last_steps():
    history = History(length=3)
    for step in range(1, 6):
        history.add(moment(step, surprise=step - 3.0, evidence=0.5 * step))
    assert history.steps.tolist() == [3, 4, 5] and history.last.step == 5 and len(history) == 3
    assert history.rewards()[0].tolist() == [3, 4, 5]
    surprise, evidence, limit = history.surprises(10.0)
    assert surprise.tolist() == [0, 1, 2] and evidence.tolist() == [1.5, 2, 2.5] and limit.tolist() == [10, 10, 10]


def test_what_is_missing_is_no_gap_that_would_empty_a_chart():
    history = History()
    history.add(moment(1, estimate([1.0], [0.5])))
    assert [line.tolist() for line in history.surprises(None)] == [[0], [0], [0]]
    assert [line.tolist() for line in history.entries(most=4)] == [[1.5], [0.5], [1], [1]]


def test_each_number_has_four_lines_up_to_the_most():
    history = History()
    for step in (1, 2):
        history.add(moment(step, estimate([step, 10.0], [0.5, 1.0]), task=np.array([1.5, 9.0])))
    upper, lower, mean, truth = history.entries(most=1)
    assert [line.tolist() for line in (upper, lower, mean, truth)] == [[1.5, 2.5], [0.5, 1.5], [1, 2], [1.5, 1.5]]
    assert len(history.entries(most=4)) == 8
    history = History()
    history.add(moment(1, estimate([0.0], [0.0], probabilities=[0.75, 0.25])))
    assert [line.tolist() for line in history.probabilities()] == [[0.75], [0.25]]

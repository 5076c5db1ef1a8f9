"""What the agent believes is written in the task's own words and units, beside the truth."""

from types import SimpleNamespace

import numpy as np

from sb3_bruno.algorithms.task_estimate import TaskEstimate, TaskLabels
from sb3_bruno.live.chart import LENGTH, Chart, Line
from sb3_bruno.live.words import chart_row, color_of, place_of, told


def estimate(mean, std, names=(), units=(), tasks=(), probabilities=None):
    arrays = (np.array([array], dtype=np.float32) for array in (mean, std))
    chance = None if probabilities is None else np.array([probabilities], dtype=np.float32)
    listed = np.arange(float(len(tasks)))[:, None] if tasks else None
    return TaskEstimate(*arrays, listed, chance, TaskLabels(names, units, tasks))


def test_a_number_has_its_name_its_spread_its_unit_and_the_truth():
    html = told(estimate([1.912], [0.104], ("speed",), ("m/s",)), np.array([2.0]))
    assert "speed 1.91 ± 0.10 m/s" in html and "true 2<" in html


def test_numbers_without_names_are_counted():
    html = told(estimate([1.0, 2.0], [0.5, 0.5]), None)
    assert "task[0] 1.00 ± 0.50" in html and "task[1] 2.00 ± 0.50" in html and "true" not in html


def test_the_true_one_of_a_few_tasks_is_marked():
    few = estimate([0.0], [0.0], tasks=("forward", "<b>back"), probabilities=[0.99, 0.01])
    html = told(few, np.array([0.0]))
    assert "forward 0.99 ◂ true" in html and "&lt;b&gt;back 0.01<" in html
    assert "true" not in told(few, None) and "true" not in told(few, np.array([0.5]))


def test_a_row_of_a_few_tasks_is_their_probabilities():
    few = estimate([0.0], [0.0], tasks=("a", "b"), probabilities=[0.75, 0.25])
    assert chart_row(few, np.array([0.0]), most=1) == [0.75, 0.25]


def test_a_row_of_numbers_has_four_values_of_each_up_to_the_most():
    two = estimate([1.0, 10.0], [0.5, 1.0])
    assert chart_row(two, np.array([1.5, 9.0]), most=4) == [1.5, 0.5, 1.0, 1.5, 11.0, 9.0, 10.0, 9.0]
    assert chart_row(two, np.array([1.5, 9.0]), most=1) == [1.5, 0.5, 1.0, 1.5]
    assert chart_row(two, None, most=1) == [1.5, 0.5, 1.0, 1.0]  # a truth that is unknown hides behind the mean


def test_a_task_is_found_among_others_up_to_rounding():
    tasks = np.array([[1.0, 0.0], [0.0, 1.0]])
    assert [place_of(task, tasks) for task in ([0.0, 1.0], [1.0, 1e-7], [0.5, 0.5])] == [1, 0, -1]


def test_no_colour_is_missing():
    assert color_of(0) == color_of(7) != color_of(1)


class Gui:
    """Keeps what is added."""

    def add_html(self, content):
        self.title = content

    def add_uplot(self, **chart):
        self.chart = SimpleNamespace(**chart)
        return self.chart


def test_a_chart_shows_the_last_steps_and_no_gap_that_would_empty_it():
    gui = Gui()
    chart = Chart(gui, "Two", [Line("red"), Line("blue")], bands=[(0, 1)])
    assert [array.tolist() for array in gui.chart.data] == [[0], [0], [0]]
    for step in range(1, LENGTH + 3):
        chart.add(step, [-step, np.nan])
    chart.show()
    steps, first, second = gui.chart.data
    assert steps.tolist() == list(range(3, LENGTH + 3)) and first.tolist() == (-steps).tolist()
    assert second.tolist() == [0.0] * LENGTH and len(gui.chart.series) == 3
    assert gui.chart.bands == ({"series": (1, 2), "fill": "blue30"},)

"""Tasks have the same names everywhere: a label in logs and tables, a title in figures."""

from __future__ import annotations

import numpy as np
import pytest

from sb3_bruno.task_names import log_key, pooled_title, task_label, task_labels, task_title


def test_task_labels() -> None:
    assert task_label([0.5, -1.0]) == "0.5_-1"
    assert task_label([np.cos(np.pi / 2), -0.0]) == "0_0"
    assert task_label(np.float32(0.7861)) == "0.7861"


@pytest.mark.parametrize(("task", "title"), [([0.5], "task 0.5"), ([1.0, 0.0], "task (1, 0)"), (-3, "task -3")])
def test_a_title_is_made_from_a_task_or_its_label(task: list[float] | float, title: str) -> None:
    assert task_title(task) == task_title(task_label(task)) == title


def test_tasks_shown_together_are_counted() -> None:
    assert pooled_title(30) == "30 tasks"


def test_a_task_of_many_numbers_is_called_by_its_place_and_a_name() -> None:
    tasks = np.random.default_rng(0).normal(size=(3, 40))
    labels = task_labels(tasks)
    assert [label[:3] for label in labels] == ["#0-", "#1-", "#2-"] and len(set(labels)) == 3
    assert all(len(label) == 9 for label in labels)
    assert labels[1].endswith(task_label(tasks[1])), "wherever it stands"
    assert task_labels(tasks[:, :2]) == [task_label(task) for task in tasks[:, :2]]


def test_names_are_labels_and_titles_unless_two_tasks_share_one() -> None:
    tasks = [[0.5], [1.0], [2.0], [3.0]]
    labels = task_labels(tasks, ["slow", "fast", "fast", ""])
    assert labels == ["slow", "fast (1)", "fast (2)", "3"]
    assert [task_title(label) for label in labels] == ["slow", "fast (1)", "fast (2)", "task 3"]
    assert task_title("1.9 m/s") == "1.9 m/s" and task_title("goal (0.5, -1)") == "goal (0.5, -1)"
    assert task_title("decade") == "decade", "though it looks like what a task of many numbers is called"
    assert task_title("#3-decade") == "task #3-decade" and task_title(np.arange(9.0)).startswith("task ")
    assert task_title("-1e-05_2e+10") == "task (-1e-05, 2e+10)"


@pytest.mark.parametrize(
    ("tasks", "names"),
    [
        ([[1.0], [2.0]], ["2", ""]),
        ([[5.0], [1.0], [2.0]], ["fast (1)", "fast", "fast"]),
        ([[100000.1], [100000.2]], None),
        ([[100000.1], [100000.2]], ["far", "far"]),
        ([[1.0], [1.0]], None),
        ([[1.0], [2.0]], ["all", "some"]),  # what tables call all tasks together
        ([[1.0], [2.0], [3.0]], ["a\nb", "a b", "a\0b\ud800"]),
    ],
)
def test_labels_are_all_different_on_one_line_and_none_is_all(
    tasks: list[list[float]], names: list[str] | None
) -> None:
    labels = task_labels(tasks, names)
    assert len(set(labels)) == len(tasks) and "all" not in labels
    assert all(label.isprintable() for label in labels)


@pytest.mark.parametrize(
    ("label", "key"), [("forward", "forward"), ("1.9 m/s", "1.9_m_s"), ("(0.5, -1)", "0.5_-1"), ("0.5_-1", "0.5_-1")]
)
def test_a_log_key_holds_no_slash_and_no_space(label: str, key: str) -> None:
    assert log_key(label) == key

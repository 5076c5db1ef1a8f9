"""Tests of the task distributions: what they accept and what they draw."""

import pickle

import numpy as np
import pytest
from gymnasium.spaces import Box
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sb3_bruno.buffers import numbers
from sb3_bruno_envs.tasks import LARGEST, TaskSampler, TaskSet, as_task_distribution

UNIT = Box(0.0, 1.0, (1,))
FLOATS = st.floats(-1e6, 1e6, width=32)
MATRICES = arrays(np.float32, st.tuples(st.integers(1, 6), st.integers(1, 3)), elements=FLOATS)


@given(train=MATRICES, seed=st.integers(0, 2**32))
def test_a_finite_set_draws_its_own_tasks_inside_its_bounding_box(train, seed):
    tasks = TaskSet(train)
    drawn = tasks.draw(np.random.default_rng(seed))
    assert drawn.dtype == np.float32
    assert (tasks.tasks("test") == drawn).all(axis=1).any()
    assert drawn in tasks.space
    np.testing.assert_array_equal(tasks.space.low, train.min(axis=0))
    np.testing.assert_array_equal(tasks.space.high, train.max(axis=0))


def test_the_bounding_box_spans_both_splits():
    tasks = TaskSet([[0.0, 5.0]], [[-1.0, 7.0]])
    assert tasks.space == Box(np.float32([-1, 5]), np.float32([0, 7]))
    assert tasks.draw(np.random.default_rng(0), "test").tolist() == [-1.0, 7.0]


def test_every_task_is_drawn_about_equally_often():
    rng = np.random.default_rng(0)
    tasks = TaskSet([[0], [1], [2], [3]])
    counts = np.bincount([int(tasks.draw(rng)[0]) for _ in range(4000)])
    assert np.abs(counts - 1000).max() < 5 * np.sqrt(750)  # five standard deviations of the binomial


def test_drawing_and_reading_cannot_change_a_set():
    tasks = TaskSet([[1.0]])
    tasks.draw(np.random.default_rng(0))[:] = 9.0
    with pytest.raises(ValueError, match="read-only"):
        tasks.tasks()[:] = 9.0
    assert tasks.tasks().tolist() == [[1.0]]


def test_beyond_keeps_the_training_tasks_and_tests_only_outside_their_box():
    tasks = TaskSet([[1.0], [2.0]], [[1.5], [3.0]], space=Box(0.0, 5.0, (1,)), train_box=Box(1.0, 2.5, (1,)))
    assert tasks.beyond() == TaskSet([[1.0], [2.0]], [[3.0]], space=tasks.space, train_box=tasks.train_box)
    given = tasks.beyond([[2.4], [2.6], [0.5], [7.0]], space=Box(0.0, 9.0, (1,)))
    assert given.tasks("test").ravel().tolist() == [np.float32(2.6), 0.5, 7.0]
    assert (given.space, given.train_box) == (Box(0.0, 9.0, (1,)), tasks.train_box)


def test_beyond_refuses_candidates_that_are_not_outside_or_do_not_fit():
    tasks = TaskSet([[1.0], [2.0]], space=Box(0.0, 5.0, (1,)))
    with pytest.raises(ValueError, match=r"no candidate lies outside train_box=.*: give tasks beyond it"):
        tasks.beyond()
    with pytest.raises(ValueError, match="outside Box"):
        tasks.beyond([[7.0]])
    with pytest.raises(ValueError, match=r"tasks have shape \(1, 2\): give \(n, 1\)"):
        tasks.beyond([[7.0, 8.0]])


def test_tasks_and_space_of_other_dimensions_are_refused():
    with pytest.raises(ValueError, match=r"tasks have 2 dimensions, the task space .* has 1: give tasks of as many"):
        TaskSet([[0.0, 1.0]], space=UNIT)


def test_sets_are_equal_by_value_even_after_pickling():
    tasks = TaskSet([[1.0], [2.0]], [[3.0]])
    assert pickle.loads(pickle.dumps(tasks)) == tasks
    assert hash(TaskSet([[1.0], [2.0]], [[3.0]])) == hash(tasks)
    assert tasks != TaskSet([[1.0], [2.0]])
    assert tasks != TaskSet([[1.0], [2.0]], [[3.0]], space=Box(0.0, 9.0, (1,)))
    assert tasks != TaskSet([[1.0], [2.0]], [[3.0]], train_box=Box(1.0, 3.0, (1,)))
    assert tasks != "tasks"


@pytest.mark.parametrize(
    ("train", "test", "message"),
    [
        ([], None, "at least one"),
        ([[]], None, "at least one"),
        ([1.0, 2.0], None, r"shape \(2,\).*reshape"),
        ([[1.0], [2.0, 3.0]], None, "not an array of numbers"),
        ([["fast"]], None, "not an array of numbers"),
        ([[1.0], [np.nan]], None, r"NaN or infinity in rows \[1\]"),
        ([[1.0]], [[np.inf]], r"test tasks hold NaN or infinity in rows \[0\]"),
        ([[1.0]], [[1.0, 2.0]], "same number of columns"),
        ([[1.0], [-2e9]], None, r"train tasks hold numbers beyond 1e\+09 in rows \[1\]: give them in larger units"),
        ([[1.0]], [[1.0], [1e10]], r"test tasks hold numbers beyond 1e\+09 in rows \[1\]"),
        (
            [[1], [123456789]],
            None,
            r"train tasks hold \[123456789.0\] in row 1, .* to \[123456792.0\]: give an",
        ),
        ([[1.0]], [[1.0], [16777217.0]], r"test tasks hold \[16777217.0\] in row 1, .*: give an index into a list"),
    ],
)
def test_invalid_sets_are_refused_with_a_remedy(train, test, message):
    with pytest.raises(ValueError, match=message):
        TaskSet(train, test)


def test_whole_numbers_that_float32_holds_are_kept_and_the_same_task_may_come_twice():
    tasks = [[16777216], [16777218], [123456792], [0.1], [0.1], [2**29]]
    assert TaskSet(tasks).tasks().tolist() == np.float32(tasks).tolist()


@pytest.mark.parametrize("space", [Box(0.0, 1.0, (1, 1)), "box"])
def test_the_space_must_be_a_flat_box(space):
    with pytest.raises(ValueError, match=r"give a Box of shape \(dim,\)"):
        TaskSet([[0.5]], space=space)


def test_a_task_outside_the_space_is_refused():
    with pytest.raises(ValueError, match=r"a task of the set is \[2\.\], outside"):
        TaskSet([[2.0]], space=UNIT)


@given(train=MATRICES, seed=st.integers(0, 2**32))
def test_the_train_box_is_the_bounding_box_of_the_training_tasks(train, seed):
    tasks = TaskSet(train, np.random.default_rng(seed).uniform(-1e6, 1e6, train.shape))
    assert tasks.inside_train_box(train).all()
    for task, inside in zip(tasks.tasks("test"), tasks.inside_train_box(tasks.tasks("test")), strict=True):
        assert inside == all(
            low <= entry <= high for low, entry, high in zip(train.min(0), task, train.max(0), strict=True)
        )


def test_a_given_train_box_says_which_test_tasks_extrapolate():
    tasks = TaskSet([[0.4], [0.6]], [[0.1], [1.5]], train_box=UNIT)
    assert tasks.inside_train_box(tasks.tasks("test")).tolist() == [True, False]
    assert tasks.inside_train_box([[0.0], [1.0], [-0.1]]).tolist() == [True, True, False]
    wider = as_task_distribution(tasks, Box(-9.0, 9.0, (1,)))
    assert wider.train_box == UNIT


@pytest.mark.parametrize("train_box", [Box(0.0, 0.5, (1,)), Box(0.0, 9.0, (2,))])
def test_a_train_box_that_misses_a_training_task_is_refused(train_box):
    with pytest.raises(ValueError, match=r"train_box=.* does not hold every training task: widen it to Box\(0.2, 0.8"):
        TaskSet([[0.2], [0.8]], train_box=train_box)


@pytest.mark.parametrize("tasks", [[0.5], [[0.5, 0.5]], 0.5])
def test_only_rows_of_tasks_can_be_inside_the_train_box(tasks):
    with pytest.raises(ValueError, match=r"tasks have shape .*: give \(n, 1\)"):
        TaskSet([[0.5]]).inside_train_box(tasks)


@pytest.mark.parametrize("draw", [TaskSet([[0.5]]).draw, TaskSampler(lambda rng: [0.5], UNIT).draw])
def test_an_unknown_split_is_refused(draw):
    with pytest.raises(ValueError, match="split='valid' is unknown: use 'train' or 'test'"):
        draw(np.random.default_rng(0), "valid")


def test_a_sampler_draws_each_split_with_its_own_function():
    space = Box(0.0, 1.0, (1,), dtype=np.float64)
    tasks = TaskSampler(lambda rng: rng.uniform(0.0, 0.5, 1), space, lambda rng: rng.uniform(0.5, 1.0, 1))
    rng = np.random.default_rng(0)
    assert tasks.space.dtype == np.float32
    assert max(tasks.draw(rng, "train")[0] for _ in range(50)) < 0.5
    assert min(tasks.draw(rng, "test")[0] for _ in range(50)) > 0.5
    assert TaskSampler(lambda rng: [0.25], UNIT).draw(rng, "test").tolist() == [0.25]


@pytest.mark.parametrize(
    ("drawn", "message"),
    [
        ([2.0], "outside"),
        ([np.nan], "outside"),
        ([0.1, 0.2], r"shape \(2,\)"),
        (["a"], "give numbers"),
        ([10**400], "give"),
    ],
)
def test_a_sampler_that_draws_a_wrong_task_is_told(drawn, message):
    with pytest.raises(ValueError, match=message):
        TaskSampler(lambda rng: drawn, UNIT).draw(np.random.default_rng(0))


def test_whatever_a_user_passes_becomes_a_distribution():
    rng = np.random.default_rng(0)
    assert as_task_distribution(None).draw(rng).tolist() == [0.0]
    assert as_task_distribution([[1], [2]]).tasks().tolist() == [[1.0], [2.0]]
    assert as_task_distribution(lambda rng: [0.5], UNIT).draw(rng).tolist() == [0.5]
    tasks = TaskSet([[1.0], [2.0]])
    assert as_task_distribution(tasks) is tasks
    with pytest.raises(ValueError, match=r"tasks=.* is a callable without a space: give task_space"):
        as_task_distribution(lambda rng: [0.5])


@pytest.mark.parametrize("tasks", [TaskSet([[0.5]]), TaskSampler(lambda rng: [0.5], UNIT), [[0.5]]])
def test_a_given_space_replaces_the_distributions_own(tasks):
    wide = Box(-9.0, 9.0, (1,))
    assert as_task_distribution(tasks, wide).space == wide


@given(st.lists(st.lists(st.sampled_from([-1.0, -0.0, 0.0, 0.5, 3.0]), min_size=2, max_size=2), min_size=1, max_size=9))
def test_the_index_of_a_task_is_its_first_row(rows):
    tasks = TaskSet(rows, [[3.0, 3.0]], space=Box(-5.0, 5.0, (2,)))
    for row in [*rows, [-1.0, 4.0]]:
        assert tasks.index(row) == (rows.index(row) if row in rows else -1)
    assert tasks.index([3.0, 3.0], "test") == 0


def test_a_sampled_task_is_bounded_as_the_replay_buffer_bounds_it():
    assert numbers.LARGEST == LARGEST
    draw = TaskSampler(lambda rng: [2e9], Box(0.0, np.inf, (1,))).draw
    with pytest.raises(ValueError, match=r"the sampled train task is .*, and holds a number beyond 1e\+09"):
        draw(np.random.default_rng(0))

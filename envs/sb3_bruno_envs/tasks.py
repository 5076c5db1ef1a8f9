"""Draws tasks from finite sets and endless samplers, split into train and test; knows no environment.

A task is a float32 vector of shape ``(dim,)``. Every distribution states the Box that its tasks live in
(``space``) and draws a task from a generator that the caller owns (``draw``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.arguments import check_function

Task: TypeAlias = NDArray[np.float32]
Split: TypeAlias = Literal["train", "test"]
Sample: TypeAlias = Callable[[np.random.Generator], ArrayLike]

LARGEST = 1e9
"""Largest absolute value of a task's entry: products of larger ones overflow float32 in training."""

_ROUNDED = "a whole number that float32, in which tasks are kept, changes to"
_REMEDY = "give an index into a list of your own, or the number in two parts, such as divmod(number, 4096)"


class TaskSet:
    """Draws tasks uniformly from a finite set per split.

    Args:
        train: the training tasks, ``(n, dim)``.
        test: the test tasks, ``(m, dim)``; without them the training tasks serve both splits.
        space: a one-dimensional Box that holds every task; without it, the bounding box of both splits.
        train_box: the Box that the training tasks were drawn from; without it, their bounding box. Test tasks
            outside it are extrapolation, see ``inside_train_box``.

    Raises:
        ValueError: if the tasks are empty, ragged, not finite, beyond 1e9, whole numbers that float32 does not hold, of
            different dimensions or outside ``space``, or a training task is outside ``train_box``.

    Example:
        >>> directions = TaskSet([[-1.0], [1.0]])
        >>> directions.tasks("test").shape
        (2, 1)
    """

    def __init__(
        self,
        train: ArrayLike,
        test: ArrayLike | None = None,
        *,
        space: Box | None = None,
        train_box: Box | None = None,
    ) -> None:
        self._train = _task_matrix(train, "train")
        self._test = self._train if test is None else _task_matrix(test, "test")
        if self._train.shape[1] != self._test.shape[1]:
            raise ValueError(
                f"train tasks have {self._train.shape[1]} dimensions, test tasks {self._test.shape[1]}: "
                "give both the same number of columns."
            )
        both = np.concatenate([self._train, self._test])  # (n + m, dim)
        self.space = Box(both.min(axis=0), both.max(axis=0)) if space is None else as_task_space(space)
        if self.space.shape != both.shape[1:]:
            raise ValueError(
                f"tasks have {both.shape[1]} dimensions, the task space {self.space} has {self.space.shape[0]}: "
                "give tasks of as many numbers as the space has."
            )
        outside = ~((self.space.low <= both) & (both <= self.space.high)).all(axis=1)
        for task in both[outside][:1]:
            check_task(task, self.space, "a task of the set")
        self._orders = {
            "train": _keys(self._train).argsort(kind="stable"),
            "test": _keys(self._test).argsort(kind="stable"),
        }
        bounds = Box(self._train.min(axis=0), self._train.max(axis=0))
        self.train_box = bounds if train_box is None else as_task_space(train_box)
        if self.train_box.shape != bounds.shape or not self.inside_train_box(self._train).all():
            raise ValueError(f"train_box={train_box} does not hold every training task: widen it to {bounds}.")

    def inside_train_box(self, tasks: ArrayLike) -> NDArray[np.bool_]:
        """Say which of ``tasks``, ``(n, dim)``, lie in the box of the training tasks, bounds included, ``(n,)``.

        Raises:
            ValueError: if ``tasks`` is no array of shape ``(n, dim)``.

        Example:
            >>> TaskSet([[0.0], [2.0]], [[1.0], [3.0]]).inside_train_box([[1.0], [3.0]])
            array([ True, False])
        """
        array, (dim,) = np.asarray(tasks, dtype=np.float32), self.space.shape
        if array.ndim != 2 or array.shape[1] != dim:
            raise ValueError(f"tasks have shape {array.shape}: give (n, {dim}).")
        inside: NDArray[np.bool_] = np.all((self.train_box.low <= array) & (array <= self.train_box.high), axis=1)
        return inside

    def beyond(self, candidates: ArrayLike | None = None, *, space: Box | None = None) -> TaskSet:
        """Return a set with the same training tasks, whose test tasks are the candidates outside ``train_box``.

        Args:
            candidates: the tasks to choose from, ``(n, dim)``; None for the test tasks of this set.
            space: the Box that holds every task of the new set; None for that of this set.

        Raises:
            ValueError: if no candidate is outside, or one is outside ``space``.

        Example:
            >>> TaskSet([[0.0], [2.0]], [[1.0], [3.0]]).beyond().tasks("test")
            array([[3.]], dtype=float32)
        """
        tasks = self._test if candidates is None else _task_matrix(candidates, "candidate")
        outside = tasks[~self.inside_train_box(tasks)]
        if len(outside) == 0:
            raise ValueError(f"no candidate lies outside train_box={self.train_box}: give tasks beyond it.")
        return TaskSet(self._train, outside, space=self.space if space is None else space, train_box=self.train_box)

    def tasks(self, split: Split = "train") -> NDArray[np.float32]:
        """Return all tasks of a split, ``(n, dim)``, in the given order; read-only."""
        check_split(split)
        return self._train if split == "train" else self._test

    def index(self, task: ArrayLike, split: Split = "train") -> int:
        """Return the first row of a split's tasks that equals ``task``, or -1; by bisection, for there may be many.

        Example:
            >>> TaskSet([[5.0], [3.0], [5.0]]).index([5.0])
            0
        """
        keys, order = _keys(self.tasks(split)), self._orders[split]
        (wanted,) = _keys(np.asarray(task, dtype=np.float32)[None])
        place = int(np.searchsorted(keys, wanted, sorter=order))
        return int(order[place]) if place < len(order) and keys[order[place]] == wanted else -1

    def draw(self, rng: np.random.Generator, split: Split = "train") -> Task:
        """Draw a task of the split, ``(dim,)``, each as likely as the others."""
        tasks = self.tasks(split)
        task: Task = tasks[rng.integers(len(tasks))].copy()
        return task

    def __eq__(self, other: object) -> bool:
        """Compare both splits and the boxes; rebuilding an environment from its spec compares the tasks."""
        if not isinstance(other, TaskSet):
            return NotImplemented
        same_train = np.array_equal(self._train, other._train) and self.train_box == other.train_box
        return same_train and np.array_equal(self._test, other._test) and self.space == other.space

    def __hash__(self) -> int:
        return hash((self._train.tobytes(), self._test.tobytes()))

    def __repr__(self) -> str:
        return f"TaskSet({len(self._train)} train, {len(self._test)} test, {self.space})"


@dataclass(frozen=True)
class TaskSampler:
    """Draws tasks endlessly, by a function from a generator to a task.

    Args:
        sample: draws one training task, ``(dim,)``, from the generator that it is given.
        space: a one-dimensional Box that holds every task; cast to float32.
        test_sample: draws one test task; without it, ``sample`` serves both splits.

    Raises:
        ValueError: if ``space`` is not a one-dimensional Box, or a function is none.

    Example:
        >>> speeds = TaskSampler(lambda rng: rng.uniform(0.0, 3.0, size=1), Box(0.0, 3.0, (1,)))
    """

    sample: Sample
    space: Box
    test_sample: Sample | None = None

    def __post_init__(self) -> None:
        if not callable(self.sample):
            raise ValueError(f"sample={self.sample!r} is no function: pass sample(rng), which returns a task.")
        check_function("test_sample", self.test_sample, "test_sample(rng), which returns a task")
        object.__setattr__(self, "space", as_task_space(self.space))

    def draw(self, rng: np.random.Generator, split: Split = "train") -> Task:
        """Draw a task of the split, ``(dim,)``.

        Raises:
            ValueError: if the function gives a task outside ``space``.
        """
        check_split(split)
        sample = self.test_sample if split == "test" and self.test_sample is not None else self.sample
        return check_task(sample(rng), self.space, f"the sampled {split} task")


TaskDistribution: TypeAlias = TaskSet | TaskSampler


def as_task_distribution(tasks: Any, space: Box | None = None) -> TaskDistribution:
    """Return the distribution that ``tasks`` describes.

    Args:
        tasks: None (the one constant task ``[0]``), an array-like ``(n, dim)``, a callable that draws a task
            from a generator, a TaskSet or a TaskSampler.
        space: the Box that holds every task. A callable needs it; it replaces the space that others state.

    Raises:
        ValueError: if the tasks are invalid or outside ``space``, or a callable comes without ``space``.
    """
    if isinstance(tasks, TaskSet):
        if space is None:
            return tasks
        return TaskSet(tasks.tasks("train"), tasks.tasks("test"), space=space, train_box=tasks.train_box)
    if isinstance(tasks, TaskSampler):
        return tasks if space is None else replace(tasks, space=space)
    if callable(tasks):
        if space is None:
            raise ValueError(f"tasks={tasks!r} is a callable without a space: give task_space too, or a TaskSampler.")
        return TaskSampler(tasks, space)
    return TaskSet([[0.0]] if tasks is None else tasks, space=space)


def check_split(split: str) -> None:
    """Raise a ValueError unless ``split`` is one of the two splits."""
    if split not in get_args(Split):
        raise ValueError(f"split={split!r} is unknown: use 'train' or 'test'.")


def check_task(task: ArrayLike, space: Box, name: str) -> Task:
    """Return ``task`` as a new float32 vector ``(dim,)`` of ``space``.

    Raises:
        ValueError: if its shape is not that of the space, or a value is not finite, beyond 1e9, outside the bounds or a
            whole number that float32 does not hold.
    """
    try:
        vector, given = np.array(task, dtype=np.float32), np.array(task, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name} is {task!r}: give numbers, of shape {space.shape}.") from error
    if vector.shape != space.shape:
        raise ValueError(f"{name} has shape {vector.shape}: give the shape of the task space, {space.shape}.")
    if not np.isfinite(vector).all() or not space.contains(vector):
        raise ValueError(f"{name} is {vector}, outside {space}: choose one inside, or widen task_space.")
    if (np.abs(vector) > LARGEST).any():
        raise ValueError(f"{name} is {vector}, and holds a number beyond {LARGEST:.0e}: give it in larger units.")
    if _is_rounded_integer(given).any():
        raise ValueError(f"{name} is {task!r}, {_ROUNDED} {vector.tolist()}: {_REMEDY}.")
    return vector


def _task_matrix(tasks: ArrayLike, name: str) -> NDArray[np.float32]:
    """Return ``tasks`` as a read-only float32 array, ``(n, dim)``; a ValueError names the argument."""
    try:
        matrix, given = np.array(tasks, dtype=np.float32), np.array(tasks, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name} tasks are not an array of numbers: give (n, dim), all rows alike.") from error
    if matrix.ndim != 2 or matrix.size == 0:
        raise ValueError(
            f"{name} tasks have shape {matrix.shape}: give at least one, as an array (n, dim); "
            "np.reshape(tasks, (-1, 1)) makes it of n numbers."
        )
    bad = np.flatnonzero(~np.isfinite(matrix).all(axis=1)).tolist()
    if bad:
        raise ValueError(f"{name} tasks hold NaN or infinity in rows {bad}: remove these rows.")
    large = np.flatnonzero((np.abs(matrix) > LARGEST).any(axis=1)).tolist()
    if large:
        raise ValueError(f"{name} tasks hold numbers beyond {LARGEST:.0e} in rows {large}: give them in larger units.")
    for row in np.flatnonzero(_is_rounded_integer(given).any(axis=1))[:1]:
        raise ValueError(
            f"{name} tasks hold {given[row].tolist()} in row {row}, {_ROUNDED} {matrix[row].tolist()}: {_REMEDY}."
        )
    matrix.setflags(write=False)
    return matrix


def _is_rounded_integer(numbers: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which numbers are integers, such as ids or seeds, that float32 changes to others."""
    rounded: NDArray[np.bool_] = (numbers == np.round(numbers)) & (numbers.astype(np.float32) != numbers)
    return rounded


def _keys(tasks: NDArray[np.float32]) -> NDArray[np.void]:
    """View rows ``(n, dim)`` as keys to sort and compare by, ``(n,)``."""
    rows = np.ascontiguousarray(tasks + np.float32(0.0))  # which makes -0.0 and 0.0 the same task
    return rows.view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).ravel()


def as_task_space(space: Box) -> Box:
    """Return ``space`` with float32 bounds; a ValueError refuses all but a one-dimensional Box."""
    if not isinstance(space, Box) or len(space.shape) != 1:
        raise ValueError(f"the task space {space!r} is no vector space: give a Box of shape (dim,).")
    return Box(space.low.astype(np.float32), space.high.astype(np.float32))

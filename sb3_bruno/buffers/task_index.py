"""Which slots of a ring buffer hold which task: arrays only, knows neither transitions nor torch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sb3_bruno.buffers.task_numbers import TaskNumbers, grown

Array = NDArray[np.int64]
LEAST_ROOM = 4
"""Slots for which a new task has room."""


class TaskIndex:
    """Groups slots by task vector, while a ring buffer overwrites its oldest.

    A ring overwrites slots in the order in which it filled them, so the slot that goes is always the oldest of its
    task and a queue per task suffices: first in, first out, with random access. Example: slots 0..3 hold tasks A B A B.
    Slot 0 is overwritten with C: A's queue goes from [0, 2] to [2] and C's becomes [0]. A task whose queue is empty is
    forgotten, so an endless stream of new tasks takes no more memory than the slots it fills.

    The queues are stretches of one array, so that slots of many tasks are looked up at once. A queue at the end of its
    room moves to twice the room it needs, behind all others. Once the array is full, all queues are packed anew.

    Args:
        n_slots: number of slots of the ring.
    """

    def __init__(self, n_slots: int) -> None:
        self._numbers = TaskNumbers()  # of the tasks that hold a slot
        self._number_of_slot = np.full(n_slots, -1, dtype=np.int32)
        # By number of a task: where in the array its queue begins and ends and its room ends.
        self._begin, self._end, self._limit = (np.empty(0, dtype=np.int32) for _ in range(3))
        self._place = np.empty(0, dtype=np.int32)  # among those that hold a slot
        self._live = np.empty(0, dtype=np.int32)  # numbers of the tasks that hold a slot, the first ``len(self)`` of it
        self._queued = np.empty(64, dtype=np.int32)
        self._n_queued = 0

    def __len__(self) -> int:
        """The number of tasks that hold a slot."""
        return len(self._numbers)

    @property
    def task_dim(self) -> int | None:
        """The size of the task vectors; None before the first."""
        return self._numbers.vectors.shape[1] if len(self) else None

    def put(self, slot: int, task: NDArray[np.float32]) -> None:
        """Give ``slot`` to ``task``, taking it from the task that held it."""
        if self._number_of_slot[slot] >= 0:
            self._evict(int(self._number_of_slot[slot]))
        number = self._numbers.find(task)
        if number is None:
            number = self._open(task)
        if self._end[number] == self._limit[number]:
            self._move(number)
        self._queued[self._end[number]] = slot
        self._end[number] += 1
        self._number_of_slot[slot] = number

    def draw(self, size: int, rng: np.random.Generator) -> Array:
        """Draw tasks, uniformly with replacement: their numbers, (size,)."""
        numbers: Array = self._live[rng.integers(len(self), size=size)].astype(np.int64)
        return numbers

    def held(self) -> Array:
        """Return the numbers of all tasks that hold a slot, (n,)."""
        numbers: Array = self._live[: len(self)].astype(np.int64)
        return numbers

    def find(self, task: NDArray[np.float32]) -> int | None:
        """Return the number of a task, (task_dim,); None if it holds no slot."""
        return self._numbers.find(task)

    def number_of(self, slot: int) -> int:
        """Return the number of the task that holds ``slot``."""
        return int(self._number_of_slot[slot])

    def tasks(self, numbers: Array) -> NDArray[np.float32]:
        """Return the vectors of tasks, (n, task_dim)."""
        return self._numbers.vectors[numbers]

    def checksums(self, numbers: Array) -> NDArray[np.uint32]:
        """Return the checksums of tasks, (n,)."""
        return self._numbers.checksums(numbers)

    def counts(self, numbers: Array) -> Array:
        """Return how many slots each of the tasks holds, (n,)."""
        return (self._end[numbers] - self._begin[numbers]).astype(np.int64)

    def slots(self, numbers: Array, places: Array) -> Array:
        """Look up slots of tasks (n,), at places (n, ...), of which 0 is the oldest of each: (n, ...)."""
        begin = self._begin[numbers].reshape(-1, *(1,) * (places.ndim - 1))
        slots: Array = self._queued[begin + places].astype(np.int64)
        return slots

    def _open(self, task: NDArray[np.float32]) -> int:
        place, number = len(self), self._numbers.open(task)
        if number == len(self._begin):
            for name in ("_begin", "_end", "_limit", "_place", "_live"):
                setattr(self, name, grown(getattr(self, name)))
        self._begin[number] = self._end[number] = self._limit[number] = 0
        self._live[place], self._place[number] = number, place
        return number

    def _evict(self, number: int) -> None:
        self._begin[number] += 1
        if self._begin[number] < self._end[number]:
            return
        self._numbers.close(number)
        # The last of the live takes the place of the one that goes, so that no array is shifted.
        place, last = self._place[number], self._live[len(self)]
        self._live[place], self._place[last] = last, place

    def _move(self, number: int) -> None:
        """Move a queue to the end of the array, with twice the room that it needs."""
        count = int(self._end[number] - self._begin[number])
        if self._n_queued + max(2 * count, LEAST_ROOM) > len(self._queued):
            self._pack()
        if self._end[number] < self._limit[number]:
            return  # it was given room where it is
        begin, room = self._n_queued, max(2 * count, LEAST_ROOM)
        self._queued[begin : begin + count] = self._queued[self._begin[number] : self._end[number]]
        self._begin[number], self._end[number], self._limit[number] = begin, begin + count, begin + room
        self._n_queued += room

    def _pack(self) -> None:
        """Write all queues one after the other, each with as much room again, to an array a quarter longer."""
        live = self.held()
        counts = self.counts(live)
        rooms = np.maximum(2 * counts, LEAST_ROOM)
        begins = np.cumsum(rooms) - rooms
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        queued = np.empty(max(5 * int(rooms.sum()) // 4, 64), dtype=np.int32)
        queued[np.repeat(begins, counts) + within] = self._queued[np.repeat(self._begin[live], counts) + within]
        self._queued, self._n_queued = queued, int(rooms.sum())
        self._begin[live], self._end[live], self._limit[live] = begins, begins + counts, begins + rooms

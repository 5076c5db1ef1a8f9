"""Which slots of a ring buffer hold which task: numpy only, knows neither transitions nor torch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.int64]


class SlotQueue:
    """Keeps the slots of one task, oldest first: first in, first out, with random access.

    Args:
        key: the bytes of the task vector.
        number: the queue's place among all queues of its index.
        place: its place among those that hold a slot.
    """

    __slots__ = ("_head", "_slots", "_tail", "key", "number", "place")  # there may be as many queues as transitions

    def __init__(self, key: bytes, number: int, place: int) -> None:
        self.key = key
        self.number = number
        self.place = place
        self._slots = np.empty(4, dtype=np.int32)
        self._head = self._tail = 0

    def __len__(self) -> int:
        return self._tail - self._head

    @property
    def task(self) -> NDArray[np.float32]:
        """The task vector, read-only, shape (task_dim,)."""
        return np.frombuffer(self.key, dtype=np.float32)

    @property
    def slots(self) -> NDArray[np.int32]:
        """A view of the slots, oldest first, shape (len(self),)."""
        return self._slots[self._head : self._tail]

    def append(self, slot: int) -> None:
        """Add the newest slot. Out of room, the live slots move to an array of twice their number."""
        if self._tail == len(self._slots):
            live = self.slots
            self._slots = np.empty(max(2 * len(live), 4), dtype=np.int32)
            self._slots[: len(live)] = live
            self._head, self._tail = 0, len(live)
        self._slots[self._tail] = slot
        self._tail += 1

    def popleft(self) -> None:
        """Forget the oldest slot."""
        self._head += 1


class TaskIndex:
    """Groups slots by task vector, while a ring buffer overwrites its oldest.

    A ring overwrites slots in the order in which it filled them, so the slot that goes is always the oldest of its
    task and a queue per task suffices. Example: slots 0..3 hold tasks A B A B. Slot 0 is overwritten with C: A's
    queue goes from [0, 2] to [2] and C's becomes [0]. A task whose queue is empty is forgotten, so an endless
    stream of new tasks takes no more memory than the slots it fills.

    Args:
        n_slots: number of slots of the ring.
    """

    def __init__(self, n_slots: int) -> None:
        self._queue_of_slot = np.full(n_slots, -1, dtype=np.int32)
        self._queues: list[SlotQueue] = []
        self._free_numbers: list[int] = []
        self._of_task: dict[bytes, SlotQueue] = {}
        self._live: list[SlotQueue] = []

    def __len__(self) -> int:
        """The number of tasks that hold a slot."""
        return len(self._live)

    @property
    def task_dim(self) -> int | None:
        """The size of the task vectors; None before the first."""
        return len(self._live[0].task) if self._live else None

    def put(self, slot: int, task: NDArray[np.float32]) -> None:
        """Give ``slot`` to ``task``, taking it from the task that held it."""
        if self._queue_of_slot[slot] >= 0:
            self._evict(self._queues[self._queue_of_slot[slot]])
        key = task.tobytes()
        queue = self._of_task.get(key) or self._open(key)
        queue.append(slot)
        self._queue_of_slot[slot] = queue.number

    def queue_of(self, slot: int) -> SlotQueue:
        """Return the queue of the task that holds ``slot``."""
        return self._queues[int(self._queue_of_slot[slot])]

    def draw(self, size: int, rng: np.random.Generator) -> list[SlotQueue]:
        """Draw queues of tasks, uniformly with replacement."""
        return [self._live[i] for i in rng.integers(len(self._live), size=size)]

    def _open(self, key: bytes) -> SlotQueue:
        number = self._free_numbers.pop() if self._free_numbers else len(self._queues)
        queue = SlotQueue(key, number, len(self._live))
        if number == len(self._queues):
            self._queues.append(queue)
        else:
            self._queues[number] = queue
        self._of_task[key] = queue
        self._live.append(queue)
        return queue

    def _evict(self, queue: SlotQueue) -> None:
        queue.popleft()
        if len(queue) > 0:
            return
        del self._of_task[queue.key]
        self._free_numbers.append(queue.number)
        # The last of the live takes the place of the one that goes, so that no list is shifted.
        last = self._live.pop()
        if last is not queue:
            self._live[queue.place] = last
            last.place = queue.place

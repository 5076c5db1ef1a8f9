"""Gives the tasks of Meta-World's ML1 and ML10 vectors and names; only ``sb3_bruno_envs.metaworld`` imports it."""

from __future__ import annotations

import pickle
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from sb3_bruno_envs.naming import place_name
from sb3_bruno_envs.tasks import Task, TaskSet

try:
    import metaworld
except ModuleNotFoundError as error:
    message = f"{error.name} is not installed: pip install 'sb3_bruno[metaworld]', in an environment of its own."
    raise ModuleNotFoundError(message, name=error.name) from error

_RAND_VEC_DIM = 6  # where object and goal are, in m; some classes have three numbers, and zeros fill up the rest
_PLACE_ENTRIES = tuple((f"{thing} {axis}", "m") for thing in ("object", "goal") for axis in "xyz")
_LARGEST_SEED = 2**32 - 1  # of NumPy's global generator, which Meta-World seeds


class Benchmark(NamedTuple):
    """A benchmark of Meta-World.

    Attributes:
        classes: of all environments, by name, the training classes first.
        n_train: how many of them are training classes.
        tasks: the task vectors of both splits.
        originals: Meta-World's task for each vector, by the vector's bytes.
    """

    classes: dict[str, Any]
    n_train: int
    tasks: TaskSet
    originals: dict[bytes, Any]

    def original(self, task: Task) -> Any:
        """Return Meta-World's task for a vector, float32.

        Raises:
            ValueError: if the benchmark has no such task.
        """
        if task.tobytes() not in self.originals:
            raise ValueError(f"the task {task} is none of the benchmark's: choose from its TaskSet, by tasks('train').")
        return self.originals[task.tobytes()]

    def name_of(self, task: Task) -> str:
        """Name a task by its class and places: ``"push (0.02, 0.65, 0.02) to (0.1, 0.84, 0.02)"``.

        The first place is the object's, the second the goal's, where the class has one to choose.

        Raises:
            ValueError: if the benchmark of several training classes has no such task.
        """
        skill, places = next(iter(self.classes)), task
        if self.n_train > 1:
            original = self.original(task)
            skill, places = original.env_name, _rand_vec(original)
        named = (place_name(place, decimals=5) for place in places.reshape(-1, 3))  # some classes vary one number alone
        return f"{_skill(skill)} {' to '.join(named)}"

    def entries(self) -> tuple[tuple[str, str], ...]:
        """Say what the numbers of a task are: name and unit of each."""
        skills = tuple((_skill(name), "") for name in list(self.classes)[: self.n_train])
        return (*(skills if self.n_train > 1 else ()), *_PLACE_ENTRIES)


@dataclass(frozen=True)
class TaskNames:
    """Names the tasks of a benchmark. Its pickle holds what the benchmark is made of, not its tasks."""

    name: str
    seed: int

    def __call__(self, task: Task) -> str:
        return load_benchmark(self.name, self.seed).name_of(task)


def load_benchmark(name: str, seed: int) -> Benchmark:
    """Make the tasks of a benchmark, once in a process; NumPy's global generator stays as it is.

    Raises:
        ValueError: if there is no such class, or ``seed`` is no seed.
    """
    if name != "ML10" and name not in metaworld.ML1.ENV_NAMES:
        raise ValueError(f"name={name!r} is no benchmark: give 'ML10', or for ML1 one of {metaworld.ML1.ENV_NAMES}.")
    is_whole = isinstance(seed, int | np.integer) and not isinstance(seed, bool)
    if not is_whole or not 0 <= seed <= _LARGEST_SEED:
        raise ValueError(f"seed={seed!r} is no seed: give an integer from 0 to {_LARGEST_SEED}.")
    return _load(name, int(seed))


@lru_cache(maxsize=8)
def _load(name: str, seed: int) -> Benchmark:
    return describe(metaworld.ML10(seed=seed) if name == "ML10" else metaworld.ML1(name, seed=seed))


def describe(benchmark: Any) -> Benchmark:
    """Give the tasks of one of Meta-World's benchmarks vectors, with a one-hot part if it trains on several classes."""
    train, originals = list(benchmark.train_classes), {}
    splits = []
    for tasks in (benchmark.train_tasks, benchmark.test_tasks):
        splits.append([_vector(task, train) for task in tasks])
        originals.update({vector.tobytes(): task for vector, task in zip(splits[-1], tasks, strict=True)})
    classes = {**benchmark.train_classes, **benchmark.test_classes}
    return Benchmark(classes, len(train), TaskSet(*splits), originals)


def _vector(task: Any, train: list[str]) -> Task:
    """Return the vector of one of Meta-World's tasks, float32."""
    rand_vec = _rand_vec(task)
    if len(train) == 1:
        return rand_vec
    filled = np.zeros(_RAND_VEC_DIM)
    filled[: len(rand_vec)] = rand_vec
    return np.array([*(task.env_name == name for name in train), *filled], dtype=np.float32)


def _rand_vec(task: Any) -> Task:
    """Return where Meta-World's task has object and goal, in m, ``(6,)`` or ``(3,)``, float32."""
    return np.asarray(pickle.loads(task.data)["rand_vec"], dtype=np.float32)


def _skill(name: str) -> str:
    """Return the name of a class without its version: ``"door-close-v3"`` gives ``"door-close"``."""
    return re.sub(r"-v\d+$", "", name)

"""Describes an exported step in plain JSON: what goes in and comes out, of which shapes and in which units."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch as th
from gymnasium import spaces

import sb3_bruno
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders.task_readout import ListReadout, TaskReadout
from sb3_bruno.export.step import Step

METADATA = "sb3_bruno"
"""The name of the description in a file."""
FORMAT = 1


def describe(model: TaskInference, step: Step) -> dict[str, Any]:
    """Describe an agent's step, in values that JSON can hold. Bounds that are infinite are None."""
    starts = np.cumsum([0, *(shape.numel() for shape in step.parts.values())])
    return {
        "format": FORMAT,
        "made_by": {
            "algorithm": type(model).__name__,
            "encoder": type(step.encoder).__name__,
            "sb3_bruno": sb3_bruno.__version__,
            "torch": th.__version__,
            "training_steps": model.num_timesteps,
        },
        "inputs": {name: list(tensor.shape) for name, tensor in step.example().items()},
        "outputs": step.output_names(),
        "observation": _box(model.policy.observation_space["observation"]),
        "action": _box(model.action_space),
        "memory": [
            {"name": name, "shape": list(shape), "start": int(start)}
            for (name, shape), start in zip(step.parts.items(), starts, strict=False)
        ],
        "forget_threshold": _number(step.forget_threshold),
        "task": None if step.readout is None else _task(model, step.readout),
    }


def _task(model: TaskInference, readout: TaskReadout) -> dict[str, Any]:
    """Describe what the read-out tells: the names and units of a task's entries, and the few tasks if they are few."""
    tasks = readout.tasks.tolist() if isinstance(readout, ListReadout) else None
    return {**model.task_labels._asdict(), "tasks": tasks, "task_names": list(model.task_labels.tasks)}


def _box(space: Any) -> dict[str, Any]:
    """Describe a space of the env's own numbers, which a step takes and returns flat."""
    assert isinstance(space, spaces.Box)  # for mypy
    return {"shape": list(space.shape), "low": _bounds(space.low), "high": _bounds(space.high)}


def _bounds(bounds: Any) -> list[float | None]:
    return [_number(bound) for bound in bounds.ravel()]


def _number(number: Any) -> float | None:
    """JSON has no infinity."""
    return None if number is None or not np.isfinite(number) else float(number)

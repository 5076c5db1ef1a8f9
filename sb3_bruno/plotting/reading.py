"""Reads what an agent takes its task for, in the form that a film draws: a few numbers with their names and spreads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sb3_bruno.algorithms.carried import State
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders import HasPosterior
from sb3_bruno.encoders.abilities import check_ability
from sb3_bruno.evaluation.floats import Floats


class Reading(NamedTuple):
    """What an agent takes its task for at one step.

    Attributes:
        values: ``(n,)``.
        spread: the standard deviation of each, ``(n,)``; zeros for probabilities.
        names: of each value, ``""`` for none.
        about: what the values are.
        is_task: whether they are the entries of a task vector, so that the truth can be drawn beside them.
        bounds: where the values can lie; None if anywhere.
    """

    values: Floats
    spread: Floats
    names: tuple[str, ...]
    about: str
    is_task: bool = False
    bounds: tuple[float, float] | None = None


def check_readable(model: TaskInference) -> None:
    """Refuse an agent that tells nothing: it has no read-out of the task, and its encoder no posterior.

    Raises:
        ValueError: if it is one.
    """
    if model.policy.readout is None:
        check_ability(model.encoder, HasPosterior, "A film of an agent without a read-out of the task")


def read_task(model: TaskInference, state: State) -> Reading:
    """Read the task, as the agent takes it, from a ``state`` that ``predict`` returned for one environment.

    An agent with a read-out tells probabilities where tasks are few, else mean and spread of the task; any other tells
    its belief.
    """
    if model.policy.readout is None:
        belief = model.belief(state)
        mean, std = belief.mean[0].astype(float), np.sqrt(belief.var[0].astype(float))
        return Reading(mean, std, ("",) * len(mean), "belief: mean and std of the latents")
    estimate = model.task_estimate(state)
    labels = estimate.labels
    if estimate.probabilities is not None:
        chances = estimate.probabilities[0].astype(float)
        return Reading(chances, np.zeros(len(chances)), labels.tasks, "probability of each task", bounds=(0.0, 1.0))
    mean, std = estimate.mean[0].astype(float), estimate.std[0].astype(float)
    names, units = labels.names or ("",) * len(mean), labels.units or ("",) * len(mean)
    same = len(set(units)) == 1 and units[0]
    about = f"{names[0] if len(mean) == 1 and names[0] else 'task'}{f', {units[0]}' if same else ''}: mean and std"
    space = model.task_space
    known = space is not None and np.isfinite([space.low, space.high]).all()
    bounds = (float(space.low.min()), float(space.high.max())) if known else None
    return Reading(mean, std, names, about, is_task=True, bounds=bounds)

"""Plays episodes of the same seed and actions, and compares them; knows neither checks nor algorithms."""

from __future__ import annotations

import copy
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

Env: TypeAlias = gym.Env[Any, Any]
Episode: TypeAlias = list[NDArray[np.float64]]  # the first observation; then observation, reward and end of each step

SHORT, LONG = 20, 200  # steps
HOLDS = (10, 10, 30, 30, 30)  # steps in a row with the same action, in long episodes


class Plan(NamedTuple):
    """What episodes that are compared have in common.

    Attributes:
        seed: of the reset.
        actions: one after another.
    """

    seed: int
    actions: list[Any]


def short_plan(env: Env) -> Plan:
    """Return a few random actions."""
    return Plan(0, _actions(env, SHORT, 0))


def long_plans(env: Env) -> list[Plan]:
    """Return plans that lead further: they hold each action for a while, most of them one of the space's extremes."""
    return [Plan(seed, _held_actions(env, LONG, seed, hold)) for seed, hold in enumerate(HOLDS, start=1)]


def _actions(env: Env, n: int, seed: int) -> list[Any]:
    """Return ``n`` random actions; the generator of the environment's action space stays."""
    space = copy.deepcopy(env.action_space)
    space.seed(seed)
    return [space.sample() for _ in range(n)]


def _held_actions(env: Env, n: int, seed: int, hold: int) -> list[Any]:
    """Return ``n`` actions, each ``hold`` times in a row: the space's extremes, with seed 1 random ones."""
    actions = _actions(env, -(-n // hold), seed)
    space = env.action_space
    if seed > 1 and isinstance(space, Box) and space.is_bounded():
        actions = [np.where(action > (space.low + space.high) / 2, space.high, space.low) for action in actions]
    return [action for action in actions for _ in range(hold)][:n]


def play(env: Env, tasks: Iterable[NDArray[Any]], plan: Plan, deadline: float = np.inf) -> list[Episode]:
    """Play an episode of each task in turn.

    Raises:
        TimeoutError: if the clock ``time.perf_counter`` passes the deadline.
    """
    episodes = []
    for task in tasks:
        check_time(env, deadline)
        observation, _ = env.reset(seed=plan.seed, options={"task": task})
        episode = [_flat(observation)]
        for action in plan.actions:
            check_time(env, deadline)
            observation, reward, terminated, truncated, _ = env.step(action)
            episode.append(np.append(_flat(observation), [float(reward), terminated, truncated]))
            if terminated or truncated:
                break
        episodes.append(episode)
    return episodes


def check_time(env: Env, deadline: float) -> None:
    """Raise a TimeoutError if the clock ``time.perf_counter`` has passed the deadline."""
    if time.perf_counter() > deadline:
        raise TimeoutError(f"{env} is too slow to compare its tasks in time.")


def _flat(observation: Any) -> NDArray[np.float64]:
    parts = [observation[key] for key in sorted(observation)] if isinstance(observation, dict) else [observation]
    return np.concatenate([np.ravel(np.asarray(part, dtype=np.float64)) for part in parts])


def alike(episode: Episode, other: Episode, tolerance: float) -> bool:
    """Return whether two episodes have the same length and, up to a relative ``tolerance``, the same numbers."""
    if [part.shape for part in episode] != [part.shape for part in other]:
        return False
    numbers, others = np.concatenate(episode), np.concatenate(other)
    return np.allclose(numbers, others, rtol=tolerance, atol=tolerance, equal_nan=True)


def any_effect(first: Episode, others: list[Episode]) -> bool:
    """Return whether another episode differs from the first, or numbers that are not finite would hide it."""
    finite = bool(np.isfinite(np.concatenate(first)).all())
    return not finite or not all(alike(first, other, 0.0) for other in others)


@contextmanager
def frozen_statistics(env: Env) -> Iterator[None]:
    """Stop Gymnasium's normalising wrappers from learning: an episode would depend on those before it."""
    learning = []
    layer: Any = env
    while isinstance(layer, gym.Wrapper):
        if getattr(layer, "update_running_mean", False):
            learning.append(layer)
        layer = layer.env
    for layer in learning:
        layer.update_running_mean = False
    try:
        yield
    finally:
        for layer in learning:
            layer.update_running_mean = True

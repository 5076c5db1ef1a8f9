"""Refuses a training that cannot be, before it has made a folder: its environment, its hyperparameters."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping
from typing import Any

import rl_zoo3
from gymnasium import spaces

from sb3_bruno.algorithms.arguments import check_known
from sb3_bruno.algorithms.values import DICTS, RATES, check_values, check_whole
from sb3_bruno.zoo.environments import Wrap, make_env
from sb3_bruno.zoo.registry import ALGORITHMS

READ_BY_RL_ZOO = (
    *("callback", "env_kwargs", "env_wrapper", "frame_stack", "monitor_kwargs", "n_envs", "n_timesteps"),
    *("noise_std", "noise_type", "normalize", "vec_env_wrapper"),
)
"""Hyperparameters of a config that are no arguments of the algorithm."""
SCHEDULES = ("learning_rate", "encoder_learning_rate", "clip_range", "clip_range_vf", "delta_std")
NUMBER = r"\d+\.?\d*(?:[eE][+-]?\d+)?"


def check_env(algo: str, env_id: str, env_kwargs: dict[str, Any], wrap: Wrap | None) -> None:
    """Refuse an environment that one of our algorithms cannot learn in.

    Raises:
        ValueError: if it has no hidden task, or actions that are not continuous; or cannot be made.
    """
    env = make_env(env_id, env_kwargs, wrap)
    try:
        if algo not in ALGORITHMS:
            return
        if not isinstance(env.action_space, spaces.Box):
            kind = type(env.action_space).__name__
            raise ValueError(f"--env {env_id} has {kind} actions: --algo {algo} needs continuous ones, a Box")
        if not env.has_wrapper_attr("task_space"):
            raise ValueError(
                f"--env {env_id} has no hidden task: register one in MetaTask and TransitionObservation "
                "(docs/your-own-env.md), or choose an --algo that infers none, such as sac"
            )
    finally:
        env.close()


def check_hyperparameters(algo: str, config: Mapping[str, Any]) -> None:
    """Refuse hyperparameters that rl_zoo3 or the algorithm could not read.

    Args:
        algo: rl_zoo3's name of the algorithm.
        config: the hyperparameters, as a config has them: some are text that rl_zoo3 evaluates.

    Raises:
        TypeError: if a value is of a wrong kind.
        ValueError: if one is missing or out of range, or a name is unknown.
    """
    for needed, example in (("policy", "MlpPolicy"), ("n_timesteps", "100000")):
        if needed not in config:
            raise ValueError(f"the config has no {needed}: add it, such as `{needed}: {example}`")
    known = [*inspect.signature(rl_zoo3.ALGOS[algo]).parameters, *READ_BY_RL_ZOO]
    check_known(rl_zoo3.ALGOS[algo].__name__, config, known, TypeError)
    steps = config["n_timesteps"]
    check_whole("n_timesteps", int(steps) if isinstance(steps, float) and steps.is_integer() else steps, 1)
    check_whole("n_envs", config.get("n_envs", 1), 1)
    for name in SCHEDULES:
        if isinstance(config.get(name), str):
            _check_schedule(name, config[name])
    check_values({name: value for name, value in config.items() if not _is_evaluated(name, value)})


def _is_evaluated(name: str, value: Any) -> bool:
    """Say whether rl_zoo3 makes something else of a text."""
    return isinstance(value, str) and name in {*DICTS, *RATES, "replay_buffer_class"}


def _check_schedule(name: str, text: str) -> None:
    """Raise a ValueError unless the text is a schedule: ``lin_1e-3``."""
    if re.fullmatch(f"lin_{NUMBER}", text):
        return
    number = re.search(f"{NUMBER}$", text)
    remedy = f"write lin_{number[0] if number else '1e-3'}, which falls linearly to 0, or a number"
    if number and number[0] == text:
        remedy = f"YAML takes {text} for text, so write {float(text)!r} or !!float {text}"
    raise ValueError(f"{name}={text!r} is no schedule: {remedy}")

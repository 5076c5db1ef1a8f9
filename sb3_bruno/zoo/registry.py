"""Registers our algorithms with rl_zoo3, and environments with Gymnasium."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from typing import Any

import gymnasium as gym
import rl_zoo3
from rl_zoo3.hyperparams_opt import HYPERPARAMS_CONVERTER, HYPERPARAMS_SAMPLER

import sb3_bruno
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders import TaskEncoder, find_encoder
from sb3_bruno.zoo.one_line import in_one_line
from sb3_bruno.zoo.sampler import SearchSpace

ALGORITHMS: dict[str, type[TaskInference]] = {
    "bruno_sac": sb3_bruno.BrunoSAC,
    "bruno_tqc": sb3_bruno.BrunoTQC,
    "bruno_crossq": sb3_bruno.BrunoCrossQ,
    "bruno_td3": sb3_bruno.BrunoTD3,
    "pearl_sac": sb3_bruno.PearlSAC,
    "recurrent_sac": sb3_bruno.RecurrentSAC,
    "recurrent_tqc": sb3_bruno.RecurrentTQC,
    "recurrent_crossq": sb3_bruno.RecurrentCrossQ,
    "recurrent_td3": sb3_bruno.RecurrentTD3,
    "varibad_sac": sb3_bruno.VaribadSAC,
    "belief_sac": sb3_bruno.BeliefSAC,
}


def register() -> None:
    """Add our algorithms and their search space to rl_zoo3's, and our environments to Gymnasium's.

    rl_zoo3 lists its algorithms when it builds a parser, so register before it does.
    """
    importlib.import_module("sb3_bruno_envs")
    rl_zoo3.ALGOS.update(ALGORITHMS)
    for name in ALGORITHMS:
        HYPERPARAMS_SAMPLER[name], HYPERPARAMS_CONVERTER[name] = sampler_of(name, {}), converter_of(name, {})


def encoder_of(algo: str, config: Mapping[str, Any]) -> type[TaskEncoder]:
    """Find the class of the encoder that a config chooses, or the default of one of our algorithms.

    Raises:
        ValueError: if there is no encoder of that name.
    """
    return find_encoder(config.get("encoder_class") or ALGORITHMS[algo].default_encoder)


def search_space_of(algo: str, config: Mapping[str, Any]) -> SearchSpace | None:
    """Make the search space of one of our algorithms with a config, which may choose another encoder.

    Args:
        algo: rl_zoo3's name of the algorithm.
        config: the hyperparameters that are not drawn.

    Returns:
        None if the algorithm is not ours.
    """
    if algo not in ALGORITHMS:
        return None
    return SearchSpace(encoder_of(algo, config), config.get("encoder_kwargs"))


def sampler_of(algo: str, config: Mapping[str, Any]) -> Callable[..., dict[str, Any]]:
    """Find the function that draws hyperparameters, as rl_zoo3 calls it."""
    space = search_space_of(algo, config)
    sampler: Callable[..., dict[str, Any]] = HYPERPARAMS_SAMPLER[algo] if space is None else space.sample
    return sampler


def converter_of(algo: str, config: Mapping[str, Any]) -> Callable[..., dict[str, Any]]:
    """Find the function that converts what was drawn, as rl_zoo3 calls it."""
    space = search_space_of(algo, config)
    converter: Callable[..., dict[str, Any]] = HYPERPARAMS_CONVERTER[algo] if space is None else space.convert
    return converter


def check_algorithm(algo: str) -> None:
    """Refuse a name that no algorithm has.

    Raises:
        ValueError: naming the nearest that there is.
    """
    if algo not in rl_zoo3.ALGOS:
        nearest = get_close_matches(algo, rl_zoo3.ALGOS, n=1)
        remedy = f"did you mean {nearest[0]}?" if nearest else f"there are {', '.join(sorted(rl_zoo3.ALGOS))}"
        raise ValueError(f"--algo {algo} is unknown: {remedy}")


def check_searchable(algo: str) -> None:
    """Refuse an algorithm that is unknown, or has no search space.

    Raises:
        ValueError: naming the nearest, or those that can be searched.
    """
    check_algorithm(algo)
    if algo not in HYPERPARAMS_SAMPLER:
        remedy = ", ".join(sorted(HYPERPARAMS_SAMPLER.keys() & rl_zoo3.ALGOS))
        raise ValueError(f"--algo {algo} has no search space: give one of {remedy}")


def check_registered(env_id: str) -> None:
    """Refuse an environment that nobody has registered.

    Raises:
        ValueError: naming the nearest id, or the flag that is missing.
    """
    if env_id in gym.registry:
        return
    remedy = "name the package that does by --gym-packages"
    nearest = get_close_matches(env_id, gym.registry, n=1)
    if nearest:
        remedy = f"did you mean {nearest[0]}? Or {remedy}"
    raise ValueError(f"--env {env_id} is not registered: {remedy}")


def import_packages(packages: Iterable[str]) -> None:
    """Import the packages of ``--gym-packages``, which register environments.

    Raises:
        ValueError: if one cannot be imported.
    """
    for package in packages:
        try:
            importlib.import_module(package)
        except Exception as error:  # importing runs the package, which may raise anything
            problem = f"cannot be imported: {in_one_line(error)}"
            raise ValueError(f"--gym-packages {package} {problem}: install it, or name another") from error

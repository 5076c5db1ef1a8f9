"""Registers our algorithms with rl_zoo3, and environments with Gymnasium."""

from __future__ import annotations

import importlib
from collections.abc import Iterable

import rl_zoo3
from rl_zoo3.hyperparams_opt import HYPERPARAMS_CONVERTER, HYPERPARAMS_SAMPLER

import sb3_bruno
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders import find_encoder
from sb3_bruno.zoo.one_line import in_one_line
from sb3_bruno.zoo.sampler import SearchSpace

ALGORITHMS: dict[str, type[TaskInference]] = {
    "bruno_sac": sb3_bruno.BrunoSAC,
    "bruno_tqc": sb3_bruno.BrunoTQC,
    "bruno_crossq": sb3_bruno.BrunoCrossQ,
    "bruno_td3": sb3_bruno.BrunoTD3,
    "recurrent_sac": sb3_bruno.RecurrentSAC,
    "recurrent_tqc": sb3_bruno.RecurrentTQC,
    "recurrent_crossq": sb3_bruno.RecurrentCrossQ,
    "recurrent_td3": sb3_bruno.RecurrentTD3,
}


def register() -> None:
    """Add our algorithms and their search space to rl_zoo3's, and our environments to Gymnasium's.

    rl_zoo3 lists its algorithms when it builds a parser, so register before it does.
    """
    importlib.import_module("sb3_bruno_envs")
    rl_zoo3.ALGOS.update(ALGORITHMS)
    for name, algorithm in ALGORITHMS.items():
        space = SearchSpace(find_encoder(algorithm.default_encoder))
        HYPERPARAMS_SAMPLER[name] = space.sample
        HYPERPARAMS_CONVERTER[name] = space.convert


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

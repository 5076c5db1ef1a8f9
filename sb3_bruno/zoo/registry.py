"""What rl_zoo3 is told of: our algorithms and our environments."""

from __future__ import annotations

import importlib

import rl_zoo3
from rl_zoo3.hyperparams_opt import HYPERPARAMS_CONVERTER, HYPERPARAMS_SAMPLER
from stable_baselines3.common.base_class import BaseAlgorithm

import sb3_bruno
from sb3_bruno.zoo.sampler import convert_bruno, sample_bruno

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {
    "bruno_sac": sb3_bruno.BrunoSAC,
    "bruno_tqc": sb3_bruno.BrunoTQC,
    "bruno_crossq": sb3_bruno.BrunoCrossQ,
    "bruno_td3": sb3_bruno.BrunoTD3,
}


def register() -> None:
    """Add our algorithms and their search space to rl_zoo3's, in place, before it builds its parsers.

    Our environments are added to Gymnasium's.
    """
    importlib.import_module("sb3_bruno_envs")
    rl_zoo3.ALGOS.update(ALGORITHMS)
    HYPERPARAMS_SAMPLER.update(dict.fromkeys(ALGORITHMS, sample_bruno))
    HYPERPARAMS_CONVERTER.update(dict.fromkeys(ALGORITHMS, convert_bruno))

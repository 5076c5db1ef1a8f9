"""What rl_zoo3 is told of: our algorithms and our environments."""

from __future__ import annotations

import importlib

import rl_zoo3
from stable_baselines3.common.base_class import BaseAlgorithm

import sb3_bruno

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {
    "bruno_sac": sb3_bruno.BrunoSAC,
    "bruno_tqc": sb3_bruno.BrunoTQC,
    "bruno_crossq": sb3_bruno.BrunoCrossQ,
    "bruno_td3": sb3_bruno.BrunoTD3,
}


def register() -> None:
    """Add our algorithms to rl_zoo3's, in place, before it builds its parsers, and our environments to Gymnasium's."""
    importlib.import_module("sb3_bruno_envs")
    rl_zoo3.ALGOS.update(ALGORITHMS)

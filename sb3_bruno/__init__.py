"""Meta reinforcement learning for Stable-Baselines3: agents that work out which task they are in."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sb3_bruno.algorithms.crossq import BrunoCrossQ, RecurrentCrossQ, TaskCrossQ
    from sb3_bruno.algorithms.sac import BeliefSAC, BrunoSAC, PearlSAC, RecurrentSAC, TaskSAC, VaribadSAC
    from sb3_bruno.algorithms.td3 import BrunoTD3, RecurrentTD3, TaskTD3
    from sb3_bruno.algorithms.tqc import BrunoTQC, RecurrentTQC, TaskTQC
    from sb3_bruno.buffers import TaskReplayBuffer
    from sb3_bruno.encoders import BrunoEncoder, RecurrentEncoder, TaskEncoder, Transitions

__version__ = "0.1.0"

__all__ = [
    "BeliefSAC",
    "BrunoCrossQ",
    "BrunoEncoder",
    "BrunoSAC",
    "BrunoTD3",
    "BrunoTQC",
    "PearlSAC",
    "RecurrentCrossQ",
    "RecurrentEncoder",
    "RecurrentSAC",
    "RecurrentTD3",
    "RecurrentTQC",
    "TaskCrossQ",
    "TaskEncoder",
    "TaskReplayBuffer",
    "TaskSAC",
    "TaskTD3",
    "TaskTQC",
    "Transitions",
    "VaribadSAC",
]

_ROOMS = ("algorithms", "buffers", "encoders")
_HOMES = {
    "Encoder": "encoders",
    "Transitions": "encoders",
    "Buffer": "buffers",
    "CrossQ": "algorithms.crossq",
    "SAC": "algorithms.sac",
    "TD3": "algorithms.td3",
    "TQC": "algorithms.tqc",
}
"""The module of every name above, by the name's end."""


def __getattr__(name: str) -> Any:
    """Import what is asked for only then, so that ``sb3-bruno --help`` need not wait for torch."""
    if name in _ROOMS:
        return importlib.import_module(f"{__name__}.{name}")
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = next(home for end, home in _HOMES.items() if name.endswith(end))
    globals()[name] = getattr(importlib.import_module(f"{__name__}.{home}"), name)
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *_ROOMS})

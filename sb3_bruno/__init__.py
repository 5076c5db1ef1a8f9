"""Meta reinforcement learning for Stable-Baselines3: agents that work out which task they are in."""

from sb3_bruno.algorithms.crossq import BrunoCrossQ, RecurrentCrossQ, TaskCrossQ
from sb3_bruno.algorithms.sac import BrunoSAC, RecurrentSAC, TaskSAC
from sb3_bruno.algorithms.td3 import BrunoTD3, RecurrentTD3, TaskTD3
from sb3_bruno.algorithms.tqc import BrunoTQC, RecurrentTQC, TaskTQC
from sb3_bruno.buffers import TaskReplayBuffer
from sb3_bruno.encoders import BrunoEncoder, RecurrentEncoder, TaskEncoder, Transitions

__version__ = "0.1.0"

__all__ = [
    "BrunoCrossQ",
    "BrunoEncoder",
    "BrunoSAC",
    "BrunoTD3",
    "BrunoTQC",
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
]

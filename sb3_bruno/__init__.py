"""Meta reinforcement learning for Stable-Baselines3: agents that work out which task they are in."""

from sb3_bruno.algorithms.crossq import BrunoCrossQ
from sb3_bruno.algorithms.sac import BrunoSAC
from sb3_bruno.algorithms.td3 import BrunoTD3
from sb3_bruno.algorithms.tqc import BrunoTQC
from sb3_bruno.buffers.task_buffer import TaskReplayBuffer
from sb3_bruno.encoders import BrunoEncoder, TaskEncoder, Transitions

__version__ = "0.1.0"

__all__ = [
    "BrunoCrossQ",
    "BrunoEncoder",
    "BrunoSAC",
    "BrunoTD3",
    "BrunoTQC",
    "TaskEncoder",
    "TaskReplayBuffer",
    "Transitions",
]

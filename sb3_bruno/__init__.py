"""Meta reinforcement learning for Stable-Baselines3: agents that work out which task they are in."""

from sb3_bruno.bruno_sac import BrunoSAC
from sb3_bruno.buffers import TaskReplayBuffer
from sb3_bruno.encoders import BrunoEncoder, TaskEncoder, Transitions
from sb3_bruno.policies import BrunoSACPolicy

__version__ = "0.1.0"

__all__ = ["BrunoEncoder", "BrunoSAC", "BrunoSACPolicy", "TaskEncoder", "TaskReplayBuffer", "Transitions"]

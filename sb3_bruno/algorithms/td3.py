"""BrunoTD3: TD3 whose actor acts on observation and belief."""

from __future__ import annotations

from typing import ClassVar

from stable_baselines3 import TD3
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.td3.policies import TD3Policy

from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.algorithms.task_inference import TaskInference


class BrunoTD3Policy(TaskInferencePolicy, TD3Policy):
    """TD3's policy on observation and belief."""


class BrunoTD3(TaskInference, TD3):
    """Twin Delayed DDPG with BRUNO task inference.

    Takes ``TD3``'s arguments and those of ``TaskInference``; ``replay_buffer_kwargs`` are those of
    ``TaskReplayBuffer``. The belief is that of ``BrunoSAC``.

    Example:
        >>> model = BrunoTD3("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """

    policy: BrunoTD3Policy
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {
        "MlpPolicy": BrunoTD3Policy,
        "MultiInputPolicy": BrunoTD3Policy,
    }

"""BrunoSAC: SAC whose actor acts on observation and belief."""

from __future__ import annotations

from typing import ClassVar

from stable_baselines3 import SAC
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.sac.policies import SACPolicy

from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.algorithms.task_inference import TaskInference


class BrunoSACPolicy(TaskInferencePolicy, SACPolicy):
    """SAC's policy on observation and belief."""


class BrunoSAC(TaskInference, SAC):
    """Soft Actor-Critic with BRUNO task inference.

    Takes ``SAC``'s arguments and those of ``TaskInference``; ``replay_buffer_kwargs`` are those of
    ``TaskReplayBuffer``. Reference: Korshunova et al., Exchangeable Models in Meta Reinforcement Learning (2020).

    Example:
        >>> model = BrunoSAC("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """

    policy: BrunoSACPolicy
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {
        "MlpPolicy": BrunoSACPolicy,
        "MultiInputPolicy": BrunoSACPolicy,
    }

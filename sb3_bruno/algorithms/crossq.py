"""BrunoCrossQ: CrossQ whose actor acts on observation and belief."""

from __future__ import annotations

from typing import ClassVar

from sb3_contrib import CrossQ
from sb3_contrib.crossq.policies import CrossQPolicy
from stable_baselines3.common.policies import BasePolicy

from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.algorithms.task_inference import TaskInference


class BrunoCrossQPolicy(TaskInferencePolicy, CrossQPolicy):
    """CrossQ's policy on observation and belief."""


class BrunoCrossQ(TaskInference, CrossQ):
    """CrossQ, without target networks and with batch normalisation in their place, with BRUNO task inference.

    Takes ``CrossQ``'s arguments and those of ``TaskInference``; ``replay_buffer_kwargs`` are those of
    ``TaskReplayBuffer``. The belief is that of ``BrunoSAC``.

    Example:
        >>> model = BrunoCrossQ("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """

    policy: BrunoCrossQPolicy
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {
        "MlpPolicy": BrunoCrossQPolicy,
        "MultiInputPolicy": BrunoCrossQPolicy,
    }

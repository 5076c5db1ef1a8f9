"""BrunoTQC: TQC whose actor acts on observation and belief."""

from __future__ import annotations

from typing import ClassVar

from sb3_contrib import TQC
from sb3_contrib.tqc.policies import TQCPolicy
from stable_baselines3.common.policies import BasePolicy

from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.algorithms.task_inference import TaskInference


class BrunoTQCPolicy(TaskInferencePolicy, TQCPolicy):
    """TQC's policy on observation and belief."""


class BrunoTQC(TaskInference, TQC):
    """Truncated Quantile Critics with BRUNO task inference.

    Takes ``TQC``'s arguments and those of ``TaskInference``; ``replay_buffer_kwargs`` are those of
    ``TaskReplayBuffer``. The belief is that of ``BrunoSAC``.

    Example:
        >>> model = BrunoTQC("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """

    policy: BrunoTQCPolicy
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = {
        "MlpPolicy": BrunoTQCPolicy,
        "MultiInputPolicy": BrunoTQCPolicy,
    }

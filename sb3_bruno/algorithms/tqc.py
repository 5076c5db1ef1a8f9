"""TQC with task inference: by BRUNO, by a recurrent network, or by any encoder."""

from __future__ import annotations

from typing import ClassVar, Generic, Unpack

from sb3_contrib import TQC
from sb3_contrib.tqc.policies import Critic, TQCPolicy
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv

from sb3_bruno.algorithms.arguments import EncoderArguments, TQCArguments, takes_arguments_of
from sb3_bruno.algorithms.lean_networks import LeanCritic
from sb3_bruno.algorithms.policies import POLICY_NAMES, TaskInferencePolicy
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders import TaskEncoder
from sb3_bruno.encoders.bruno_arguments import BrunoArguments
from sb3_bruno.encoders.recurrent import RecurrentArguments


class TaskTQCCritic(LeanCritic, Critic):  # type: ignore[misc]  # there, the actions are named `action`
    """TQC's critics."""


class TaskTQCPolicy(TaskInferencePolicy, TQCPolicy):
    """Acts as TQC's policy does, on observation and belief."""

    critic_class: ClassVar[type[LeanCritic] | None] = TaskTQCCritic


class TaskTQC(TaskInference, TQC, Generic[EncoderArguments]):
    """Truncated Quantile Critics with the encoder that ``encoder_class`` names.

    Takes ``TQC``'s arguments by name, and those of ``TaskInference``; ``replay_buffer_kwargs`` are those of
    ``TaskReplayBuffer``.
    """

    policy: TaskTQCPolicy
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = dict.fromkeys(POLICY_NAMES, TaskTQCPolicy)

    @takes_arguments_of(TQC, TaskInference)
    def __init__(
        self,
        policy: str | type[TaskInferencePolicy],
        env: GymEnv | str,
        **kwargs: Unpack[TQCArguments[EncoderArguments]],
    ) -> None:
        super().__init__(policy, env, **kwargs)


class BrunoTQC(TaskTQC[BrunoArguments]):
    """Truncated Quantile Critics with BRUNO task inference; ``encoder_kwargs`` are those of ``BrunoEncoder``.

    Reference: Korshunova et al., Exchangeable Models in Meta Reinforcement Learning (2020).

    Example:
        >>> model = BrunoTQC("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """


class RecurrentTQC(TaskTQC[RecurrentArguments]):
    """Truncated Quantile Critics with a recurrent network that reads the episode, and learns from the critics.

    ``encoder_kwargs`` are those of ``RecurrentEncoder``. The env need not have tasks:
    ``TransitionObservation(MetaTask(env))`` serves for any partially observed env.

    Example:
        >>> model = RecurrentTQC("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """

    default_encoder: ClassVar[str | type[TaskEncoder]] = "recurrent"

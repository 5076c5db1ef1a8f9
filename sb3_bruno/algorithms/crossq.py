"""CrossQ with task inference: by BRUNO, by a recurrent network, or by any encoder."""

from __future__ import annotations

from typing import ClassVar, Generic, Unpack

from sb3_contrib import CrossQ
from sb3_contrib.crossq.policies import CrossQCritic, CrossQPolicy
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv

from sb3_bruno.algorithms.arguments import CrossQArguments, EncoderArguments, takes_arguments_of
from sb3_bruno.algorithms.lean_networks import LeanCritic
from sb3_bruno.algorithms.policies import POLICY_NAMES, TaskInferencePolicy
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders import TaskEncoder
from sb3_bruno.encoders.bruno_arguments import BrunoArguments
from sb3_bruno.encoders.recurrent import RecurrentArguments


class TaskCrossQCritic(LeanCritic, CrossQCritic):
    """CrossQ's critics."""


class TaskCrossQPolicy(TaskInferencePolicy, CrossQPolicy):
    """Acts as CrossQ's policy does, on observation and belief."""

    critic_class: ClassVar[type[LeanCritic] | None] = TaskCrossQCritic


class TaskCrossQ(TaskInference, CrossQ, Generic[EncoderArguments]):
    """CrossQ with the encoder that ``encoder_class`` names.

    Takes ``CrossQ``'s arguments by name, and those of ``TaskInference``; ``replay_buffer_kwargs`` are those of
    ``TaskReplayBuffer``.
    """

    policy: TaskCrossQPolicy
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = dict.fromkeys(POLICY_NAMES, TaskCrossQPolicy)

    @takes_arguments_of(CrossQ, TaskInference)
    def __init__(
        self,
        policy: str | type[TaskInferencePolicy],
        env: GymEnv | str,
        **kwargs: Unpack[CrossQArguments[EncoderArguments]],
    ) -> None:
        super().__init__(policy, env, **kwargs)


class BrunoCrossQ(TaskCrossQ[BrunoArguments]):
    """CrossQ with BRUNO task inference; ``encoder_kwargs`` are those of ``BrunoEncoder``.

    Reference: Korshunova et al., Exchangeable Models in Meta Reinforcement Learning (2020).

    Example:
        >>> model = BrunoCrossQ("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """


class RecurrentCrossQ(TaskCrossQ[RecurrentArguments]):
    """CrossQ with a recurrent network that reads the episode, and learns from the critics.

    ``encoder_kwargs`` are those of ``RecurrentEncoder``. The env need not have tasks:
    ``TransitionObservation(MetaTask(env))`` serves for any partially observed env.

    Example:
        >>> model = RecurrentCrossQ("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """

    default_encoder: ClassVar[str | type[TaskEncoder]] = "recurrent"

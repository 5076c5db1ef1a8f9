"""TD3 with task inference: by BRUNO, by a recurrent network, or by any encoder."""

from __future__ import annotations

from typing import ClassVar, Generic, Unpack

from stable_baselines3 import TD3
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.td3.policies import TD3Policy

from sb3_bruno.algorithms.arguments import EncoderArguments, TD3Arguments, takes_arguments_of
from sb3_bruno.algorithms.lean_networks import LeanContinuousCritic, LeanCritic
from sb3_bruno.algorithms.policies import POLICY_NAMES, TaskInferencePolicy
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders import TaskEncoder
from sb3_bruno.encoders.bruno_arguments import BrunoArguments
from sb3_bruno.encoders.recurrent import RecurrentArguments


class TaskTD3Policy(TaskInferencePolicy, TD3Policy):
    """Acts as TD3's policy does, on observation and belief."""

    critic_class: ClassVar[type[LeanCritic] | None] = LeanContinuousCritic


class TaskTD3(TaskInference, TD3, Generic[EncoderArguments]):
    """Twin Delayed DDPG with the encoder that ``encoder_class`` names.

    Takes ``TD3``'s arguments by name, and those of ``TaskInference``; ``replay_buffer_kwargs`` are those of
    ``TaskReplayBuffer``.
    """

    policy: TaskTD3Policy
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = dict.fromkeys(POLICY_NAMES, TaskTD3Policy)

    @takes_arguments_of(TD3, TaskInference)
    def __init__(
        self,
        policy: str | type[TaskInferencePolicy],
        env: GymEnv | str,
        **kwargs: Unpack[TD3Arguments[EncoderArguments]],
    ) -> None:
        super().__init__(policy, env, **kwargs)


class BrunoTD3(TaskTD3[BrunoArguments]):
    """Twin Delayed DDPG with BRUNO task inference; ``encoder_kwargs`` are those of ``BrunoEncoder``.

    Reference: Korshunova et al., Exchangeable Models in Meta Reinforcement Learning (2020).

    Example:
        >>> model = BrunoTD3("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """


class RecurrentTD3(TaskTD3[RecurrentArguments]):
    """Twin Delayed DDPG with a recurrent network that reads the episode, and learns from the critics.

    ``encoder_kwargs`` are those of ``RecurrentEncoder``. The env need not have tasks:
    ``TransitionObservation(MetaTask(env))`` serves for any partially observed env.

    Example:
        >>> model = RecurrentTD3("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """

    default_encoder: ClassVar[str | type[TaskEncoder]] = "recurrent"

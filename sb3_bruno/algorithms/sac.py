"""SAC with task inference: by BRUNO, as in PEARL, by a recurrent network, or by any encoder."""

from __future__ import annotations

from typing import ClassVar, Generic, Unpack

from stable_baselines3 import SAC
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.sac.policies import SACPolicy

from sb3_bruno.algorithms.arguments import EncoderArguments, SACArguments, takes_arguments_of
from sb3_bruno.algorithms.lean_networks import LeanContinuousCritic, LeanCritic
from sb3_bruno.algorithms.policies import POLICY_NAMES, TaskInferencePolicy
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders import TaskEncoder
from sb3_bruno.encoders.bruno_arguments import BrunoArguments
from sb3_bruno.encoders.product_arguments import ProductArguments
from sb3_bruno.encoders.recurrent import RecurrentArguments
from sb3_bruno.encoders.recurrent_vae import VaeArguments
from sb3_bruno.encoders.supervised_belief import SupervisedArguments


class TaskSACPolicy(TaskInferencePolicy, SACPolicy):
    """Acts as SAC's policy does, on observation and belief."""

    critic_class: ClassVar[type[LeanCritic] | None] = LeanContinuousCritic


class TaskSAC(TaskInference, SAC, Generic[EncoderArguments]):
    """Soft Actor-Critic with the encoder that ``encoder_class`` names.

    Takes ``SAC``'s arguments by name, and those of ``TaskInference``; ``replay_buffer_kwargs`` are those of
    ``TaskReplayBuffer``.
    """

    policy: TaskSACPolicy
    policy_aliases: ClassVar[dict[str, type[BasePolicy]]] = dict.fromkeys(POLICY_NAMES, TaskSACPolicy)

    @takes_arguments_of(SAC, TaskInference)
    def __init__(
        self,
        policy: str | type[TaskInferencePolicy],
        env: GymEnv | str,
        **kwargs: Unpack[SACArguments[EncoderArguments]],
    ) -> None:
        super().__init__(policy, env, **kwargs)


class BrunoSAC(TaskSAC[BrunoArguments]):
    """Soft Actor-Critic with BRUNO task inference; ``encoder_kwargs`` are those of ``BrunoEncoder``.

    Reference: Korshunova et al., Exchangeable Models in Meta Reinforcement Learning (2020).

    Example:
        >>> model = BrunoSAC("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """


class PearlSAC(TaskSAC[ProductArguments]):
    """PEARL: Soft Actor-Critic with a product of Gaussians as its belief, which learns from the critics.

    ``encoder_kwargs`` are those of ``ProductOfGaussians``. PEARL's own protocol, in trials of several episodes:
    ``encoder_kwargs={"belief": "sample", "exploration_episodes": 1}``.

    Reference: Rakelly et al., Efficient Off-Policy Meta-Reinforcement Learning via Probabilistic Context Variables
    (2019).

    Example:
        >>> model = PearlSAC("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """

    default_encoder: ClassVar[str | type[TaskEncoder]] = "product_of_gaussians"


class RecurrentSAC(TaskSAC[RecurrentArguments]):
    """Soft Actor-Critic with a recurrent network that reads the episode, and learns from the critics.

    ``encoder_kwargs`` are those of ``RecurrentEncoder``. The env need not have tasks:
    ``TransitionObservation(MetaTask(env))`` serves for any partially observed env.

    Example:
        >>> model = RecurrentSAC("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """

    default_encoder: ClassVar[str | type[TaskEncoder]] = "recurrent"


class VaribadSAC(TaskSAC[VaeArguments]):
    """Soft Actor-Critic with VariBAD's encoder; ``encoder_kwargs`` are those of ``RecurrentVae``.

    Reference: Zintgraf et al., VariBAD: A Very Good Method for Bayes-Adaptive Deep RL via Meta-Learning (2020).

    Example:
        >>> model = VaribadSAC("MlpPolicy", "sb3_bruno_envs:PointDir-v0", critic_input="belief", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """

    default_encoder: ClassVar[str | type[TaskEncoder]] = "recurrent_vae"


class BeliefSAC(TaskSAC[SupervisedArguments]):
    """Soft Actor-Critic with an encoder that is taught the true tasks, those of training.

    ``encoder_kwargs`` are those of ``SupervisedBelief``.

    Reference: Humplik et al., Meta reinforcement learning as task inference (2019).

    Example:
        >>> model = BeliefSAC("MlpPolicy", "sb3_bruno_envs:PointDir-v0", critic_input="belief", seed=0)
        >>> model.learn(total_timesteps=2_000)
    """

    default_encoder: ClassVar[str | type[TaskEncoder]] = "supervised_belief"

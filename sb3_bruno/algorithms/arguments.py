"""The arguments of the algorithms: their names and types for editors, and how they are joined and resolved.

Each TypedDict holds the keyword arguments of an algorithm of SB3 or sb3-contrib and those of ``TaskInference``, whose
docstrings explain them. ``EncoderArguments`` stands for the keyword arguments of an encoder.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, Generic, TypedDict

import torch as th
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.noise import ActionNoise
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.type_aliases import Schedule
from typing_extensions import TypeVar

from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.buffers.extended_obs import CriticInput
from sb3_bruno.buffers.task_buffer import BufferArguments
from sb3_bruno.encoders import TaskEncoder

EncoderArguments = TypeVar("EncoderArguments", bound=Mapping[str, object], default=Mapping[str, object])
Init = TypeVar("Init", bound=Callable[..., None])


class OffPolicyArguments(TypedDict, Generic[EncoderArguments], total=False):
    """What every off-policy algorithm with task inference takes."""

    learning_rate: float | Schedule
    buffer_size: int
    learning_starts: int
    batch_size: int
    gamma: float
    train_freq: int | tuple[int, str]
    gradient_steps: int
    action_noise: ActionNoise | None
    replay_buffer_class: type[ReplayBuffer] | None
    replay_buffer_kwargs: BufferArguments | None
    optimize_memory_usage: bool
    n_steps: int
    stats_window_size: int
    tensorboard_log: str | None
    policy_kwargs: dict[str, Any] | None
    verbose: int
    seed: int | None
    device: th.device | str
    _init_setup_model: bool
    encoder_class: str | type[TaskEncoder] | None
    encoder_kwargs: EncoderArguments | None
    encoder_learning_rate: float | Schedule | None
    encoder_batch_size: int | None
    encoder_update_ratio: float | None
    encoder_learning_starts: int | None
    encoder_tau: float | None
    critic_input: CriticInput | None
    task_readout: bool


class EntropyArguments(OffPolicyArguments[EncoderArguments], Generic[EncoderArguments], total=False):
    """Those of algorithms that maximise an entropy too."""

    ent_coef: str | float
    target_entropy: str | float
    use_sde: bool
    sde_sample_freq: int
    use_sde_at_warmup: bool


class SACArguments(EntropyArguments[EncoderArguments], Generic[EncoderArguments], total=False):
    """Those of SAC."""

    tau: float
    target_update_interval: int


class TQCArguments(SACArguments[EncoderArguments], Generic[EncoderArguments], total=False):
    """Those of TQC."""

    top_quantiles_to_drop_per_net: int


class CrossQArguments(EntropyArguments[EncoderArguments], Generic[EncoderArguments], total=False):
    """Those of CrossQ, which has no target networks."""

    policy_delay: int


class TD3Arguments(OffPolicyArguments[EncoderArguments], Generic[EncoderArguments], total=False):
    """Those of TD3."""

    tau: float
    policy_delay: int
    target_policy_noise: float
    target_noise_clip: float


def takes_arguments_of(*classes: type) -> Callable[[Init], Init]:
    """Give a constructor of ``(self, policy, env, **kwargs)`` the keyword arguments of classes, as ``help`` shows them.

    Editors read the TypedDicts above. Notebooks, ``help`` and ``inspect`` read this.
    """

    def decorate(init: Init) -> Init:
        signature = inspect.signature(init)
        parameters = {
            parameter.name: parameter
            for parameter in signature.parameters.values()
            if parameter.kind is not parameter.VAR_KEYWORD
        }
        for cls in classes:
            for name, parameter in inspect.signature(cls).parameters.items():
                if parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
                    parameters.setdefault(name, parameter.replace(kind=parameter.KEYWORD_ONLY))
        vars(init)["__signature__"] = signature.replace(parameters=list(parameters.values()))
        return init

    return decorate


def resolve_policy(
    policy: str | type[BasePolicy], aliases: Mapping[str, type[BasePolicy]]
) -> type[TaskInferencePolicy]:
    """Find the policy class that a name stands for.

    Raises:
        ValueError: if the name is unknown, or the class is none that the algorithm can train.
    """
    resolved = aliases.get(policy) if isinstance(policy, str) else policy
    if resolved is None:
        raise ValueError(
            f"`policy={policy!r}` is unknown: use one of {list(aliases)}. Images are not supported: extract features "
            "in an observation wrapper."
        )
    usual = next(iter(aliases.values()))
    needed = usual.__bases__[-1]  # of class TaskSACPolicy(TaskInferencePolicy, SACPolicy), the latter
    if not (isinstance(resolved, type) and issubclass(resolved, TaskInferencePolicy) and issubclass(resolved, needed)):
        raise ValueError(
            f"`policy={resolved}` is none that this algorithm can train: subclass `{usual.__name__}`, or load a saved "
            "agent with the class that saved it."
        )
    return resolved


def join_policy_kwargs(given: Mapping[str, Any] | None, inference: Mapping[str, Any]) -> dict[str, Any]:
    """Join the user's ``policy_kwargs`` with those of task inference.

    Raises:
        ValueError: if a key is in both.
    """
    twice = sorted(set(given or {}) & set(inference))
    if twice:
        raise ValueError(f"`policy_kwargs` has {twice}: pass `{twice[0]}=...` to the algorithm itself.")
    return {**(given or {}), **inference}


def check_names(
    argument: str,
    given: Mapping[str, Any] | None,
    takes: Callable[..., Any],
    filled: set[str],
    error: type[Exception] = ValueError,
) -> None:
    """Refuse names that a constructor does not take.

    Args:
        argument: what the names were given as, for the error.
        given: keyword arguments by name.
        takes: the constructor.
        filled: arguments of it that the user does not give by name.
        error: what to raise. Python raises a TypeError where a call has a wrong name.

    Raises:
        ValueError: or ``error``, naming the nearest right name.
    """
    parameters = inspect.signature(takes).parameters.values()
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return  # it passes them on
    check_known(argument, given, [parameter.name for parameter in parameters if parameter.name not in filled], error)


def check_known(
    argument: str, given: Mapping[str, Any] | None, known: Sequence[str], error: type[Exception] = ValueError
) -> None:
    """Refuse names that are not known.

    Args:
        argument: what the names were given as, for the error.
        given: keyword arguments by name.
        known: the names that there are.
        error: what to raise.

    Raises:
        ValueError: or ``error``, naming the nearest right name.
    """
    for name in (name for name in given or {} if name not in known):
        nearest = get_close_matches(str(name), known, n=1, cutoff=0.6)
        remedy = f"did you mean `{nearest[0]}`?" if nearest else f"it takes {', '.join(known) or 'nothing'}."
        raise error(f"`{argument}` has no `{name}`: {remedy}")

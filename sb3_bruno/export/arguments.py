"""Collects the arguments that an agent was made with, which its algorithm's constructor takes again."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

from stable_baselines3.common.noise import VectorizedActionNoise
from stable_baselines3.common.type_aliases import TrainFreq

from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.export.limits import LARGEST_COUNT, LARGEST_LIST, LARGEST_OF_FLOW
from sb3_bruno.files.shown import shown

_NOT_KEPT = {
    *("self", "policy", "env", "device", "verbose", "tensorboard_log", "seed", "task_readout", "_init_setup_model")
}
"""What a file names apart, or what belongs to the machine and the run rather than to the agent."""
_OF_POLICY = {"policy_kwargs", "encoder_class", "encoder_kwargs", "critic_input"}
_GIVEN_BY_ALGORITHM = {
    *("encoder_class", "encoder_kwargs", "target_encoder", "critic_input", "readout", "task_space", "use_sde")
}
"""Arguments of the policy that the algorithm gives it."""


def arguments_of(model: TaskInference) -> dict[str, Any]:
    """Return the keyword arguments of an agent's constructor by name.

    Raises:
        ValueError: if a class of the user's takes an argument that it does not keep, or none of those that are needed
            to build it again.
    """
    names = _names(type(model))
    for name in sorted({*_OF_POLICY, "task_readout", "buffer_size"} - names):
        raise ValueError(f"{type(model).__name__} takes no `{name}`: let it pass further keyword arguments on")
    arguments = {name: _kept(model, name) for name in names - _NOT_KEPT - _OF_POLICY}
    own = {name: value for name, value in model.policy_kwargs.items() if name not in _GIVEN_BY_ALGORITHM}
    own["forget_threshold"] = model.policy.forget_threshold  # which may have been set since
    return {
        **dict(sorted(arguments.items())),
        "encoder_class": model.policy.encoder_class,
        "encoder_kwargs": model.policy.encoder_kwargs,
        "critic_input": model.policy.critic_input,
        "policy_kwargs": own,
    }


def check_arguments(cls: type, arguments: Mapping[str, Any]) -> None:
    """Refuse arguments that ``arguments_of`` does not write, such as a folder to log in, and sizes of no network.

    Args:
        cls: the algorithm.
        arguments: what a file gives it.

    Raises:
        ValueError: naming the argument.
    """
    for name in sorted(arguments.keys() - (_names(cls) - _NOT_KEPT)):
        raise ValueError(f"its argument {shown(name)} is none that agent files give")
    for name in ("policy_kwargs", "encoder_kwargs"):
        if not isinstance(arguments.get(name), dict):
            raise ValueError(f"its `{name}` are not there")
        _check_counts(arguments[name], name)
    buffer_size = arguments.get("buffer_size")
    if type(buffer_size) is not int or buffer_size < 1:
        raise ValueError(f"its `buffer_size` is {shown(buffer_size)}, and no whole number of 1 or more")


def _check_counts(nested: Any, place: str, *, in_flow: bool = False) -> None:
    """Refuse whole numbers that no network is made with, before anything counts to them."""
    if isinstance(nested, dict):
        for name, value in nested.items():
            if name != "forget_threshold":  # nats, which nothing counts to
                _check_counts(value, f"{place}.{name}", in_flow=in_flow or name == "flow_kwargs")
    elif isinstance(nested, list | tuple):
        if len(nested) > LARGEST_LIST:
            raise ValueError(f"its {shown(place)} has {len(nested):,} entries, and {LARGEST_LIST:,} are allowed")
        for value in nested:
            _check_counts(value, place, in_flow=in_flow)
    elif isinstance(nested, int) and abs(nested) > (largest := LARGEST_OF_FLOW if in_flow else LARGEST_COUNT):
        raise ValueError(f"its {shown(place)} has {nested}, and whole numbers up to {largest:,} are allowed there")


def _names(cls: type) -> set[str]:
    """Name the arguments of a class, and those of the classes that it passes them on to."""
    names: set[str] = set()
    for base in cls.__mro__:
        if "__init__" in vars(base):
            parameters = inspect.signature(vars(base)["__init__"]).parameters.values()
            kinds = {parameter.kind for parameter in parameters}
            open_ended = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
            names |= {parameter.name for parameter in parameters if parameter.kind not in open_ended}
            if inspect.Parameter.VAR_KEYWORD not in kinds:
                break
    return names


def _kept(model: TaskInference, name: str) -> Any:
    """Return an argument as the agent keeps it."""
    kept = vars(model)
    if name not in kept and f"_{name}" not in kept:
        raise ValueError(f"{type(model).__name__} takes `{name}` and keeps it nowhere: set `self.{name}` there")
    value = kept[name] if name in kept else kept[f"_{name}"]
    if isinstance(value, TrainFreq):
        return value.frequency, value.unit.value
    if isinstance(value, VectorizedActionNoise):  # which ``learn`` made of what it was given
        return value.base_noise
    return value

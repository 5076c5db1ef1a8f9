"""The classes that an agent file may name, each by a key. A file names no module, and nothing is imported for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import torch as th
import zuko.flows
from stable_baselines3.common.sb2_compat.rmsprop_tf_like import RMSpropTFLike
from torch import nn
from zuko.lazy import Flow

import sb3_bruno
from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.buffers import TaskReplayBuffer
from sb3_bruno.encoders import ENCODERS, TaskEncoder
from sb3_bruno.files.shown import shown
from sb3_bruno.maths.flow import FLOWS


class Unknown(ValueError):
    """What a file asks for, and this installation lacks, with what to do about it."""


Named = TypeVar("Named", bound=Callable[..., Any])

KINDS: dict[str, type] = {
    "algorithm": TaskInference,
    "policy": TaskInferencePolicy,
    "encoder": TaskEncoder,
    "buffer": TaskReplayBuffer,
    "optimizer": th.optim.Optimizer,
    "flow": Flow,
    "module": nn.Module,
}
"""What each kind of class inherits from; the first that fits counts. Whatever else is called is a "function"."""
_OF_SB3_BRUNO = [getattr(sb3_bruno, name) for name in sb3_bruno.__all__]
_ALGORITHMS = {cls.__name__: cls for cls in _OF_SB3_BRUNO if issubclass(cls, TaskInference)}
_POLICIES = [policy for algorithm in _ALGORITHMS.values() for policy in algorithm.policy_aliases.values()]
_MODULES = (
    "CELU ELU GELU Hardsigmoid Hardswish Hardtanh Identity LeakyReLU LogSigmoid Mish PReLU ReLU ReLU6 SELU SiLU "
    "Sigmoid Softplus Softsign Tanh Tanhshrink"
)
_OPTIMIZERS = "ASGD Adadelta Adagrad Adam AdamW Adamax NAdam RAdam RMSprop SGD"
_BUILT_IN: dict[str, Mapping[str, Callable[..., Any]]] = {
    "algorithm": _ALGORITHMS,
    "policy": {policy.__name__: policy for policy in _POLICIES},
    "encoder": ENCODERS,
    "buffer": {"TaskReplayBuffer": TaskReplayBuffer},
    "optimizer": {"RMSpropTFLike": RMSpropTFLike, **{name: getattr(th.optim, name) for name in _OPTIMIZERS.split()}},
    "flow": {
        name: flow for name, flow in vars(zuko.flows).items() if isinstance(flow, type) and issubclass(flow, Flow)
    },
    "module": {name: getattr(nn, name) for name in _MODULES.split()},
    "function": FLOWS,
}
_REGISTERED: dict[str, dict[str, Callable[..., Any]]] = {kind: {} for kind in _BUILT_IN}


def register_agent_class(named: Named, key: str | None = None) -> Named:
    """Let agent files name a class of yours: an algorithm, a policy, an encoder, an activation, an optimiser, a flow.

    Whoever loads such a file has to register the class before. It serves as a decorator.

    Args:
        named: the class, or a function that builds a flow.
        key: what files call it; None: its own name.

    Raises:
        TypeError: if it cannot be called.
        ValueError: if the key is no name, or stands for another class already.

    Example:
        >>> @register_agent_class
        ... class MyEncoder(RecurrentEncoder): ...
    """
    if not callable(named):
        raise TypeError(f"`named={named!r}` is neither a class nor a function: give one.")
    key = getattr(named, "__name__", "") if key is None else key
    if not (isinstance(key, str) and key.isidentifier()):
        raise ValueError(f"`key={key!r}` is no name: give one of letters, digits and underscores.")
    kind = kind_of(named)
    known = _known(kind).get(key, named)
    if known is not named:
        raise ValueError(f"`key={key!r}` stands for {known!r} already: give {named!r} another one.")
    _REGISTERED[kind][key] = named
    return named


def kind_of(named: Callable[..., Any]) -> str:
    """Return which of ``KINDS`` a class is."""
    found = (kind for kind, base in KINDS.items() if isinstance(named, type) and issubclass(named, base))
    return next(found, "function")


def key_of(named: Callable[..., Any], place: str) -> str:
    """Find the key of a class.

    Args:
        named: the class.
        place: where it was found, for the error.

    Raises:
        ValueError: if it has none.
    """
    for key, known in _known(kind_of(named)).items():
        if known is named:
            return key
    name = getattr(named, "__name__", type(named).__name__)
    remedy = "register it by `sb3_bruno.export.register_agent_class`, or use another"
    if kind_of(named) == "function":
        remedy = "a function is not data, so give a number, or a class of Stable-Baselines3 or torch that does the same"
    raise ValueError(f"`{place}` is {name}, which an agent file cannot name: {remedy}")


def find(kind: str, key: object) -> Any:
    """Find the class that a file names.

    Raises:
        Unknown: if there is none of this kind.
    """
    known = _known(kind)
    if not isinstance(key, str) or key not in known:
        raise Unknown(
            f"it names {shown(key)}, which is no {kind} that agent files know: if it is one of somebody's own, "
            "register it by `sb3_bruno.export.register_agent_class` before"
        )
    return known[key]


def _known(kind: str) -> dict[str, Callable[..., Any]]:
    return {**_BUILT_IN[kind], **_REGISTERED[kind]}

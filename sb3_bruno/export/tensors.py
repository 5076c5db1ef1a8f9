"""Takes the tensors out of an agent by name, and puts them into one that was built anew."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import safetensors.torch
import torch as th
from stable_baselines3.common.save_util import recursive_getattr
from torch import Tensor

from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.export.limits import LARGEST_TENSOR, LARGEST_TEXT
from sb3_bruno.files.shown import shown

_POLICY, _VARIABLE = "policy.", "variable."


def tensors_of(model: TaskInference) -> dict[str, Tensor]:
    """Return the tensors of an agent's policy, and what else its algorithm has learned, by name, on the CPU.

    Raises:
        ValueError: if one holds a number that is not finite, or is none.
    """
    tensors = {name: tensor.detach().cpu().contiguous().clone() for name, tensor in _named(model).items()}
    _check(tensors)
    return tensors


def read_tensors(data: bytes) -> dict[str, Tensor]:
    """Read tensors from safetensors' format, which holds nothing else.

    Raises:
        Exception: of any kind, if the data is not of that format; ValueError if a number is not finite.
    """
    if int.from_bytes(data[:8], "little") > LARGEST_TEXT:  # the length of what describes them
        raise ValueError(f"its tensors are described in more than {LARGEST_TEXT:,} bytes")
    tensors = safetensors.torch.load(data)
    _check(tensors)
    return tensors


def put_tensors(model: TaskInference, tensors: Mapping[str, Tensor]) -> None:
    """Put tensors into an agent of the same form, in the place of its own.

    Raises:
        ValueError: if a name, a shape or a type differs.
    """
    own = _named(model)
    differing = sorted(set(own) ^ set(tensors))
    if differing:
        raise ValueError(f"its tensors are not those of the agent, such as {shown(differing[0])}")
    for name, tensor in tensors.items():
        if (tensor.shape, tensor.dtype) != (own[name].shape, own[name].dtype):
            raise ValueError(
                f"its tensor {name} is {tensor.dtype} of shape {tuple(tensor.shape)}, and the agent's is "
                f"{own[name].dtype} of shape {tuple(own[name].shape)}"
            )
    with th.no_grad():
        for name, tensor in tensors.items():
            own[name].copy_(tensor)


def _named(model: TaskInference) -> dict[str, Tensor]:
    """Return the tensors of an agent by name, sharing their memory."""
    state: dict[str, Any] = model.policy.state_dict()
    no_tensors = [name for name, value in state.items() if not isinstance(value, Tensor)]
    if no_tensors:
        raise ValueError(f"the policy's state holds {no_tensors[0]}, which is no tensor: keep it as a buffer")
    _, variables = model._get_torch_save_params()
    learned = {f"{_VARIABLE}{name}": recursive_getattr(model, name) for name in variables}
    return {
        **{f"{_POLICY}{name}": value for name, value in state.items()},
        **{name: value.data for name, value in learned.items() if value is not None},
    }


def _check(tensors: Mapping[str, Tensor]) -> None:
    for name, tensor in tensors.items():
        if tensor.nbytes > LARGEST_TENSOR:
            raise ValueError(
                f"the tensor {shown(name)} has {tensor.nbytes:,} bytes, and {LARGEST_TENSOR:,} are allowed"
            )
        if tensor.is_floating_point() and not th.isfinite(tensor).all():
            raise ValueError(f"the tensor {shown(name)} holds a number that is not finite")

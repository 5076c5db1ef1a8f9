"""What an agent carries from step to step, and the arrays that ``predict`` makes of it."""

from __future__ import annotations

from typing import Any, NamedTuple, Self

import numpy as np
import torch as th
from numpy.typing import NDArray
from torch import Tensor

from sb3_bruno.algorithms.forgetting import Suspicion, choose_suspicion, no_suspicion
from sb3_bruno.buffers.numbers import NUMBER_KINDS
from sb3_bruno.buffers.transfer import to_device, to_host
from sb3_bruno.encoders import TaskEncoder
from sb3_bruno.encoders.base import AnyMemory, choose_memory, map_memory

State = tuple[NDArray[Any], ...]
"""What ``predict`` returns and takes back: the encoder's memory, the observation, and of an agent that may forget the
memory since a suspicion began and its evidence. Every array has shape (n_envs, ...)."""


class Carried(NamedTuple):
    """What an agent carries, on its device.

    Attributes:
        memory: what the encoder keeps of the transitions absorbed, shapes (n_envs, ...).
        observation: where the next transition begins, shape (n_envs, observation_dim).
        suspicion: of a switch of the task; None where the agent never forgets.
    """

    memory: AnyMemory
    observation: Tensor
    suspicion: Suspicion | None

    @classmethod
    def start(cls, encoder: TaskEncoder, observation: Tensor, *, may_forget: bool) -> Self:
        """Make what is carried into a task's first episode. observation: (n_envs, observation_dim)"""
        n_envs = len(observation)
        suspicion = no_suspicion(encoder, (n_envs,)) if may_forget else None
        return cls(encoder.empty((n_envs,)), observation, suspicion)

    @classmethod
    def unpack(cls, state: State, encoder: TaskEncoder, device: th.device) -> Self:
        """Send a state to the device, in one transfer.

        Raises:
            ValueError: if it is none that ``pack`` can have made with this encoder.
        """
        if not isinstance(state, (tuple, list)) or not state or not all(map(_is_array, state)):
            raise ValueError(f"`state` is {state!r}: pass back the state that `predict` returned.")
        n_envs = len(state[0])
        empty = encoder.empty((n_envs,))
        if len(state) not in (len(empty) + 1, 2 * len(empty) + 2):
            raise ValueError(
                f"`state` has {len(state)} arrays, those of {type(encoder).__name__} have {len(empty) + 1}, or "
                f"{2 * len(empty) + 2} where the agent may forget: pass back the state that `predict` returned."
            )
        given, wanted = [np.shape(array) for array in state[: len(empty)]], [tuple(tensor.shape) for tensor in empty]
        if given != wanted:
            raise ValueError(
                f"`state` begins with arrays of shapes {given}, those of {type(encoder).__name__} with {wanted}: pass "
                "back the state that `predict` returned."
            )
        may_forget = len(state) > len(empty) + 1
        given = [np.shape(array) for array in state[len(empty) + 1 :]]
        wanted = [*wanted, (n_envs, 1)] if may_forget else []
        if np.ndim(state[len(empty)]) != 2 or [shape[1:] for shape in given] != [shape[1:] for shape in wanted]:
            given = [np.shape(array) for array in state[len(empty) :]]
            raise ValueError(
                f"`state` ends with arrays of shapes {given}, those of {type(encoder).__name__} with an observation "
                f"(n_envs, dim) and {wanted}: pass back the state that `predict` returned."
            )
        if any(len(array) != n_envs for array in state):
            raise ValueError(
                f"`state` holds arrays of {[len(array) for array in state]} envs: pass back the state that `predict` "
                "returned, whole."
            )
        if not all(np.isfinite(array).all() for array in state):
            raise ValueError("`state` holds a number that is not finite: pass back the state that `predict` returned.")
        count = encoder.count(map_memory(lambda like, array: th.as_tensor(array), empty, state[: len(empty)]))
        if count is not None and (count < 0).any():
            raise ValueError(f"`state` counts {count.min():.0f} values: pass back the state that `predict` returned.")
        tensors = iter(to_device([np.reshape(array, (n_envs, -1)) for array in state], device))
        memory = map_memory(lambda like: next(tensors).reshape(like.shape), empty)
        observation = next(tensors)
        if not may_forget:
            return cls(memory, observation, None)
        recent = map_memory(lambda like: next(tensors).reshape(like.shape), empty)
        return cls(memory, observation, Suspicion(next(tensors), recent))

    def pack(self) -> State:
        """Bring it to the host, in one transfer."""
        tensors = [*self.memory, self.observation]
        if self.suspicion is not None:
            tensors += [*self.suspicion.recent, self.suspicion.evidence]
        arrays = to_host([tensor.flatten(1) for tensor in tensors])
        return tuple(array.reshape(tensor.shape) for array, tensor in zip(arrays, tensors, strict=True))

    def where(self, mask: Tensor, other: Carried) -> Carried:
        """Take this memory and suspicion where the mask, shape (n_envs, 1), is True, and the other's elsewhere."""
        suspicion = self.suspicion
        if suspicion is not None and other.suspicion is not None:
            suspicion = choose_suspicion(mask, suspicion, other.suspicion)
        return self._replace(memory=choose_memory(mask, self.memory, other.memory), suspicion=suspicion)


def _is_array(given: Any) -> bool:
    """Return whether this is an array of numbers, or can be made one, that has a first dimension."""
    try:
        array = np.asarray(given)
    except ValueError:  # rows of different lengths
        return False
    return array.ndim > 0 and array.dtype.kind in NUMBER_KINDS

"""Many arrays between host and device in one transfer: each by itself would make host and GPU wait for each other.

The file knows arrays and tensors, not what they hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch as th
from numpy.typing import NDArray
from torch import Tensor


def to_device(arrays: Sequence[NDArray[Any]], device: th.device | str) -> tuple[Tensor, ...]:
    """Send arrays of shape (..., dim), each with a dim of its own, as tensors of float32."""
    packed = th.as_tensor(np.concatenate(arrays, axis=-1, dtype=np.float32), device=device)
    return th.split(packed, [array.shape[-1] for array in arrays], dim=-1)


def to_host(tensors: Sequence[Tensor]) -> tuple[NDArray[Any], ...]:
    """Bring back tensors of one type, of shape (..., dim), as arrays."""
    ends = np.cumsum([tensor.shape[-1] for tensor in tensors])
    return tuple(np.split(th.cat(tuple(tensors), dim=-1).cpu().numpy(), ends[:-1], axis=-1))

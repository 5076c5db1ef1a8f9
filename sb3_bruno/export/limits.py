"""How large an agent file may be, and what loading one may make: what asks for more is refused before it costs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch as th
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map

LARGEST_TEXT = 2**20  # bytes of a member that is text
LARGEST_TENSORS = 2**28  # bytes of all tensors
LARGEST_TENSOR = 2**27  # bytes
LARGEST_SPACE = 100_000  # numbers in a space
LARGEST_DICT = 100  # spaces in a space
LARGEST_BUFFER = 10_000_000  # transitions
LARGEST_STEP = 2**27  # bytes that a step may take: an encoder may keep many transitions
LARGEST_WHOLE = 2**63  # any whole number
LARGEST_COUNT = 4_096  # one that shapes a network: some cost its cube
LARGEST_LIST = 1_024  # entries of an argument of a network
LARGEST_OF_FLOW = 1_024  # one of a flow, such as the degree of its polynomials


class Budget(TorchDispatchMode):
    """Refuses to compute more or larger tensors than agents of a file's size need, before they take any memory.

    Around the making of an agent, and anew around its first step.

    Every operation is run on torch's device "meta" first, which computes shapes alone. Our agents need 5 operations
    for each tensor that is kept, and 4 bytes for each byte, of which most are free again at once.

    Args:
        kept: the tensors of the file by name.
        spare: bytes that are allowed whatever the file's size.
    """

    def __init__(self, kept: Mapping[str, Tensor], spare: int = 2**24) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._operations = 2_000 + 30 * min(len(kept), 1_000)
        self._bytes = spare + 8 * sum(tensor.nbytes for tensor in kept.values())

    def __torch_dispatch__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        self._operations -= 1
        self._bytes -= _bytes_of_result(func, args, kwargs or {})
        if self._operations < 0 or self._bytes < 0:
            raise ValueError("its settings ask for more memory or work than an agent of its weights needs")
        return func(*args, **(kwargs or {}))


def _bytes_of_result(func: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> int:
    """Return how many bytes the tensors take that an operation makes."""
    args, kwargs = tree_map(lambda value: value.to("meta") if isinstance(value, Tensor) else value, (args, kwargs))
    if "device" in kwargs:
        kwargs["device"] = th.device("meta")
    try:
        made = func(*args, **kwargs)
    except Exception:  # it needs the numbers, as th.unique does: then its result is no larger than what it is given
        made = args
    return sum(value.nbytes for value in tree_leaves(made) if isinstance(value, Tensor))

"""How large an agent file may be, and what loading one may make: what asks for more is refused before it costs."""

from __future__ import annotations

import weakref
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
LARGEST_MAKING = 2**26  # bytes that the making of an agent may take besides its weights, such as for its prior
LARGEST_STEP = 2**27  # bytes that a step may take: an encoder may keep many transitions
LARGEST_WHOLE = 2**63  # any whole number
LARGEST_COUNT = 4_096  # one that shapes a network: some cost its cube
LARGEST_LIST = 1_024  # entries of an argument of a network
LARGEST_OF_FLOW = 1_024  # one of a flow, such as the degree of its polynomials


class Budget(TorchDispatchMode):
    """Refuses to hold more or larger tensors than agents of a file's size need, before they take any memory.

    Around the making of an agent, and anew around its first step.

    Every operation is run on torch's device "meta" first, which computes shapes alone. Memory counts as long as it is
    held: a view takes none, and what is free again may be taken again. Our agents need 5 operations for each tensor
    that is kept, and in all they take 5 times what they hold at once.

    Args:
        kept: the tensors of the file by name.
        spare: bytes that are allowed whatever the file's size.
    """

    def __init__(self, kept: Mapping[str, Tensor], spare: int = LARGEST_MAKING) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._operations = 2_000 + 30 * min(len(kept), 1_000)
        self._free = spare + 8 * sum(tensor.nbytes for tensor in kept.values())
        self._work = 16 * self._free  # bytes, counted again each time that they are taken

    def __torch_dispatch__(
        self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        taken = _bytes_of_result(func, args, kwargs or {})
        self._operations -= 1
        self._work -= taken
        if self._operations < 0 or self._work < 0 or self._free < taken:
            raise ValueError("its settings ask for more memory or work than an agent of its weights needs")
        made = func(*args, **(kwargs or {}))
        for storage in _new_storages(made, (args, kwargs)):
            self._free -= storage.nbytes()
            weakref.finalize(storage, self._give_back, storage.nbytes()).atexit = False
        return made

    def _give_back(self, freed: int) -> None:
        self._free += freed


def _bytes_of_result(func: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> int:
    """Return how many bytes an operation takes for the tensors that it makes."""
    args, kwargs = tree_map(lambda value: value.to("meta") if isinstance(value, Tensor) else value, (args, kwargs))
    if "device" in kwargs:
        kwargs["device"] = th.device("meta")
    try:
        made = func(*args, **kwargs)
    except Exception:  # it needs the numbers, as th.unique does: then its result is no larger than what it is given
        return sum(value.nbytes for value in tree_leaves(args) if isinstance(value, Tensor))
    return sum(storage.nbytes() for storage in _new_storages(made, (args, kwargs)))


def _new_storages(made: Any, given: Any) -> list[th.UntypedStorage]:
    """Return the memory of tensors that were made, each once, without what lies in that of tensors that were given."""
    held, new = ({id(storage): storage for storage in _storages(nested)} for nested in (given, made))
    return [storage for key, storage in new.items() if key not in held]


def _storages(nested: Any) -> list[th.UntypedStorage]:
    return [value.untyped_storage() for value in tree_leaves(nested) if isinstance(value, Tensor)]

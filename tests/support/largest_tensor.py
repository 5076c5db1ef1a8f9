"""Notes how large the largest tensor is that torch makes: what a computation takes, on any machine."""

import torch as th
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves


class LargestTensor(TorchDispatchMode):
    """Notes the bytes of the largest tensor made within its context. A view is as large as what it looks at."""

    n_bytes = 0

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        made = function(*args, **(kwargs or {}))
        sizes = [leaf.untyped_storage().nbytes() for leaf in tree_leaves(made) if isinstance(leaf, th.Tensor)]
        self.n_bytes = max([self.n_bytes, *sizes])
        return made

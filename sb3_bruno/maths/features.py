"""A network that makes the features of a process with a kernel from what is given, x."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor, nn
from torch.nn import functional as F
from zuko.nn import MLP

from sb3_bruno.maths.kernel_statistics import Features

LEAST_NOISE_VAR = 1e-4
"""The least variance of the noise, of values that are standardised to variance 1."""


class FeatureNetwork(nn.Module):
    r"""Creates a network from x to the features :math:`b, \Phi, S` of m values.

    Its activations are smooth. With SiLU, held-out transitions of a point with a hidden goal scored more than with
    ReLU, and the goal was known after fewer of them (docs/results.md).

    Args:
        context: dimension of x.
        n_values: m, the number of values.
        n_weights: K, the number of weights that describe the task.
        net_arch: widths of the hidden layers.

    Example:
        >>> FeatureNetwork(7, n_values=4, n_weights=8)(th.randn(100, 7)).weights.shape
        torch.Size([100, 4, 8])
    """

    def __init__(self, context: int, n_values: int, n_weights: int, net_arch: Sequence[int] = (128, 128)) -> None:
        super().__init__()
        self.shape = (n_values, n_weights + 2)
        self.network = MLP(context, n_values * (n_weights + 2), net_arch, activation=nn.SiLU)

    def forward(self, x: Tensor) -> Features:
        """Map x, ``(..., context)``, to the features of z, ``(..., m)``."""
        columns = self.network(x).unflatten(-1, self.shape)
        return Features(columns[..., 0], columns[..., 2:], LEAST_NOISE_VAR + F.softplus(columns[..., 1]))

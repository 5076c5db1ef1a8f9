"""A reflection whose mirror depends on x, so that a reward may speak for a task at one x and against it at another.

    z = y - 2 u(x) u(x)^T y,  |u(x)| = 1

For each x, an autoregressive flow is monotone in the reward. That is not enough where the reward is d v, a direction d
times a velocity v: a high reward speaks for d = 1 if v > 0 and against it if v < 0. No monotone map gives a latent that
means d for both signs of v. The reflection does: it keeps the reward's sign where the mirror u(x) is orthogonal to the
reward's axis, and turns the sign where u(x) lies along that axis. Between the two, at v = 0, the reward says nothing
about d, and the latent is that of a noise dimension. So there must be a noise dimension (``extra_dims``).
"""

from __future__ import annotations

import torch as th
from torch import Tensor
from torch.distributions import Transform, constraints
from torch.nn.functional import normalize
from zuko.lazy import LazyTransform
from zuko.nn import MLP


class Reflection(Transform):
    """Creates the Householder reflection y -> y - 2 u u^T y, which is its own inverse and has |det| = 1.

    Args:
        mirror: u, ``(..., features)``, of any length except 0: it is normalised here.
    """

    domain = constraints.real_vector
    codomain = constraints.real_vector
    bijective = True

    def __init__(self, mirror: Tensor) -> None:
        super().__init__()
        self.mirror = normalize(mirror, dim=-1)

    def _call(self, x: Tensor) -> Tensor:
        return x - 2 * self.mirror * (self.mirror * x).sum(dim=-1, keepdim=True)

    def _inverse(self, y: Tensor) -> Tensor:
        return self._call(y)

    def log_abs_det_jacobian(self, x: Tensor, y: Tensor) -> Tensor:
        return th.zeros_like(x[..., 0])


class ConditionalReflection(LazyTransform):  # type: ignore[misc]  # zuko is untyped
    """Creates a reflection whose mirror u(x) a network computes from the context x.

    Args:
        features: dimension of y and z.
        context: dimension of x.
        hidden_features: hidden units of the network, layer by layer.
    """

    def __init__(self, features: int, context: int, hidden_features: tuple[int, ...] = (128,)) -> None:
        super().__init__()
        self.mirror = MLP(context, features, hidden_features)

    def forward(self, c: Tensor | None = None) -> Reflection:
        """Return the reflection for a context x, ``c``, of shape ``(..., context)``."""
        return Reflection(self.mirror(c))

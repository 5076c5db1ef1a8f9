r"""A reflection whose mirror depends on x: how a flow lets a latent count a reward for or against a task.

    z = y - 2 u(x) u(x)^T y,  |u(x)| = 1

A flow is monotone in the reward for each x. But where the reward is d v, a high one speaks for d = 1 at v > 0 and
against it at v < 0: no monotone map gives a latent that means d at either sign of v. A reflection keeps the reward's
sign where the mirror u(x) stands across it and turns it where u(x) lies along it; between the two, v = 0, the reward
tells nothing, and the latent is a noise dimension's. So there must be one (``extra_dims``).
"""

from __future__ import annotations

import torch as th
from torch import Tensor
from torch.distributions import Transform, constraints
from torch.nn.functional import normalize
from zuko.lazy import LazyTransform
from zuko.nn import MLP


class Reflection(Transform):
    """Creates y -> y - 2 u u^T y (Householder): its own inverse, with |det| = 1.

    :param mirror: u, of any length but 0, shape (..., features)
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
    """Creates a reflection whose mirror a network reads off the context.

    :param features: dimension of what is reflected
    :param context: dimension of x
    :param hidden_features: the network's hidden units
    """

    def __init__(self, features: int, context: int, hidden_features: tuple[int, ...] = (128,)) -> None:
        super().__init__()
        self.mirror = MLP(context, features, hidden_features)

    def forward(self, c: Tensor | None = None) -> Reflection:
        """c: the context x, shape (..., context)"""
        return Reflection(self.mirror(c))

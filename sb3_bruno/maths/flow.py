"""A thin adapter over zuko's conditional flows: (y | x) <-> (z, log |det dz/dy|)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import torch as th
from torch import Tensor, nn
from zuko.distributions import DiagNormal
from zuko.lazy import Flow, LazyTransform, UnconditionalDistribution

from sb3_bruno.maths.autoregression import AffineAutoregression
from sb3_bruno.maths.reflection import ConditionalReflection


class Latents(NamedTuple):
    """:ivar z: latents, shape (..., features)
    :ivar log_det: log |det dz/dy|, shape (...)
    """

    z: Tensor
    log_det: Tensor


def paper_maf(features: int, context: int) -> Flow:
    """The paper's flow as near as zuko allows: six masked autoregressive layers of 128 hidden units.

    Each layer's log-scale is bounded to (-1, 1), by zuko's softsign where the paper uses tanh. There is no weight
    normalisation, and no start at the identity: torch's own start taught the belief faster (docs/method.md).
    Orders alternate between ascending and descending.
    """
    return _flow(_layers(features, context, 6), features)


def reflected_maf(features: int, context: int) -> Flow:
    """Four of the paper's layers and a reflection last, so that a latent may turn its sign with x.

    :raises ValueError: if there is but one feature, whose reflection is only a change of sign: nothing could be learned
    """
    if features < 2:
        raise ValueError(f"`reflected_maf` needs at least 2 features, got {features}: set `extra_dims` to 1 or more.")
    return _flow([*_layers(features, context, 4), ConditionalReflection(features, context)], features)


def _layers(features: int, context: int, n_layers: int) -> list[LazyTransform]:
    orders = (th.arange(features), th.arange(features).flip(0))
    return [
        AffineAutoregression(features, context, order=orders[i % 2], hidden_features=(128,)) for i in range(n_layers)
    ]


def _flow(transforms: list[LazyTransform], features: int) -> Flow:
    flow = Flow(transforms, UnconditionalDistribution(DiagNormal, th.zeros(features), th.ones(features), buffer=True))
    for module in flow.modules():  # orders and masks follow from the arguments: nothing to save or to load
        for name, buffer in list(module.named_buffers(recurse=False)):
            if buffer.dtype == th.bool:  # a mask multiplies weights, six times as fast when it is of their type
                module.register_buffer(name, buffer.to(th.get_default_dtype()), persistent=False)
            elif not buffer.is_floating_point():
                module.register_buffer(name, buffer, persistent=False)
    return flow


FLOWS: dict[str, Callable[..., Flow]] = {"paper_maf": paper_maf, "reflected_maf": reflected_maf}
"""Flows that a configuration file can name."""


class ConditionalFlow(nn.Module):
    """Creates a bijection z = f(y | x).

    :param features: dimension of y and z
    :param context: dimension of x
    :param flow_class: builds any zuko flow from ``(features, context, **flow_kwargs)``, or names one of ``FLOWS``
    :param flow_kwargs: further arguments of ``flow_class``
    :raises ValueError: if ``flow_class`` is a name that ``FLOWS`` does not know
    :raises TypeError: if ``flow_class`` does not build a zuko flow
    """

    def __init__(
        self,
        features: int,
        context: int,
        flow_class: str | Callable[..., Flow] = "paper_maf",
        flow_kwargs: dict[str, Any] | None = None,
    ) -> None:
        super().__init__()
        if isinstance(flow_class, str):
            if flow_class not in FLOWS:
                raise ValueError(f"`flow_class` must be one of {sorted(FLOWS)} or a zuko flow, got {flow_class!r}.")
            flow_class = FLOWS[flow_class]
        flow = flow_class(features, context, **(flow_kwargs or {}))
        if not isinstance(flow, Flow):
            raise TypeError(f"`flow_class` must build a zuko.lazy.Flow, got {type(flow)}: try zuko.flows.MAF.")
        self.transform = flow.transform

    def forward(self, y: Tensor, x: Tensor) -> Latents:
        """y: (..., features), x: (..., context)"""
        return Latents(*self.transform(x).call_and_ladj(y))

    def latents(self, y: Tensor, x: Tensor) -> Tensor:
        """z alone, for a belief."""
        z: Tensor = self.transform(x)(y)
        return z

    def inverse(self, z: Tensor, x: Tensor) -> Tensor:
        """z: (..., features), x: (..., context) -> y: (..., features)"""
        y: Tensor = self.transform(x).inv(z)
        return y

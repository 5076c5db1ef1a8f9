"""A thin adapter over zuko's conditional flows: (y | x) <-> (z, log |det dz/dy|), and two flows of our own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import torch as th
from torch import Tensor, nn
from zuko.distributions import DiagNormal
from zuko.flows import NSF
from zuko.lazy import Flow, LazyTransform, UnconditionalDistribution

from sb3_bruno.maths.autoregression import AffineAutoregression
from sb3_bruno.maths.flow_arguments import build_flow
from sb3_bruno.maths.reflection import ConditionalReflection


class Latents(NamedTuple):
    """What a flow makes of y, given x.

    Attributes:
        z: latents, ``(..., features)``.
        log_det: log |det dz/dy|, ``(...)``.
    """

    z: Tensor
    log_det: Tensor


def paper_maf(features: int, context: int) -> Flow:
    """Build the paper's flow as nearly as zuko allows: six masked autoregressive layers of 128 hidden units.

    The order of the features alternates between ascending and descending. Each layer's log-scale is bounded to (-1, 1).
    Deviations from the paper (docs/method.md): softsign, zuko's choice, bounds the log-scale instead of tanh; there is
    no weight normalisation; the weights start as torch draws them and not at the identity, because the belief then
    learned faster.

    Raises:
        ValueError: if there is only one feature, which has none before it to depend on.
    """
    if features < 2:
        raise ValueError(f"features={features} is too few for `paper_maf`: set `extra_dims` to 1 or more.")
    return _flow(_layers(features, context, 6), features)


def reflected_maf(features: int, context: int) -> Flow:
    """Build four layers of the paper's flow and a reflection after them, so that a latent may change its sign with x.

    Raises:
        ValueError: if there is only one feature. Its reflection is a change of sign, and nothing could be learned.
    """
    if features < 2:
        raise ValueError(f"features={features} is too few for `reflected_maf`: set `extra_dims` to 1 or more.")
    return _flow([*_layers(features, context, 4), ConditionalReflection(features, context)], features)


def _layers(features: int, context: int, n_layers: int) -> list[LazyTransform]:
    """Build masked autoregressive layers, of which each second reads the features in descending order."""
    orders = (th.arange(features), th.arange(features).flip(0))
    return [
        AffineAutoregression(features, context, order=orders[i % 2], hidden_features=(128,)) for i in range(n_layers)
    ]


def _flow(transforms: list[LazyTransform], features: int) -> Flow:
    """Join the layers to a zuko flow with a standard normal base, whose masks are floats and stay out of its state."""
    flow = Flow(transforms, UnconditionalDistribution(DiagNormal, th.zeros(features), th.ones(features), buffer=True))
    for module in flow.modules():  # orders and masks follow from the arguments, so they are neither saved nor loaded
        for name, buffer in list(module.named_buffers(recurse=False)):
            if buffer.dtype == th.bool:  # a mask multiplies weights: six times as fast in their own dtype
                module.register_buffer(name, buffer.to(th.get_default_dtype()), persistent=False)
            elif not buffer.is_floating_point():
                module.register_buffer(name, buffer, persistent=False)
    return flow


def spline(features: int, context: int) -> Flow:
    """Build one layer of conditional monotone rational-quadratic splines, of eight bins in [-5, 5].

    Reference: Durkan, Bekasov, Murray and Papamakarios, Neural Spline Flows (2019).
    """
    return NSF(features, context, bins=8, transforms=1, hidden_features=(128, 128))


FLOWS: dict[str, Callable[..., Flow]] = {"spline": spline, "paper_maf": paper_maf, "reflected_maf": reflected_maf}
"""Flows that a configuration file can name."""


class ConditionalFlow(nn.Module):
    """Creates a bijection z = f(y | x) from a zuko flow.

    Args:
        features: dimension of y and z.
        context: dimension of x.
        flow_class: builds a zuko flow from ``(features, context, **flow_kwargs)``, or a name from ``FLOWS``; None for
            the identity. It must map without a gradient's help, for agents act in inference mode: GF, NAF, BPF and CNF
            of zuko do not.
        flow_kwargs: further arguments of ``flow_class``.

    Raises:
        ValueError: if ``flow_class`` is a name that is not in ``FLOWS``, or does not take ``flow_kwargs``.
        TypeError: if ``flow_class`` builds nothing, or no zuko flow.
        ValueError: also if the flow cannot map in inference mode.
    """

    def __init__(
        self,
        features: int,
        context: int,
        flow_class: str | Callable[..., Flow] | None = "spline",
        flow_kwargs: dict[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self.transform: LazyTransform | None = None
        if flow_class is None:
            if flow_kwargs:
                raise ValueError(f"`flow_kwargs={flow_kwargs!r}` is for a flow, and `flow_class=None`: leave it out.")
            return
        if isinstance(flow_class, str):
            if flow_class not in FLOWS:
                raise ValueError(f"flow_class={flow_class!r} is unknown: give one of {sorted(FLOWS)} or a zuko flow.")
            flow_class = FLOWS[flow_class]
        if not callable(flow_class):
            raise TypeError(
                f"flow_class={flow_class!r} builds no flow: give a zuko flow, one of {sorted(FLOWS)} or None."
            )
        flow = build_flow(flow_class, features, context, flow_kwargs)
        if not isinstance(flow, Flow):
            raise TypeError(
                f"flow_class={flow_class!r} builds a {type(flow).__name__} and no zuko.lazy.Flow: try zuko.flows.MAF."
            )
        self.transform = flow.transform
        try:
            with th.inference_mode(), th.random.fork_rng([]):
                self.forward(th.zeros(1, features), th.zeros(1, context))
        except RuntimeError as error:
            raise ValueError(
                f"flow_class={flow_class!r} cannot map in inference mode, in which agents act ({error}): use another, "
                "such as zuko.flows.NSF."
            ) from error

    def forward(self, y: Tensor, x: Tensor) -> Latents:
        """Map y, ``(..., features)``, to its latents, given x, ``(..., context)``."""
        if self.transform is None:
            return Latents(y, y.new_zeros(y.shape[:-1]))
        return Latents(*self.transform(x).call_and_ladj(y))

    def inverse(self, z: Tensor, x: Tensor) -> Tensor:
        """Map z, ``(..., features)``, back to y, ``(..., features)``, given x, ``(..., context)``."""
        if self.transform is None:
            return z
        y: Tensor = self.transform(x).inv(z)
        return y

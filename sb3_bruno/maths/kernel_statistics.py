"""What the process with a kernel is given of each observation, and the sums that it keeps of a set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import torch as th
from torch import Tensor
from torch.nn import functional as F


class Features(NamedTuple):
    """What the process must know of x to expect z, m values.

    Attributes:
        mean: b, what is expected of z before any evidence, ``(..., m)``.
        weights: Phi, how z depends on each of the K task weights, ``(..., m, K)``.
        noise_var: S > 0, the variance of the noise of each value, ``(..., m)``.
    """

    mean: Tensor
    weights: Tensor
    noise_var: Tensor

    @classmethod
    def join(cls, parts: Sequence[Features]) -> Features:
        """Join the features of values, ``(..., m_i)`` each, to those of all of them, ``(..., sum of m_i)``."""
        means, weights, noise_vars = zip(*parts, strict=True)
        return cls(th.cat(means, dim=-1), th.cat(weights, dim=-2), th.cat(noise_vars, dim=-1))

    def padded(self, before: int, after: int) -> Features:
        """Return the features of the same values among ``before + K + after`` weights, of which they need K."""
        return self._replace(weights=F.pad(self.weights, (before, after)))

    def double(self) -> Features:
        """Return the features in float64."""
        return Features(self.mean.double(), self.weights.double(), self.noise_var.double())


class KernelStatistics(NamedTuple):
    """The sufficient statistics of a set of observations: sums, each number kept as a sum of two floats.

    The pair has 48 bits in float32. One float32 is not enough, see ``KernelGaussian``; and the pair, unlike float64,
    survives whatever carries it in float32.

    Attributes:
        high: the sums, rounded, ``(..., size)``: the Gram matrix of [S^-1/2 Phi, S^-1/2 (z - b)], row by row;
            ln det S; the number of values.
        low: what the rounding took from them, ``(..., size)``.
    """

    high: Tensor
    low: Tensor

    @classmethod
    def of(cls, sums: Tensor, dtype: th.dtype) -> KernelStatistics:
        """Split sums in float64, ``(..., size)``."""
        split: Any = _Split.apply if _is_learned(sums) else _split
        return cls(*split(sums, dtype))

    @property
    def sums(self) -> Tensor:
        """The sums in float64, ``(..., size)``."""
        if _is_learned(self.high):
            joined: Tensor = _Join.apply(self.high, self.low)  # type: ignore[no-untyped-call]
            return joined
        return self.high.double() + self.low.double()

    def merge(self, other: KernelStatistics) -> KernelStatistics:
        """Return the statistics of both sets together; the order of the sets does not matter."""
        return self.of(self.sums + other.sums, self.high.dtype)


def _split(number: Tensor, dtype: th.dtype) -> tuple[Tensor, Tensor]:
    high = number.to(dtype)
    return high, (number - high.double()).to(dtype)


def _is_learned(tensor: Tensor) -> bool:
    """Whether there is a gradient to keep; without one, plain operations can be traced."""
    return tensor.requires_grad and th.is_grad_enabled()


class _Join(th.autograd.Function):
    """Adds the two floats up, and splits the gradient in two likewise.

    The gradient needs its digits as the sums do: rounded to float32, that of the log-evidence by S was wrong by .02,
    and with parallel features that of a log-variance by more than itself, because its parts cancel.
    """

    @staticmethod
    def forward(ctx: Any, high: Tensor, low: Tensor) -> Tensor:
        ctx.dtype = high.dtype
        return high.double() + low.double()

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, Tensor]:
        return _split(gradient, ctx.dtype)


class _Split(th.autograd.Function):
    """Splits numbers in two floats, and adds the two gradients that ``_Join`` made up to one."""

    @staticmethod
    def forward(ctx: Any, sums: Tensor, dtype: th.dtype) -> tuple[Tensor, Tensor]:
        return _split(sums, dtype)

    @staticmethod
    def backward(ctx: Any, high: Tensor, low: Tensor) -> tuple[Tensor, None]:
        return high.double() + low.double(), None


def summands(features: Features, z: Tensor, weights: Tensor | None = None) -> Tensor:
    """Return what each observation adds to the sums, in float64: ``(..., m)`` to ``(..., size)``.

    A weight, ``(...)``, multiplies it.
    """
    mean, phi, noise_var = features.double()
    error = (z.double() - mean).unsqueeze(-1)
    whitened = th.cat([phi.expand(*error.shape[:-1], -1), error], dim=-1) / noise_var.sqrt().unsqueeze(-1)
    # One value each: the product of two vectors, at which matmul is slow.
    gram = whitened.mT * whitened if z.shape[-1] == 1 else whitened.mT @ whitened
    n_values = th.full_like(z[..., :1], z.shape[-1], dtype=th.float64)
    noise_log_det = noise_var.log().sum(dim=-1, keepdim=True).expand_as(n_values)
    added = th.cat([gram.flatten(-2), noise_log_det, n_values], dim=-1)
    return added if weights is None else added * weights.unsqueeze(-1)


def prefix_sums(features: Features, z: Tensor, weights: Tensor | None = None) -> Tensor:
    """Return the sums of the first 0, 1, ..., time observations: ``(..., time, m)`` to ``(..., time + 1, size)``."""
    return F.pad(summands(features, z, weights).cumsum(dim=-2), (0, 0, 1, 0))

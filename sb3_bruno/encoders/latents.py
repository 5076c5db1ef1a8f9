"""What a process sees of transitions: their latents z, and what it must know of x to expect them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

from torch import Tensor, nn

from sb3_bruno.encoders.abilities import Moments, Outcomes
from sb3_bruno.encoders.base import Transitions
from sb3_bruno.encoders.variables import Variables
from sb3_bruno.maths.kernel_statistics import Features


class Seen(NamedTuple):
    """What a process sees of transitions.

    Attributes:
        given: the features of x, for a process with a kernel; () for one that knows nothing of x.
        z: latents, one for each value that is modelled and for each of the noise, (..., m).
        log_det: log-determinant of the whole map from the env's units to z, (...).
    """

    given: tuple[Features, ...]
    z: Tensor
    log_det: Tensor


class LatentModel(nn.Module, ABC):
    """Maps transitions to what its process sees. The density of y given x and w is that of z, times a determinant.

    Args:
        variables: read y and x.

    Attributes:
        process: joins the latents of one task, one of ``EXCHANGEABLE`` or ``KERNEL``.
        latent_dim: size of what the process infers: the weights of its kernel, or the paper's theta.
        noise_dim: size of the noise that augments each transition, 0 for none.
    """

    process: Any
    latent_dim: int
    noise_dim: int = 0

    def __init__(self, variables: Variables) -> None:
        super().__init__()
        self.variables = variables

    @abstractmethod
    def see(self, transitions: Transitions, noise: Tensor) -> Seen:
        """Map transitions (..., dim) and noise (..., noise_dim) to what the process sees."""

    @abstractmethod
    def outcomes(self, memory: Any, transitions: Transitions, arrives: bool, n_samples: int) -> Outcomes:
        """Draw samples of y given the memory, (..., dim) -> (n_samples, ..., dim).

        Args:
            memory: of the process.
            transitions: observations and actions, and next observations if ``arrives``. Rewards are not read.
            arrives: whether next observations are known.
            n_samples: number of samples.
        """

    def moments(self, memory: Any, transitions: Transitions, arrives: bool) -> Moments:
        """Compute mean and standard deviation of y given the memory, (..., dim). Arguments as of ``outcomes``.

        Raises:
            ValueError: if the model knows no closed form.
        """
        raise ValueError("Moments in closed form need a process with a kernel: draw samples by `predict_outcomes`.")


def check_arrives(arrives: bool) -> None:
    """Refuse to predict a reward from where the action led without being told.

    Raises:
        ValueError: unless ``arrives``.
    """
    if not arrives:
        raise ValueError(
            "`next_observations` is needed: with `condition_on_next=True` rewards are predicted given where the action "
            "led. Pass it, or train with `condition_on_next=False` or `modelled='both'`."
        )


def unrewarded(observations: Tensor, actions: Tensor, next_observations: Tensor | None) -> tuple[Transitions, bool]:
    """Join what is known to transitions, whose rewards nobody reads, and say whether next observations are known."""
    arrives = next_observations is not None
    there = observations if next_observations is None else next_observations
    return Transitions(observations, actions, observations.new_zeros(*observations.shape[:-1], 1), there), arrives

"""What only some task encoders can do, each ability by its name. ``isinstance(encoder, HasPosterior)`` asks for one."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, runtime_checkable

from torch import Tensor
from torch.distributions import Distribution

from sb3_bruno.encoders.base import TaskEncoder, Transitions
from sb3_bruno.maths.exchangeable import Distance


class Outcomes(NamedTuple):
    """Monte Carlo samples of what follows an action, in data space.

    Attributes:
        rewards: shape (samples, ..., 1), or None where the encoder does not model rewards.
        next_observations: shape (samples, ..., observation_dim), or None where it does not model them.
    """

    rewards: Tensor | None
    next_observations: Tensor | None

    def mean(self) -> Outcomes:
        """Average over the samples, shapes (..., dim)."""
        return Outcomes(*(None if samples is None else samples.mean(dim=0) for samples in self))

    def quantile(self, q: float) -> Outcomes:
        """Take the q-quantile over the samples, each dimension by itself, shapes (..., dim)."""
        return Outcomes(*(None if samples is None else samples.quantile(q, dim=0) for samples in self))


class Moments(NamedTuple):
    """What is expected to follow an action, and how surely, in data space. Shapes as an average of ``Outcomes`` has.

    Attributes:
        mean: expected rewards and next observations, (..., 1) and (..., observation_dim).
        std: their standard deviations, each by itself.
    """

    mean: Outcomes
    std: Outcomes


@runtime_checkable
class HasPosterior(Protocol):
    """Tells a probability distribution over what is hidden: for people, videos and logs."""

    def posterior(self, memory: Any) -> Distribution:
        """p(theta | transitions absorbed), its mean of shape (..., latent_dim).

        Its entries may be independent, batch shape (..., latent_dim), or not, event shape (latent_dim,).
        """


@runtime_checkable
class Predicts(Protocol):
    """Predicts what follows an action, with densities: for diagnostics, and to notice a switch of the task."""

    def outcomes(
        self,
        memory: Any,
        observations: Tensor,
        actions: Tensor,
        next_observations: Tensor | None,
        n_samples: int,
    ) -> Outcomes:
        """Draw samples of what follows ``actions`` at ``observations``, given the transitions absorbed.

        Raises:
            ValueError: if the encoder predicts rewards given ``next_observations``, and these are None.
        """

    def one_step_scores(self, transitions: Transitions) -> Tensor:
        """Score every transition by log p(what is modelled | the rest, the transitions before), in nats.

        Of sequences that each come from one task: (..., time, dim) -> (..., time). An encoder that bounds its evidence
        scores by differences of bounds, whose sum is a bound again.
        """

    def log_bayes_factor(self, memory: Any, transitions: Transitions) -> Tensor:
        """log p(transition | nothing absorbed) - log p(transition | memory), in nats: (..., dim) -> (...)

        Below 0 where the belief expected the transition better than the prior does, far above where the task is
        another.
        """


@runtime_checkable
class PredictsMoments(Protocol):
    """Predicts what follows an action by mean and standard deviation, without a sample: for planning."""

    def moments(self, memory: Any, observations: Tensor, actions: Tensor, next_observations: Tensor | None) -> Moments:
        """Expect what follows ``actions`` at ``observations``, given the transitions absorbed.

        Rewards are None where they are not modelled, and where they are predicted given ``next_observations`` and
        these are None.
        """


@runtime_checkable
class InfersTask(Protocol):
    """Tells how likely tasks are, in their own units: for people, and whoever plans for several tasks."""

    def log_task_likelihood(self, memory: Any, tasks: Tensor) -> Tensor:
        """log p(transitions absorbed | task), in nats, for each of several tasks: (..., n, task_dim) -> (..., n)

        A constant that is the same for all tasks may be missing.
        """


@runtime_checkable
class MeasuresDistance(Protocol):
    """Measures how strange a set of transitions is to the model: for one panel of the diagnostics."""

    def distance(self, transitions: Transitions) -> Distance:
        """Measure how far a set of transitions (..., time, dim) lies from what the encoder expects."""


def check_ability(encoder: TaskEncoder, ability: type[Any], purpose: str) -> Any:
    """Return the encoder, which has the ability from here on.

    Args:
        encoder: any encoder.
        ability: one of the protocols above.
        purpose: what needs it, for the error.

    Raises:
        ValueError: if the encoder lacks it.
    """
    if isinstance(encoder, ability):
        return encoder
    missing = [name for name in vars(ability) if not name.startswith("_") and not hasattr(encoder, name)]
    raise ValueError(
        f"{purpose} needs an encoder with the ability `{ability.__name__}`, and `{type(encoder).__name__}` has no "
        f"{', '.join(f'`{name}`' for name in missing)}: add it, or use `BrunoEncoder`."
    )

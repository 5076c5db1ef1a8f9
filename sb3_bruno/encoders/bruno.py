"""BRUNO: a conditional flow with an exchangeable Gaussian process in its latent space.

    y = (r, s', eps), x = (s, a), z = flow(y | x), theta ~ N(0, rho), z_i | theta ~ N(theta, v - rho)

From the transitions seen so far follows a belief over theta in closed form. Their order does not matter. Where the
reward alone is modelled, y = (r, eps), and x may be (s, a, s'). A Student-t process may stand for the Gaussian.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Literal, TypedDict, get_args

import torch as th
from torch import Tensor
from torch.distributions import Distribution
from zuko.lazy import Flow

from sb3_bruno.encoders.abilities import Outcomes
from sb3_bruno.encoders.base import Loss, TaskEncoder, TaskSequences, Transitions, map_memory
from sb3_bruno.maths.exchangeable import Distance, Statistics
from sb3_bruno.maths.flow import ConditionalFlow, Latents
from sb3_bruno.maths.processes import PROCESSES
from sb3_bruno.maths.standardize import Standardize

NOISE_ENTROPY = 0.5 * math.log(2 * math.pi * math.e)
"""Entropy of one standard normal noise dimension, in nats."""

ProcessName = Literal["gaussian", "student_t", "shared_student_t"]
Modelled = Literal["rewards", "next_observations", "both"]
Objective = Literal["paper", "holdout", "prequential"]
BeliefForm = Literal["mean_var", "mean"]


class BrunoArguments(TypedDict, total=False):
    """The ``encoder_kwargs`` of ``BrunoEncoder``."""

    modelled: Modelled
    condition_on_next: bool
    extra_dims: int | None
    flow_class: str | Callable[..., Flow]
    flow_kwargs: dict[str, Any] | None
    process: ProcessName
    objective: Objective
    belief: BeliefForm


class BrunoEncoder(TaskEncoder[Statistics]):
    r"""Creates the BRUNO task encoder.

    Reference: Korshunova et al., Exchangeable Models in Meta Reinforcement Learning (2020), sections 2.1 to 2.3.

    Noise that augments the transitions is an argument. Without it, it is zero: so a belief is a function of the
    transitions, the same in training, rollouts and tests; only the bound draws noise.

    Args:
        observation_dim: dimension of the (flattened) observation s.
        action_dim: dimension of the action a.
        modelled: what y holds: ``"rewards"`` (tasks that differ in their rewards alone), ``"next_observations"`` (in
            their dynamics alone), or ``"both"``.
        condition_on_next: whether x holds s' too, so that a reward that depends on where the action led speaks of the
            task and not of the noise in between. Only where the reward alone is modelled; not in the paper.
        extra_dims: noise dimensions that augment y (section 2.2). None: 4, as in the paper, where the reward is
            modelled alone, and 0 otherwise.
        flow_class: builds any zuko flow from ``(features, context, **flow_kwargs)``, or names one of
            ``sb3_bruno.maths.flow.FLOWS``: ``"paper_maf"``, or ``"reflected_maf"`` where what speaks for a task at one
            x speaks against it at another (a direction: the reward's sign turns with the velocity's).
        flow_kwargs: further arguments of ``flow_class``.
        process: the process in the latent space: ``"gaussian"`` as in the paper, or ``"student_t"``, whose belief has
            a variance that depends on the data; ``"shared_student_t"`` has one scale for all latent dimensions.
        objective: which transitions of a sequence are scored given which: ``"paper"``, ``"holdout"`` or
            ``"prequential"``, see ``bound``. What the defaults of both are worth: ``docs/method.md``.
        belief: what actor and critics see of the posterior: ``"mean_var"`` or ``"mean"``.

    Attributes:
        noise_dim: size of the noise that augments each transition, 0 for none.

    Raises:
        ValueError: if ``modelled``, ``process``, ``objective`` or ``belief`` is none of the above, or ``extra_dims``
            is negative.
    """

    search_space: ClassVar[Mapping[str, Sequence[Any]]] = {
        "flow_class": ("paper_maf", "reflected_maf"),
        "extra_dims": range(1, 5),
        "condition_on_next": (False, True),
        "process": ("gaussian", "student_t"),
        "objective": ("paper", "prequential"),
    }

    def __init__(
        self,
        observation_dim: int,
        action_dim: int,
        *,
        modelled: Modelled = "rewards",
        condition_on_next: bool = False,
        extra_dims: int | None = None,
        flow_class: str | Callable[..., Flow] = "paper_maf",
        flow_kwargs: dict[str, Any] | None = None,
        process: ProcessName = "student_t",
        objective: Objective = "prequential",
        belief: BeliefForm = "mean_var",
    ) -> None:
        super().__init__()
        for name, value, known in (
            ("modelled", modelled, get_args(Modelled)),
            ("process", process, PROCESSES),
            ("objective", objective, get_args(Objective)),
            ("belief", belief, get_args(BeliefForm)),
        ):
            if value not in known:
                raise ValueError(f"`{name}` must be one of {', '.join(map(repr, known))}, got {value!r}.")
        if condition_on_next and modelled != "rewards":
            raise ValueError(f"`condition_on_next=True` needs `modelled='rewards'`, got {modelled!r}: s' is modelled.")
        if extra_dims is None:
            extra_dims = 4 if modelled == "rewards" else 0
        if extra_dims < 0:
            raise ValueError(f"`extra_dims` must not be negative, got {extra_dims}.")
        self._reward_dim = 0 if modelled == "next_observations" else 1
        self._next_observation_dim = 0 if modelled == "rewards" else observation_dim
        self._condition_on_next = condition_on_next
        self._objective = objective
        self._belief = belief
        self.shortest_sequence = 2 if objective == "holdout" else 1
        self.noise_dim = extra_dims
        self.latent_dim = self._reward_dim + self._next_observation_dim + extra_dims
        self.belief_dim = 2 * self.latent_dim if belief == "mean_var" else self.latent_dim
        context_dim = observation_dim + action_dim + (observation_dim if condition_on_next else 0)
        self.standardize_x = Standardize(context_dim)
        self.standardize_y = Standardize(self.latent_dim - extra_dims)
        self.flow = ConditionalFlow(self.latent_dim, context_dim, flow_class, flow_kwargs)
        self.process = PROCESSES[process](self.latent_dim)

    def latents(self, transitions: Transitions, noise: Tensor | None = None) -> Tensor:
        """Compute z = flow(y | x) of each transition, x and y standardised.

        Transitions (..., dim) and noise (..., noise_dim) -> (..., latent_dim)
        """
        return self.flow.latents(*self._flow_input(transitions, noise))

    def latents_and_log_det(self, transitions: Transitions, noise: Tensor | None = None) -> Latents:
        """Compute z, and the log-determinant of the whole map, shape (...)."""
        z, log_det = self.flow(*self._flow_input(transitions, noise))
        return Latents(z, log_det - self.standardize_y.std.log().sum())

    def _flow_input(self, transitions: Transitions, noise: Tensor | None) -> tuple[Tensor, Tensor]:
        """Return y with its noise, and x."""
        if noise is None:
            noise = transitions.rewards.new_zeros(*transitions.rewards.shape[:-1], self.noise_dim)
        y = self.standardize_y(self._y(transitions))
        return th.cat([y, noise], dim=-1), self.standardize_x(self._x(transitions))

    def _x(self, transitions: Transitions) -> Tensor:
        """Return what the flow is conditioned on: (s, a) or (s, a, s')."""
        observations, actions, _, next_observations = transitions
        return th.cat([observations, actions, *([next_observations] if self._condition_on_next else [])], dim=-1)

    def _y(self, transitions: Transitions) -> Tensor:
        """Return what is modelled, without the noise: r, s' or (r, s').

        s' as the change s' - s, which given s has the same density and shows what a step does.
        """
        parts = [transitions.rewards] if self._reward_dim else []
        if self._next_observation_dim:
            parts.append(transitions.next_observations - transitions.observations)
        return th.cat(parts, dim=-1)

    def empty(self, batch_shape: tuple[int, ...] = ()) -> Statistics:
        return self.process.empty(batch_shape)

    def absorb(self, memory: Statistics, transitions: Transitions, noise: Tensor | None = None) -> Statistics:
        return self.process.absorb(memory, self.latents(transitions, noise))

    def prefixes(
        self, transitions: Transitions, weights: Tensor | None = None, noise: Tensor | None = None
    ) -> Statistics:
        return self.process.prefixes(self.latents(transitions, noise), weights)

    def posterior(self, memory: Statistics) -> Distribution:
        """p(theta | transitions absorbed), batch shape (..., latent_dim)."""
        return self.process.posterior(memory)

    def belief(self, memory: Statistics) -> Tensor:
        mean, var = self.process.posterior_moments(memory)
        return mean if self._belief == "mean" else th.cat([mean, var], dim=-1)

    def log_bayes_factor(self, memory: Statistics, transitions: Transitions) -> Tensor:
        """log p(transition | prior) - log p(transition | memory), in nats: (..., dim) -> (...)"""
        z = self.latents(transitions)  # both densities have the same log-determinant
        believed = self.process.log_predictive(memory, z)
        return self.process.log_predictive(self.process.empty(tuple(z.shape[:-1])), z) - believed

    def loss(self, sequences: TaskSequences) -> Loss:
        """Minus the ``bound``. In training mode it also moves the running statistics that standardise x and y."""
        transitions, _, weights = sequences
        if self.training:
            counted = ... if weights is None else weights > 0
            self.standardize_x.update(self._x(transitions)[counted])
            self.standardize_y.update(self._y(transitions)[counted])
        bound = self.bound(transitions, weights)
        return Loss(-bound, {"bound_nats": bound.detach()})

    def bound(self, transitions: Transitions, weights: Tensor | None = None) -> Tensor:
        r"""Bound the log-density of a sequence of T transitions, per transition, by one of three objectives.

        - ``"paper"``, Eq. 4: every transition given the first k, the k included
        - ``"holdout"``: those after the first k, given the first k
        - ``"prequential"``: every transition given those before it; their sum is the exact joint evidence

        .. math:: \frac{1}{T} \sum_t \log p(y_t, \epsilon_t \mid x_t, \tau_{1:k}) + H(\epsilon), \quad
            k \sim U\{T/4, \dots, 3T/4 - 1\} \text{ once per batch}

        The entropy H of the noise makes it a lower bound on log p(y | x, context), constant included.

        Args:
            transitions: shape (..., time, dim).
            weights: 1 for a transition that counts, 0 for one that does not, shape (..., time). None: all count.

        Returns:
            The bound in nats per transition, shape ().

        Raises:
            ValueError: if the sequences are shorter than ``shortest_sequence``.
        """
        if self._objective == "prequential":
            return _mean(self.one_step_bounds(transitions, weights), weights)
        time = transitions.rewards.shape[-2]
        if time < self.shortest_sequence:
            raise ValueError(f"`transitions` has {time} in a sequence: the holdout objective needs 2, one to hold out.")
        k = int(th.randint(max(time // 4, 1), max(3 * time // 4, 2), ()))
        first_scored = k if self._objective == "holdout" else 0
        z, log_det = self.latents_and_log_det(transitions, self.draw_noise(transitions.rewards.shape[:-1]))
        if weights is None:
            context = self.process.statistics(z[..., :k, :])
        else:
            context = map_memory(lambda x: x[..., -1, :], self.process.prefixes(z[..., :k, :], weights[..., :k]))
            weights = weights[..., first_scored:]
        log_z = self.process.log_predictive(map_memory(lambda x: x.unsqueeze(-2), context), z[..., first_scored:, :])
        return _mean(log_z + log_det[..., first_scored:], weights) + self.noise_dim * NOISE_ENTROPY

    def one_step_bounds(self, transitions: Transitions, weights: Tensor | None = None) -> Tensor:
        """Score every transition given those before it, in nats: (..., time, dim) -> (..., time)"""
        z, log_det = self.latents_and_log_det(transitions, self.draw_noise(transitions.rewards.shape[:-1]))
        before = map_memory(lambda x: x[..., :-1, :], self.process.prefixes(z, weights))
        if weights is None:  # what follows from n alone is computed for one sequence
            before = before._replace(n=th.arange(z.shape[-2], dtype=z.dtype, device=z.device).unsqueeze(-1))
        return self.process.log_predictive(before, z) + log_det + self.noise_dim * NOISE_ENTROPY

    def draw_noise(self, batch_shape: tuple[int, ...]) -> Tensor:
        """Draw standard normal noise for as many transitions, shape (*batch_shape, noise_dim)."""
        like = next(self.parameters())
        return th.randn(*batch_shape, self.noise_dim, dtype=like.dtype, device=like.device)

    def distance(self, transitions: Transitions) -> Distance:
        """Measure how far transitions (..., time, dim) lie from what the process expects, with noise drawn."""
        noise = self.draw_noise(transitions.rewards.shape[:-1])
        return self.process.distance(self.process.statistics(self.latents(transitions, noise)))

    def outcomes(
        self,
        memory: Statistics,
        observations: Tensor,
        actions: Tensor,
        next_observations: Tensor | None,
        n_samples: int,
    ) -> Outcomes:
        """Draw z from the predictive and invert the flow. Shapes (..., dim) -> (n_samples, ..., dim)

        Raises:
            ValueError: if rewards are predicted given ``next_observations``, and these are None.
        """
        given = [observations, actions]
        if self._condition_on_next:
            if next_observations is None:
                raise ValueError(
                    "`next_observations` is needed: with `condition_on_next=True` rewards are predicted given where "
                    "the action led. Pass it, or train with `condition_on_next=False`."
                )
            given.append(next_observations)
        z = self.process.sample(memory, n_samples)
        x = self.standardize_x(th.cat(given, dim=-1)).expand(n_samples, *observations.shape[:-1], -1)
        y = self.standardize_y.inverse(self.flow.inverse(z, x)[..., : self.latent_dim - self.noise_dim])
        rewards, changes = y.split([self._reward_dim, self._next_observation_dim], dim=-1)
        return Outcomes(
            rewards if self._reward_dim else None,
            observations + changes if self._next_observation_dim else None,
        )

    def diagnostics(self) -> dict[str, Tensor]:
        correlation = self.process.cov / self.process.var
        return {
            "process_var_mean": self.process.var.mean(),
            "process_correlation_mean": correlation.mean(),
            "process_correlation_max": correlation.max(),
        }


def _mean(scores: Tensor, weights: Tensor | None) -> Tensor:
    """Average scores (..., time) over the transitions that count."""
    return scores.mean() if weights is None else (scores * weights).sum() / weights.sum()

"""BRUNO: a flow with a process in its latent space, from which a belief over the task follows in closed form.

    z = flow(y | x),   z_i | w ~ N(b(x_i) + Phi(x_i) w, diag S(x_i)),   w ~ N(0, I)

y = (r, s'): r is given x = (s, a, s'), and s' is given x = (s, a). The order of the transitions does not matter. The
paper's own process is the special case in which b, Phi and S are constant; there, noise may augment y.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Self

import torch as th
from torch import Tensor
from torch.distributions import Distribution
from zuko.lazy import Flow

from sb3_bruno.encoders.abilities import Moments, Outcomes
from sb3_bruno.encoders.base import Loss, TaskEncoder, TaskSequences, Transitions, map_memory
from sb3_bruno.encoders.bruno_arguments import BeliefForm, Objective, ProcessName, check_choices
from sb3_bruno.encoders.choices import check_layers, check_least
from sb3_bruno.encoders.exchangeable_model import ExchangeableModel
from sb3_bruno.encoders.kernel_model import KernelModel
from sb3_bruno.encoders.latents import LatentModel, Seen, unrewarded
from sb3_bruno.encoders.task_map import TaskMap
from sb3_bruno.encoders.variables import Modelled, Variables
from sb3_bruno.maths.exchangeable import Distance
from sb3_bruno.maths.flow import FLOWS
from sb3_bruno.maths.kernel_process_t import KernelStudentT
from sb3_bruno.maths.processes import EXCHANGEABLE, KERNEL

NOISE_ENTROPY = 0.5 * math.log(2 * math.pi * math.e)
"""Entropy of one standard normal noise dimension, in nats."""


class BrunoEncoder(TaskEncoder[Any]):
    r"""Creates the BRUNO task encoder.

    Reference: Korshunova et al., Exchangeable Models in Meta Reinforcement Learning (2020), sections 2.1 to 2.3.

    Args:
        observation_dim: dimension of the (flattened) observation s.
        action_dim: dimension of the action a.
        modelled: what y holds: ``"rewards"`` (tasks that differ in their rewards alone), ``"next_observations"`` (in
            their dynamics alone), or ``"both"``.
        condition_on_next: whether the reward is modelled given s' too, so that a reward that depends on where the
            action led speaks of the task and not of the noise in between. Not in the paper. None: where the model can,
            which without a kernel maps rewards and next observations by one flow, if both are modelled.
        process: ``"kernel"``, or ``"kernel_student_t"``, whose belief has a scale that depends on the data;
            ``"gaussian"`` is the paper's, whose covariance does not depend on x.
        n_weights: K, how many weights a process with a kernel has for rewards, and how many for next observations.
        net_arch: hidden layers of the networks of a kernel's features.
        extra_dims: noise dimensions that augment y (section 2.2), without a kernel.
        flow_class: builds a zuko flow from ``(features, context, **flow_kwargs)``, or names one of
            ``sb3_bruno.maths.flow.FLOWS``; None for no flow. With a kernel it maps the reward alone.
        flow_kwargs: further arguments of ``flow_class``.
        objective: which transitions of a sequence are scored given which: ``"paper"``, ``"holdout"`` or
            ``"prequential"``, see ``bound``. What the defaults are worth: ``docs/method.md``.
        belief: what actor and critics see: ``"mean"``, the posterior's, and with it its standard deviations or its
            variances v; of a Student-t, where they have no bound, those of log(1 + v).

    Raises:
        ValueError: if an argument is none of the above, or two do not go together.
    """

    max_grad_norm: float | None = 10.0  # so that one strange reward does not halt Adam for thousands of updates
    search_space: ClassVar[Mapping[str, Sequence[Any]]] = {
        "process": ("kernel", "kernel_student_t", "gaussian"),
        "n_weights": (4, 8, 16),
        "belief": ("mean", "mean_std"),
    }

    def __init__(
        self,
        observation_dim: int,
        action_dim: int,
        *,
        modelled: Modelled = "both",
        condition_on_next: bool | None = None,
        process: ProcessName = "kernel",
        n_weights: int = 8,
        net_arch: Sequence[int] = (128, 128),
        extra_dims: int = 0,
        flow_class: str | Callable[..., Flow] | None = "spline",
        flow_kwargs: dict[str, Any] | None = None,
        objective: Objective = "prequential",
        belief: BeliefForm = "mean",
    ) -> None:
        super().__init__()
        check_choices(modelled=modelled, process=process, objective=objective, belief=belief)
        check_least("extra_dims", extra_dims, 0)
        if extra_dims and process != "gaussian":
            raise ValueError(
                f"`extra_dims={extra_dims}` needs `process='gaussian'`, got {process!r}: a kernel has no use for noise."
            )
        if not isinstance(n_weights, int) or isinstance(n_weights, bool) or n_weights < 1:
            raise ValueError(f"`n_weights` must be a positive integer, got {n_weights!r}.")
        check_layers("net_arch", net_arch)
        if isinstance(flow_class, str) and flow_class not in FLOWS:
            raise ValueError(f"`flow_class={flow_class!r}` is unknown: give one of {sorted(FLOWS)} or a zuko flow.")
        if condition_on_next and modelled == "next_observations":
            raise ValueError("`condition_on_next=True` is for rewards, and `modelled='next_observations'` has none.")
        one_flow = process in EXCHANGEABLE and modelled == "both"
        if one_flow and condition_on_next:
            raise ValueError(
                f"`condition_on_next=True` with `modelled='both'` needs a process with a kernel, got {process!r}: one "
                "flow maps rewards and next observations together. Leave it out."
            )
        condition_on_next = not one_flow if condition_on_next is None else condition_on_next
        variables = Variables(observation_dim, action_dim, modelled, condition_on_next)
        self.model: LatentModel
        if process in KERNEL:
            self.model = KernelModel(variables, KERNEL[process], n_weights, net_arch, flow_class, flow_kwargs)
        else:
            self.model = ExchangeableModel(variables, EXCHANGEABLE[process], extra_dims, flow_class, flow_kwargs)
        self.task_map: TaskMap | None = None
        self._objective = objective
        self._belief = belief
        self.shortest_sequence = 2 if objective == "holdout" else 1
        self.belief_dim = self.model.latent_dim * (1 if belief == "mean" else 2)

    @classmethod
    def build(cls, observation_dim: int, action_dim: int, task_dim: int, **kwargs: Any) -> Self:
        """Build the encoder; with a kernel, together with a map that reads the true tasks in training."""
        encoder = cls(observation_dim, action_dim, **kwargs)
        if isinstance(encoder.model, KernelModel):
            encoder.task_map = TaskMap(task_dim, encoder.model.latent_dim)
        return encoder

    @property
    def process(self) -> Any:
        """The process in the latent space, one of ``sb3_bruno.maths.processes``."""
        return self.model.process

    def see(self, transitions: Transitions, noise: Tensor | None = None) -> Seen:
        """Map transitions to what the process sees.

        Args:
            transitions: shape (..., dim).
            noise: augments y, shape (..., extra_dims). None: zero, so that a belief is a function of the transitions.
        """
        if noise is None:
            noise = transitions.rewards.new_zeros(*transitions.rewards.shape[:-1], self.model.noise_dim)
        return self.model.see(transitions, noise)

    def empty(self, batch_shape: tuple[int, ...] = ()) -> Any:
        return self.process.empty(batch_shape)

    def absorb(self, memory: Any, transitions: Transitions, noise: Tensor | None = None) -> Any:
        given, z, _ = self.see(transitions, noise)
        return self.process.absorb(memory, *given, z)

    def prefixes(self, transitions: Transitions, weights: Tensor | None = None, noise: Tensor | None = None) -> Any:
        given, z, _ = self.see(transitions.blanked(weights), noise)
        return self.process.prefixes(*given, z, weights)

    def count(self, memory: Any) -> Tensor:
        count: Tensor = self.process.count(memory)
        return count

    def posterior(self, memory: Any) -> Distribution:
        """p(w | transitions absorbed), of K weights or of the paper's theta."""
        posterior: Distribution = self.process.posterior(memory)
        return posterior

    def belief(self, memory: Any) -> Tensor:
        mean, var = self.process.posterior_moments(memory)
        if self._belief == "mean":
            belief: Tensor = mean
            return belief
        if isinstance(self.process, KernelStudentT):  # one strange transition multiplies its variances by any number
            var = var.log1p()
        return th.cat([mean, var if self._belief == "mean_var" else var.sqrt()], dim=-1)

    def log_bayes_factor(self, memory: Any, transitions: Transitions) -> Tensor:
        """log p(transition | prior) - log p(transition | memory), in nats: (..., dim) -> (...)"""
        given, z, _ = self.see(transitions)  # both densities have the same log-determinant
        factor: Tensor = self.process.log_bayes_factor(memory, *given, z)
        return factor

    def log_task_likelihood(self, memory: Any, tasks: Tensor) -> Tensor:
        """log p(transitions absorbed | task), in nats, for each of several tasks: (..., n, task_dim) -> (..., n)

        Raises:
            ValueError: if the encoder knows no tasks, because it has no kernel or was not made by ``build``.
        """
        if self.task_map is None:
            raise ValueError("The encoder knows no tasks: use a process with a kernel, and make it by `build`.")
        return self.task_map.log_likelihood(self.process, memory, tasks)

    def loss(self, sequences: TaskSequences) -> Loss:
        """Minus the ``bound``, and minus the score of the true tasks, which teaches the map from tasks.

        That score reaches none of the encoder's networks; a Student-t's degrees of freedom are fitted to both.

        In training mode it also moves the running statistics that standardise.
        """
        transitions, tasks, weights = sequences
        if self.training:
            self.model.variables.update(transitions, weights)
        seen = self.see(transitions.blanked(weights), self.draw_noise(transitions.rewards.shape[:-1]))
        weights = th.ones_like(seen.log_det) if weights is None else weights
        statistics = self.process.statistics(*seen.given, seen.z, weights)
        bound = self._bound(seen, statistics, weights)
        if self.task_map is None:
            return Loss(-bound, {"bound_nats": bound.detach()})
        known = map_memory(Tensor.detach, statistics)
        if self.training:
            self.task_map.update(self.process, known, tasks)
        log_z = self.task_map.log_likelihood(self.process, known, tasks.unsqueeze(-2)).squeeze(-1)
        told = (log_z.sum() + (weights * seen.log_det.detach()).sum()) / weights.sum().clamp(min=1)
        return Loss(-bound - told, {"bound_nats": bound.detach(), "task_nats": told.detach()})

    def bound(self, transitions: Transitions, weights: Tensor | None = None) -> Tensor:
        r"""Bound the log-density of a sequence of T transitions, per transition, by one of three objectives.

        - ``"paper"``, Eq. 4: every transition given the first k, the k included
        - ``"holdout"``: those after the first k, given the first k
        - ``"prequential"``: every transition given those before it: the exact joint evidence

        .. math:: \frac{1}{T} \sum_t \log p(y_t, \epsilon_t \mid x_t, \tau_{1:k}) + H(\epsilon), \quad
            k \sim U\{T/4, \dots, 3T/4 - 1\} \text{ once per batch}

        Without noise it is the log-density itself. With noise, its entropy H makes the evidence a lower bound on
        log p(y | x), constant included; what is scored given other transitions is then a difference of two bounds.

        Args:
            transitions: shape (..., time, dim).
            weights: 1 for a transition that counts, 0 for one that does not, shape (..., time). None: all count.

        Returns:
            The bound in nats per transition, shape ().

        Raises:
            ValueError: if the sequences are shorter than ``shortest_sequence``.
        """
        seen = self.see(transitions.blanked(weights), self.draw_noise(transitions.rewards.shape[:-1]))
        weights = th.ones_like(seen.log_det) if weights is None else weights
        return self._bound(seen, self.process.statistics(*seen.given, seen.z, weights), weights)

    def _bound(self, seen: Seen, statistics: Any, weights: Tensor) -> Tensor:
        """Bound by the objective; ``statistics`` are those of whole sequences."""
        given, z, log_det = seen
        if self._objective == "prequential":
            score = self.process.log_evidence(statistics).sum() + (weights * log_det).sum()
        else:
            time = log_det.shape[-1]
            if time < self.shortest_sequence:
                raise ValueError(f"`transitions` has {time} in a sequence: the holdout objective needs 2.")
            k = int(th.randint(max(time // 4, 1), max(3 * time // 4, 2), ()))
            known = (th.arange(time, device=z.device) < k).to(weights)
            context = self.process.statistics(*given, z, weights * known)
            if self._objective == "holdout":
                weights = weights * (1 - known)
            log_z = self.process.log_predictive(map_memory(lambda x: x.unsqueeze(-2), context), *given, z)
            score = (weights * (log_z + log_det)).sum()
        bound: Tensor = score / weights.sum().clamp(min=1) + self.model.noise_dim * NOISE_ENTROPY
        return bound

    def one_step_scores(self, transitions: Transitions, weights: Tensor | None = None) -> Tensor:
        """Score every transition given those before it, in nats: (..., time, dim) -> (..., time)"""
        given, z, log_det = self.see(transitions, self.draw_noise(transitions.rewards.shape[:-1]))
        scores: Tensor = self.process.one_step_log_predictives(*given, z, weights)
        return scores + log_det + self.model.noise_dim * NOISE_ENTROPY

    def draw_noise(self, batch_shape: tuple[int, ...]) -> Tensor:
        """Draw standard normal noise for as many transitions, shape (*batch_shape, extra_dims)."""
        like = next(self.parameters())
        return th.randn(*batch_shape, self.model.noise_dim, dtype=like.dtype, device=like.device)

    def distance(self, transitions: Transitions) -> Distance:
        """Measure how far transitions (..., time, dim) lie from what the process expects, with noise drawn."""
        given, z, _ = self.see(transitions, self.draw_noise(transitions.rewards.shape[:-1]))
        distance: Distance = self.process.distance(self.process.statistics(*given, z))
        return distance

    def outcomes(
        self,
        memory: Any,
        observations: Tensor,
        actions: Tensor,
        next_observations: Tensor | None,
        n_samples: int,
    ) -> Outcomes:
        """Draw z from the predictive and invert the flow. Shapes (..., dim) -> (n_samples, ..., dim)

        Raises:
            ValueError: if rewards are predicted given ``next_observations``, and these are None and not modelled.
        """
        return self.model.outcomes(memory, *unrewarded(observations, actions, next_observations), n_samples)

    def moments(self, memory: Any, observations: Tensor, actions: Tensor, next_observations: Tensor | None) -> Moments:
        """Compute mean and standard deviation of what follows an action, without a sample. Shapes (..., dim)

        Raises:
            ValueError: if the process has no kernel.
        """
        return self.model.moments(memory, *unrewarded(observations, actions, next_observations))

r"""A belief learned by supervision: an LSTM is taught the true task of each episode, separately from the policy.

Reference: Humplik et al., Meta reinforcement learning as task inference (2019, arXiv 1905.06424). There is no official
code; what is said of sizes and of the bottleneck below is from memory of the paper.

.. math:: L = -\text{mean}_t \log q(g \mid f_t) + \beta\, KL(q(c_t), N(0, I)), \quad
    f_t = \text{ReLU}(W h_t), \quad h_t = \text{LSTM}(h_{t-1}, \tau_t)

g is the task. With a bottleneck (beta > 0), f_t gives mean and log-variance of a code c_t, which takes the place of f_t
and is sampled in the loss. The posterior of the task does not depend on who made the episode, so replayed episodes of
any age serve.

q is a Gaussian with learned variance, a mixture of two, or a categorical distribution over one-hot tasks. Before any
evidence, a Gaussian's mean may be no task, as between left and right; its variance tells so, and a mixture tells which
tasks there are.

Deviations from the paper:

- SAC and other off-policy algorithms instead of SVG(0) and PPO.
- The loss is a mean over steps, there a sum.
- The network reads whole transitions (s, a, r, s' - s), standardised by running statistics; so are the tasks.
- Targets are task vectors. The paper's others, task embeddings and the actions of an expert per task, are left out; so
  is its network that the actor-critic's loss teaches too.
- ``belief="moments"`` is not in the paper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, Self, TypedDict

import torch as th
from torch import Tensor, nn
from torch.distributions import Distribution, Normal, kl_divergence
from torch.nn import functional as F

from sb3_bruno.encoders.base import Loss, TaskSequences
from sb3_bruno.encoders.choices import check_choice, check_least
from sb3_bruno.encoders.recurrent import RecurrentMemory
from sb3_bruno.encoders.standard_recurrent import StandardRecurrent
from sb3_bruno.encoders.task_heads import TaskHeadName, make_head

SupervisedForm = Literal["features", "moments"]


class SupervisedArguments(TypedDict, total=False):
    """The ``encoder_kwargs`` of ``SupervisedBelief``."""

    head: TaskHeadName
    belief: SupervisedForm
    hidden_size: int
    feature_dim: int
    bottleneck: float


class SupervisedBelief(StandardRecurrent):
    """Creates a task encoder that learns from the true tasks. Privileged in training; a belief never reads the task.

    The other encoders learn without the task's value, so mark this one in comparisons.

    Args:
        observation_dim: dimension of the (flattened) observation s.
        action_dim: dimension of the action a.
        task_dim: size of the task vector.
        head: the distribution over tasks: ``"gaussian"``; ``"mixture"``, of two Gaussians, for tasks like left and
            right; ``"one_hot"``, for tasks that are one-hot vectors.
        belief: what actor and critics see: ``"features"``, the layer before the head; or ``"moments"``, mean and
            log-variance of the standardised task (the probabilities of one-hot tasks).
        hidden_size: size of the LSTM's state.
        feature_dim: size of the layer before the head.
        bottleneck: beta, of the KL of that layer to a standard normal; 0: the layer is no code.

    Raises:
        ValueError: if an argument is none of the above, or a number is out of range.
    """

    search_space: ClassVar[Mapping[str, Sequence[Any]]] = {
        "belief": ("features", "moments"),
        "hidden_size": (64, 128),
        "bottleneck": (0.0, 1e-3, 1e-2),
    }

    def __init__(
        self,
        observation_dim: int,
        action_dim: int,
        task_dim: int,
        *,
        head: TaskHeadName = "gaussian",
        belief: SupervisedForm = "features",
        hidden_size: int = 64,
        feature_dim: int = 64,
        bottleneck: float = 0.0,
    ) -> None:
        check_choice("head", head, TaskHeadName)
        check_choice("belief", belief, SupervisedForm)
        check_least("feature_dim", feature_dim, 1)
        check_least("bottleneck", bottleneck, 0)
        super().__init__(observation_dim, action_dim, "lstm", hidden_size)
        self._belief = belief
        self._bottleneck = bottleneck
        self.features = nn.Sequential(nn.Linear(hidden_size, feature_dim), nn.ReLU())
        self.code = nn.Linear(feature_dim, 2 * feature_dim) if bottleneck else None
        self.head = make_head(head, feature_dim, task_dim)
        self.belief_dim = feature_dim if belief == "features" else self.head.moments_dim

    @classmethod
    def build(cls, observation_dim: int, action_dim: int, task_dim: int, **kwargs: Any) -> Self:
        return cls(observation_dim, action_dim, task_dim, **kwargs)

    def check_tasks(self, tasks: Tensor) -> None:
        """Refuse tasks that the head cannot tell, (n, task_dim).

        Raises:
            ValueError: if tasks should be one-hot vectors, and one is none.
        """
        self.head.check(tasks)

    def belief(self, memory: RecurrentMemory) -> Tensor:
        """Return the features, (..., feature_dim), or the moments, (..., 2 task_dim) or (..., task_dim)."""
        features = self._mean_features(memory)
        return features if self._belief == "features" else self.head.moments(self.head(features))

    def posterior(self, memory: RecurrentMemory) -> Distribution:
        """q(task | transitions absorbed), in the task's own units: batch shape (...), event shape (task_dim,)"""
        posterior: Distribution = self.head(self._mean_features(memory))
        return posterior

    def log_task_likelihood(self, memory: RecurrentMemory, tasks: Tensor) -> Tensor:
        """log q(task | memory) - log q(task), in nats, for each of several tasks: (..., n, task_dim) -> (..., n)

        By Bayes' rule that is the log-likelihood of the task, up to a constant.

        Raises:
            ValueError: if tasks should be one-hot vectors, and one is none.
        """
        self.check_tasks(tasks)
        told, prior = (self.head(self._mean_features(given).unsqueeze(-2)) for given in (memory, self.empty()))
        scores: Tensor = told.log_prob(tasks) - prior.log_prob(tasks)
        return scores

    def loss(self, sequences: TaskSequences) -> Loss:
        """Return the loss above. In training mode, move the running statistics too.

        Raises:
            ValueError: if tasks should be one-hot vectors, and one is none.
        """
        transitions, tasks, weights = sequences
        if self.training:
            self.variables.update(transitions, weights)
            self.head.update(tasks)
        weights = th.ones_like(transitions.rewards[..., 0]) if weights is None else weights
        counts = F.pad(weights, (1, 0), value=1.0)
        features = self.features(self.prefixes(transitions, weights).hidden)
        cost = th.zeros_like(counts)
        if self.code is not None:
            code = _code(self.code(features))
            features, cost = code.rsample(), kl_divergence(code, Normal(0.0, 1.0)).sum(dim=-1)
        nats = self.head(features).log_prob(tasks.unsqueeze(-2))
        nats, cost = ((counts * step).sum(dim=1).div(counts.sum(dim=1)).mean() for step in (nats, cost))
        scalars = {"task_nats": nats.detach()}
        if self.code is not None:
            scalars["bottleneck_nats"] = cost.detach()
        return Loss(self._bottleneck * cost - nats, scalars)

    def _mean_features(self, memory: RecurrentMemory) -> Tensor:
        """Return the layer before the head, (..., feature_dim), without noise."""
        features: Tensor = self.features(memory.hidden)
        return features if self.code is None else _code(self.code(features)).mean


def _code(moments: Tensor) -> Normal:
    mean, log_var = moments.chunk(2, dim=-1)
    return Normal(mean, (0.5 * log_var).exp())

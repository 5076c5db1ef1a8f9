"""What an algorithm's agent believes and expects, as methods of the algorithm."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.algorithms.beliefs import AgentView, TaskBelief, check_question
from sb3_bruno.algorithms.carried import State
from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.algorithms.task_estimate import TaskEstimate, TaskLabels
from sb3_bruno.encoders import Moments, Outcomes, Transitions


class BeliefQueries:
    """Tells what an algorithm's agent believes and what it expects, in the env's own units. A mixin for algorithms.

    An agent that was trained with VecNormalize knows these only together with it, which SB3 saves apart: load the
    agent with ``env=VecNormalize.load(...)``.
    """

    policy: TaskInferencePolicy
    task_labels: TaskLabels
    _vec_normalize_env: VecNormalize | None

    def infer(self, transitions: Transitions) -> TaskBelief:
        """Compute the belief of any sequence of transitions. Their order matters to encoders of order "time".

        Args:
            transitions: arrays or tensors (..., time, dim) in the env's own units, dim flat or the shape of the space.
                Time 0 gives the prior.

        Raises:
            ValueError: if an array has another shape or holds a number that is not finite, or the encoder has no
                posterior.
        """
        return self._view.infer(transitions)

    def belief(self, state: State) -> TaskBelief:
        """Read the belief that an agent carries in the ``state`` that ``predict`` returned, batch shape (n_envs,).

        Raises:
            ValueError: if ``state`` is none that ``predict`` returned, or the encoder has no posterior.
        """
        return self._view.carried(state)

    def task_estimate(self, state: State) -> TaskEstimate:
        """Read the task, in its own units, off the ``state`` that ``predict`` returned, batch shape (n_envs,).

        For every encoder. The read-out was learned from the tasks of training beside the encoder.

        Raises:
            ValueError: if ``state`` is none that ``predict`` returned, or the agent has no read-out.

        Example:
            >>> action, state = model.predict(observation, state, episode_start)
            >>> print(model.task_estimate(state).texts()[0])
            velocity 1.91 ± 0.08 m/s
        """
        return self._view.read_task(self._view.remembered(state), self.task_labels)

    def infer_task(self, transitions: Transitions) -> TaskEstimate:
        """Read the task, in its own units, off any sequence of transitions: what ``infer`` is to ``belief``.

        Args:
            transitions: arrays or tensors (..., time, dim) in the env's own units, as ``infer`` takes them.

        Raises:
            ValueError: if an array has another shape or holds a number that is not finite, or the agent has no
                read-out.
        """
        return self._view.read_task(self._view.remember(transitions), self.task_labels)

    def predict_outcomes(
        self,
        belief: TaskBelief,
        observations: ArrayLike,
        actions: ArrayLike,
        next_observations: ArrayLike | None = None,
        n_samples: int = 1_000,
    ) -> Outcomes:
        """Draw samples of rewards and next observations in the env's own units, given a belief.

        Args:
            belief: from ``infer`` or ``belief``.
            observations: shape (..., observation_dim), the batch shape of ``belief``.
            actions: shape (..., action_dim), in the env's units.
            next_observations: where the actions led, for an encoder with ``condition_on_next``.
            n_samples: Monte Carlo samples, from which ``mean()`` and ``quantile(q)`` are taken.

        Raises:
            ValueError: if an array has another shape or holds a number that is not finite, or the encoder does not
                predict.
        """
        outcomes = self._view.outcomes(belief, observations, actions, next_observations, n_samples)
        check_question(observations, actions, next_observations)
        return outcomes

    def predict_moments(
        self,
        belief: TaskBelief,
        observations: ArrayLike,
        actions: ArrayLike,
        next_observations: ArrayLike | None = None,
    ) -> Moments:
        """Compute mean and standard deviation of reward and next observation in the env's own units, given a belief.

        It draws no samples, so a planner may ask often. A reward that is predicted given where the action led
        (``condition_on_next``, the default) is None unless that is known.

        Args:
            belief: from ``infer`` or ``belief``.
            observations: shape (..., observation_dim), the batch shape of ``belief``.
            actions: shape (..., action_dim), in the env's units.
            next_observations: where the actions led, if that is known.

        Raises:
            ValueError: if an array has another shape or holds a number that is not finite, or the encoder has no
                closed form, as without a kernel.
        """
        moments = self._view.moments(belief, observations, actions, next_observations)
        check_question(observations, actions, next_observations)
        return moments

    def task_probabilities(
        self, belief: TaskBelief, tasks: ArrayLike, log_prior: ArrayLike | None = None
    ) -> NDArray[np.float32]:
        """Compute how probable each of several candidate tasks is, given a belief.

        Args:
            belief: from ``infer`` or ``belief``, batch shape (...).
            tasks: the candidates, (n, task_dim), in the env's own units; any may be given, not only those of training.
            log_prior: log of their prior weights, (n,), up to a constant. None: all are alike.

        Returns:
            Probabilities (..., n), which sum to 1.

        Raises:
            ValueError: if an array has another shape, or the encoder does not know tasks.

        Example:
            >>> goals = model.get_env().get_attr("task_distribution")[0].tasks("train")
            >>> model.task_probabilities(model.belief(state), goals).argmax(axis=-1)
        """
        return self._view.task_probabilities(belief, tasks, log_prior)

    @property
    def _view(self) -> AgentView:
        return AgentView(self.policy, self._vec_normalize_env)

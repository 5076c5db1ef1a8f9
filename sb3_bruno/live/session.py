"""Lets an agent act in an environment, one step at a time, and its task be changed. Knows no browser."""

from __future__ import annotations

from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.algorithms.task_estimate import TaskEstimate
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders import Predicts
from sb3_bruno.evaluation.told import task_name
from sb3_bruno.live.surprise import surprise

NATS = 10.0
"""The evidence at which an agent forgets unless it is told otherwise: that of docs/method.md."""
_USUAL_RATE = 30.0  # steps in a second, of an environment that does not tell


class Moment(NamedTuple):
    """One step.

    Attributes:
        step: its number in the episode, from 1.
        task: the task that it was taken in, ``(task_dim,)``; None if the environment has none.
        task_name: what the environment calls it, or ``""``.
        reward: what it earned.
        episode_return: what the episode has earned so far.
        estimate: what the agent took the task for when it acted; None without a read-out.
        surprise: in nats, of the transition before; None after a reset, or if the encoder does not predict.
        evidence: the evidence for a switch so far, in nats; None if the agent does not forget.
    """

    step: int
    task: NDArray[np.float32] | None
    task_name: str
    reward: float
    episode_return: float
    estimate: TaskEstimate | None
    surprise: float | None
    evidence: float | None


class Session:
    """An agent that acts. It forgets where its encoder can notice a switch of the task.

    Args:
        model: the agent; any of SB3's algorithms, but only those with task inference tell what they believe.
        env: its environment, which may take a task by ``reset(options={"task": task})``.
        vec_normalize: the VecNormalize of training. Its statistics normalise the observations and stay as they are.
        seed: of the environment, and of actions that are drawn.

    Attributes:
        deterministic: whether the actor's mode is taken instead of a sample.
        is_paused: whether whoever calls ``step`` should wait.
        n_episodes: how many have begun.
        estimate: what the agent took the task for when it last acted, before the first step of an episode its prior;
            None without a read-out.
        no_readout: why there is none; "" if there is one.
    """

    def __init__(
        self, model: BaseAlgorithm, env: gym.Env[Any, Any], *, vec_normalize: VecNormalize | None = None, seed: int = 0
    ) -> None:
        self.model, self.env = model, env
        self.deterministic, self.is_paused, self.speed = True, False, 1.0
        self.n_episodes = 0
        self._prior: TaskEstimate | None = None  # until the first episode has begun
        self._vec_normalize = vec_normalize
        self._rng = np.random.default_rng(seed)
        set_random_seed(seed)
        self._begin(env.reset(seed=seed))
        if self.can_forget and self.forget_threshold is None:
            self.forget_threshold = NATS
        self._prior, self.no_readout = self._try_readout()
        self.estimate = self._prior

    def _begin(self, shown: tuple[Any, dict[str, Any]]) -> None:
        self._observation, self._info = shown
        self._state: Any = None
        self._is_over = False
        self.estimate = self._prior
        self._n_steps, self._return = 0, 0.0
        self.n_episodes += 1

    # -- what there is ---------------------------------------------------------------------------------------

    @property
    def task(self) -> NDArray[np.float32] | None:
        """Return the task, ``(task_dim,)``; None if the environment has none."""
        told = self._info.get("task")
        return None if told is None else np.asarray(told, dtype=np.float32)

    @property
    def task_name(self) -> str:
        """Return what the environment calls the task, or ``""``."""
        return task_name(self._info)

    @property
    def speed(self) -> float:
        """Return how many seconds of the environment should pass in one."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        if not 0.0 < speed < np.inf:
            raise ValueError(f"`speed={speed!r}` is no pace: give a positive number, 0.1 for slow motion.")
        self._speed = speed

    @property
    def seconds_per_step(self) -> float:
        """Return how long a step should last, in seconds on the clock."""
        return _seconds_of(self.env) / self.speed

    @property
    def can_forget(self) -> bool:
        """Return whether the agent can notice that the task has switched."""
        return isinstance(self.model, TaskInference) and isinstance(self.model.policy.encoder, Predicts)

    @property
    def forget_threshold(self) -> float | None:
        """Nats of evidence for another task at which the agent forgets; None: never."""
        return self.model.policy.forget_threshold if isinstance(self.model, TaskInference) else None

    @forget_threshold.setter
    def forget_threshold(self, nats: float | None) -> None:
        if not isinstance(self.model, TaskInference):
            raise ValueError(f"`forget_threshold={nats}` needs an agent that infers its task, not {type(self.model)}.")
        self.model.policy.forget_threshold = nats

    # -- acting ----------------------------------------------------------------------------------------------

    def step(self) -> Moment:
        """Take a step. If the last one ended the episode, another episode of the same task begins first."""
        if self._is_over:
            self.reset()
        seen, began = self._seen()
        before, task, name = self._state, self.task, self.task_name
        action, self._state = self.model.predict(
            seen, before, np.array([before is None]), deterministic=self.deterministic
        )
        shock = None if began or before is None else self._surprise(before, seen)
        evidence = self._evidence()
        if isinstance(self.model, TaskInference) and not self.no_readout:
            self.estimate = self.model.task_estimate(self._state)
        self._observation, reward, terminated, truncated, self._info = self.env.step(action)
        self._is_over = bool(terminated or truncated)
        self._n_steps += 1
        self._return += float(reward)
        return Moment(self._n_steps, task, name, float(reward), self._return, self.estimate, shock, evidence)

    def reset(self) -> None:
        """Begin a new episode of the same task, in which the agent starts from its prior."""
        self._begin(self.env.reset(options=None if self.task is None else {"task": self.task}))

    def set_task(self, task: ArrayLike) -> None:
        """Change the hidden task in mid-episode. The agent is told nothing.

        An environment that can take a task at a reset only begins a new episode.

        Raises:
            ValueError: if the environment has no tasks, or refuses this one; the task then stays.
        """
        if self.task is None:
            raise ValueError(f"{self.env} has no hidden task that could be set.")
        if self.env.has_wrapper_attr("switch_task") and not self._sets_task_at_reset():
            self._info = {**self._info, **self.env.get_wrapper_attr("switch_task")(task)}
        else:
            self._begin(self.env.reset(options={"task": np.asarray(task, dtype=np.float32)}))

    def draw_task(self) -> None:
        """Change the hidden task to a test task that the environment draws.

        Raises:
            ValueError: if the environment has no tasks.
        """
        if not self.env.has_wrapper_attr("task_distribution"):
            raise ValueError(f"{self.env} has no task_distribution to draw a task from.")
        self.set_task(self.env.get_wrapper_attr("task_distribution").draw(self._rng, "test"))

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    # -- parts -----------------------------------------------------------------------------------------------

    def _sets_task_at_reset(self) -> bool:
        return bool(getattr(self.env.unwrapped, "sets_task_at_reset", False))

    def _seen(self) -> tuple[Any, bool]:
        """Return the observation as in training, and whether no transition led to it."""
        began = isinstance(self._observation, dict) and bool(np.ravel(self._observation.get("episode_start", 0.0))[0])
        if self._vec_normalize is None:
            return self._observation, began
        return self._vec_normalize.normalize_obs(self._observation), began

    def _surprise(self, before: Any, seen: Any) -> float | None:
        return surprise(self.model.policy, before, seen) if isinstance(self.model, TaskInference) else None

    def _evidence(self) -> float | None:
        """Read the evidence, the last of what an agent that forgets carries."""
        return None if self.forget_threshold is None else float(np.ravel(self._state[-1])[0])

    def _try_readout(self) -> tuple[TaskEstimate | None, str]:
        """Return the read-out of the prior and ``""``, or None and why there is no read-out."""
        if not isinstance(self.model, TaskInference):
            return None, f"{type(self.model).__name__} does not infer its task, so there is no read-out."
        _, state = self.model.predict(self._seen()[0], None, deterministic=True)
        assert state is not None  # of an agent that infers its task, for mypy
        try:
            return self.model.task_estimate(state), ""
        except ValueError as error:
            return None, str(error)


def _seconds_of(env: gym.Env[Any, Any]) -> float:
    """Return how long a step of the environment lasts, in its own seconds."""
    duration = getattr(env.unwrapped, "dt", None)  # Gymnasium's MuJoCo environments have it
    if isinstance(duration, float | int) and duration > 0:
        return float(duration)
    rate = env.metadata.get("render_fps")
    return 1.0 / float(rate or _USUAL_RATE)

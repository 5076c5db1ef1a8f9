"""The rewards that a model earned on given tasks, and the numbers read from them. Knows NumPy, JSON and rliable."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sb3_bruno.evaluation.floats import Floats, mean_of_known
from sb3_bruno.evaluation.interquartile import Interval, interquartile_mean
from sb3_bruno.files.whole import whole_file
from sb3_bruno.task_names import ALL_TASKS, task_labels


@dataclass(frozen=True, eq=False)
class AdaptationResult:
    """The reward at every step of every episode, and how the rewards were made.

    Args:
        tasks: the hidden tasks, ``(n_tasks, task_dim)``.
        rewards: the environment's own rewards, ``(n_tasks, n_episodes, horizon)``, NaN after an episode's end. They
            have single precision, as SB3's VecEnv delivers them; sums and means have double precision.
        config: settings that tell this result from others; JSON values only (a tuple becomes a list).
        seed: the seed of the environments.
        versions: the versions of the libraries that made the result.
        names: what the environment calls each task, ``""`` for nothing; None if it has no names.
        successes: whether each episode ended in success, ``(n_tasks, n_episodes)``, 1, 0 or a share between, NaN where
            the environment does not tell; None if it never does.

    Raises:
        TypeError: if tasks, rewards or successes are no numbers, or ``seed``, ``versions`` or ``names`` are of a wrong
            kind.
        ValueError: if the shapes disagree, a task is not finite, a reward is infinite or follows a NaN, a success is
            outside [0, 1], or ``config`` is not JSON.
    """

    tasks: Floats
    rewards: NDArray[np.float32]
    config: dict[str, Any] = field(default_factory=dict)
    seed: int = 0
    versions: dict[str, str] = field(default_factory=dict)
    names: list[str] | None = None
    successes: Floats | None = None

    def __post_init__(self) -> None:
        _check_kinds(self)
        object.__setattr__(self, "tasks", np.asarray(self.tasks, dtype=np.float64))
        object.__setattr__(self, "rewards", np.asarray(self.rewards, dtype=np.float32))
        object.__setattr__(self, "config", _as_json(self.config))
        _check_shapes(self.tasks, self.rewards)
        ended = np.isnan(self.rewards)
        reborn = ended[..., :-1] & ~ended[..., 1:]
        if not np.isfinite(self.tasks).all():
            raise ValueError("tasks must be finite numbers: check the environment.")
        if ended[..., 0].any() or reborn.any() or np.isinf(self.rewards).any():
            raise ValueError("rewards must be finite, and NaN only after an episode's end: check the environment.")
        if self.names is not None and len(self.names) != len(self.tasks):
            raise ValueError(f"names has {len(self.names)} entries for {len(self.tasks)} tasks: give one for each.")
        if self.successes is not None:
            object.__setattr__(self, "successes", _as_successes(self.successes, self.rewards.shape[:2]))

    @property
    def labels(self) -> list[str]:
        """What each task is called in tables, figures and logs; all are different."""
        return task_labels(self.tasks, self.names)

    @property
    def horizon(self) -> int:
        """The length of the longest episode, in steps."""
        return int(self.rewards.shape[2])

    def returns(self, horizon: int | None = None) -> Floats:
        """Sum the rewards of the first ``horizon`` steps, ``(n_tasks, n_episodes)``; None takes all steps.

        An episode that ended earlier has the sum of its own steps.

        Raises:
            ValueError: if ``horizon`` is not in ``1 .. self.horizon``.
        """
        horizon = self.horizon if horizon is None else horizon
        if not 1 <= horizon <= self.horizon:
            raise ValueError(f"horizon={horizon} is outside 1 .. {self.horizon}, the recorded steps: evaluate longer.")
        sums: Floats = np.nansum(self.rewards[..., :horizon], axis=-1, dtype=np.float64)
        return sums

    def returns_per_episode(self, n_episodes: int) -> Floats:
        """Compute the return of each inner episode of a trial, ``(n_tasks, n_trials, n_episodes)``.

        Cuts each trial into ``n_episodes`` parts of equal length. So the inner episodes may end by a time limit only.

        Args:
            n_episodes: inner episodes of each trial.

        Example:
            Rewards 0, 1, 2, 3 and ``n_episodes=2``: the returns are 1 and 5.

        Raises:
            ValueError: if ``n_episodes`` is not positive or does not divide the horizon, or a trial ended early.
        """
        if n_episodes < 1 or self.horizon % n_episodes:
            raise ValueError(
                f"n_episodes={n_episodes} does not cut {self.horizon} steps evenly: give what Trial was given."
            )
        if np.isnan(self.rewards).any():
            raise ValueError(
                f"n_episodes={n_episodes} cannot cut trials that ended early: give them a time limit alone."
            )
        parts = self.rewards.reshape(*self.rewards.shape[:2], n_episodes, -1)
        sums: Floats = parts.sum(axis=-1, dtype=np.float64)
        return sums

    def mean_return(self, horizon: int | None = None) -> Floats:
        """Average the return of each task over its episodes, ``(n_tasks,)``."""
        means: Floats = self.returns(horizon).mean(axis=1)
        return means

    def iqm(self, horizon: int | None = None, *, n_resamples: int = 2_000, seed: int = 0) -> Interval:
        """Compute the interquartile mean over all episodes of all tasks, with its 95 % interval.

        The interval says how well these episodes measure this model on these tasks. It does not say how models of other
        training seeds would do. Needs the ``plots`` extra.
        """
        return interquartile_mean(self.returns(horizon).T, n_resamples=n_resamples, seed=seed)

    def success_rates(self) -> Floats:
        """Take the share of each task's episodes that ended in success, ``(n_tasks,)``; NaN where none tells.

        Raises:
            ValueError: if the environment never says whether an episode was a success.
        """
        if self.successes is None:
            raise ValueError('No episode says whether it was a success: let its last info hold "is_success".')
        return mean_of_known(self.successes, axis=1)

    def success_rate(self) -> float:
        """Take the mean of ``success_rates`` over the tasks that tell."""
        return float(mean_of_known(self.success_rates()))

    def mean_rewards(self) -> Floats:
        """Average the reward at each step over the episodes still running, ``(n_tasks, horizon)``; NaN if none is."""
        return mean_of_known(self.rewards, axis=1)

    def steps_to_steady(self, fraction: float = 0.9, *, window: int = 5) -> NDArray[np.int64]:
        """Count the steps until each task's reward is nearly steady, ``(n_tasks,)``; 0 means from the start.

        Let ``r`` be the mean reward at each step, and ``R`` the steady reward: the mean of ``r`` over the last half of
        the steps. The result is the first ``t`` at which ``mean(r[t : t + window])`` has covered ``fraction`` of the
        way from ``r[0]`` to ``R``. So neither the sign of the rewards nor the direction of the way matters. Averaging
        over the window smooths out the oscillation of a gait, and the result may be early by up to half a window. The
        time that the body needs to accelerate counts too, so compare with an oracle's.

        Args:
            fraction: the part of the way to cover.
            window: steps to average over, ahead of each step.

        Example:
            Rewards -4, -4, -1, -1, -1, -1 and ``window=1``: R = -1, and step 2 is the first at or above -1.3.

        Raises:
            ValueError: if ``fraction`` is not between 0 and 1, or ``window`` not positive.
        """
        if not 0.0 < fraction < 1.0:
            raise ValueError(f"fraction={fraction} is not between 0 and 1: give the part of the way, such as 0.9.")
        if window < 1:
            raise ValueError(f"window={window} is not positive: give a number of steps, 1 for no smoothing.")
        return np.array([_steps_to_steady(curve, fraction, window) for curve in self.mean_rewards()])

    def summary(self, horizon: int | None = None) -> str:
        """Write a table of the returns over the first ``horizon`` steps: a row per task, then all together."""
        returns, steps = self.returns(horizon), self.steps_to_steady()
        rows = [*zip(self.labels, returns, steps, strict=True), (ALL_TASKS, returns, steps)]
        width = max(4, *(len(label) for label, _, _ in rows))
        n_tasks, n_episodes = returns.shape
        rates = [""] * (n_tasks + 2)  # a column, head first
        if self.successes is not None:
            rates = ["  success", *(f"{100 * rate:>7.0f} %" for rate in (*self.success_rates(), self.success_rate()))]
        lines = [
            f"Returns over {horizon or self.horizon} steps: {n_tasks} tasks, {n_episodes} episodes each",
            f"{'task':<{width}} {'mean':>10} {'lowest':>10} {'highest':>10} {'steps to 90 %':>14}{rates[0]}",
        ]
        for (label, row, step), rate in zip(rows, rates[1:], strict=True):
            numbers = f"{row.mean():>10.2f} {row.min():>10.2f} {row.max():>10.2f} {np.mean(step):>14.1f}"
            lines.append(f"{label:<{width}} {numbers}{rate}")
        value, low, high = self.iqm(horizon)
        lines.append(f"interquartile mean {value:.2f}, 95 % interval {low:.2f} to {high:.2f} over episodes")
        return "\n".join(lines)

    def save(self, path: str | Path) -> None:
        """Write the result as JSON from which ``load`` reads exactly the same numbers; NaN is written as null."""
        successes = None if self.successes is None else _nan_as_none(self.successes)
        arrays = {"tasks": self.tasks.tolist(), "rewards": _nan_as_none(self.rewards), "successes": successes}
        document = asdict(self) | arrays
        with whole_file(path) as part:
            part.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: str | Path) -> AdaptationResult:
        """Read what ``save`` wrote.

        Raises:
            ValueError: if the file holds no such result.
        """
        try:
            return cls(**json.loads(Path(path).read_text(encoding="utf-8")))
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"path={str(path)!r} holds no AdaptationResult ({error}): give a file that save() wrote."
            ) from error


def _check_kinds(result: AdaptationResult) -> None:
    """Raise a TypeError unless a result holds numbers, and the versions of libraries by name."""
    for name in ("tasks", "rewards", "successes"):
        values = np.array(getattr(result, name), dtype=object).ravel().tolist()
        wrong = [value for value in values if not isinstance(value, Real | None)]
        if wrong:
            raise TypeError(f"{name} hold {wrong[0]!r:.60}, which is no number: give numbers alone.")
    seed: Any = result.seed
    if not isinstance(seed, Integral):
        raise TypeError(f"seed={seed!r:.60} is no whole number: give one.")
    names: Any = result.names
    if names is not None and not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        raise TypeError(f"names={names!r:.60} are no texts: give a list of what the environment calls its tasks.")
    versions: Any = result.versions
    if not isinstance(versions, Mapping) or not all(isinstance(text, str) for text in (*versions, *versions.values())):
        raise TypeError(f"versions={versions!r:.60} are no texts by name: give what library_versions() returns.")


def _as_successes(successes: Floats, shape: tuple[int, ...]) -> Floats:
    """Return successes as an array; raise a ValueError unless there is one of each episode, in [0, 1] or NaN."""
    array = np.asarray(successes, dtype=np.float64)
    if array.shape != shape or (array < 0.0).any() or (array > 1.0).any():
        raise ValueError(
            f"successes of shape {array.shape} are of no use: give 0 to 1, or NaN, for each episode, {shape}."
        )
    return array


def _check_shapes(tasks: Floats, rewards: NDArray[np.float32]) -> None:
    """Raise a ValueError unless both arrays have the shapes that AdaptationResult needs."""
    if tasks.ndim != 2 or rewards.ndim != 3 or len(tasks) != len(rewards) or rewards.size == 0:
        raise ValueError(
            f"tasks have shape {tasks.shape} and rewards {rewards.shape}: "
            "give (n_tasks, task_dim) and (n_tasks, n_episodes, horizon), none of them empty."
        )


def _as_json(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``config`` as JSON keeps it; raise a ValueError if JSON cannot."""
    try:
        kept: dict[str, Any] = json.loads(json.dumps(dict(config), allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"config={config!r} is not JSON ({error}): keep strings, finite numbers and lists.") from error
    return kept


def _nan_as_none(values: NDArray[np.float32]) -> list[Any]:
    """Return nested lists of the shortest decimals that read back exactly, with None for NaN, which JSON lacks."""
    shortest = values.astype(str).astype(np.float64)  # 0.1, not float32's 0.10000000149011612
    flat = [None if math.isnan(value) else value for value in shortest.ravel().tolist()]
    nested: list[Any] = np.array(flat, dtype=object).reshape(values.shape).tolist()
    return nested


def _steps_to_steady(curve: Floats, fraction: float, window: int) -> int:
    """Compute ``AdaptationResult.steps_to_steady`` from the mean rewards of one task, ``(horizon,)``."""
    curve = curve[~np.isnan(curve)]
    way = curve[len(curve) // 2 :].mean() - curve[0]
    if way == 0.0:
        return 0
    ahead = np.array([curve[t : t + window].mean() for t in range(len(curve))])  # shorter windows at the end
    return int(np.argmax((ahead - curve[0]) / way >= fraction))

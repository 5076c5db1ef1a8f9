"""What diagnostics of a belief found, and the numbers read from it; knows numpy, and scipy where it is used."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Diagnostics:
    """What ``diagnose`` measured. After an episode's end, everything is NaN.

    Args:
        tasks: the hidden tasks, ``(n_tasks, task_dim)``.
        quantities: names of what is modelled, the reward first if it is; of next observations the changes,
            ``(n_quantities,)``.
        pit: probability integral transforms of the modelled quantities under the one-step predictive, uniform if
            that is the truth, ``(n_tasks, n_episodes, n_steps, n_quantities)``.
        distance_levels: the same of each set's squared Mahalanobis distance, one per latent dimension, or one per
            scale that dimensions share, ``(n_tasks, n_episodes, n_scales)``.
        bounds: on the log-density of each transition given those before it, in nats,
            ``(n_tasks, n_episodes, horizon)``.
        beliefs: posterior means after 0, 1, ... transitions on their two principal axes,
            ``(n_tasks, n_episodes, horizon + 1, 2)``.
        explained: the share of all variance of the posterior means that lies on each of these axes, ``(2,)``.
        real: the first quantity in each task's first episode, ``(n_tasks, horizon)``.
        predicted: its predictive mean and the ends of the central 90 % interval, ``(3, n_tasks, horizon)``.
        outside_tasks: tasks that the agent should not know, ``(n_outside, task_dim)``, or None.
        outside_bounds: the bounds on these, ``(n_outside, n_episodes, their horizon)``, or None.

    Raises:
        ValueError: if only one of ``outside_tasks`` and ``outside_bounds`` is None.
    """

    tasks: Floats
    quantities: NDArray[np.str_]
    pit: Floats
    distance_levels: Floats
    bounds: Floats
    beliefs: Floats
    explained: Floats
    real: Floats
    predicted: Floats
    outside_tasks: Floats | None = None
    outside_bounds: Floats | None = None

    def __post_init__(self) -> None:
        if (self.outside_tasks is None) != (self.outside_bounds is None):
            missing = "outside_tasks" if self.outside_tasks is None else "outside_bounds"
            raise ValueError(f"{missing} is None while the other is not: give both or neither.")

    def pit_ks(self) -> Floats:
        """How far each quantity's PIT is from uniform: the Kolmogorov-Smirnov distance, ``(n_quantities,)``."""
        return _distances_from_uniform(self.pit)

    def distance_ks(self) -> Floats:
        """The same of ``distance_levels``, ``(n_scales,)``; with few episodes it is large by chance."""
        return _distances_from_uniform(self.distance_levels)

    def coverage(self, level: float) -> Floats:
        """The share of each quantity's values inside the central interval of ``level``, ``(n_quantities,)``.

        Raises:
            ValueError: if ``level`` is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise ValueError(f"level={level} is not between 0 and 1: give the interval's probability, such as 0.9.")
        known = ~np.isnan(self.pit)
        inside = known & (np.abs(self.pit - 0.5) <= level / 2)
        shares: Floats = inside.sum(axis=(0, 1, 2)) / known.sum(axis=(0, 1, 2))
        return shares

    def scores(self) -> Floats:
        """How strange each episode is: minus its mean bound, in nats per transition, ``(n_tasks, n_episodes)``."""
        return _scores(self.bounds)

    def outside_scores(self) -> Floats:
        """The same of the outside episodes, ``(n_outside, n_episodes)``.

        Raises:
            ValueError: if there are none.
        """
        if self.outside_bounds is None:
            raise ValueError("outside_bounds is None, so nothing is there to alarm: pass outside_tasks to diagnose.")
        return _scores(self.outside_bounds)

    def auroc(self) -> float:
        """The chance that an outside episode is stranger than an inside one; 0.5 is that of a coin.

        The area under the ROC curve, as the Mann-Whitney statistic.

        Raises:
            ValueError: if there are no outside episodes.
        """
        from scipy.stats import mannwhitneyu

        inside, outside = self.scores().ravel(), self.outside_scores().ravel()
        return float(mannwhitneyu(outside, inside).statistic) / (inside.size * outside.size)

    def numbers(self) -> dict[str, float]:
        """Scalars for a log; a mean over quantities or scales comes with the worst of them."""
        pit_ks, distance_ks = self.pit_ks(), self.distance_ks()
        horizon = self.bounds.shape[-1]
        numbers = {
            "pit_ks": pit_ks.mean(),
            "pit_ks_worst": pit_ks.max(),
            "coverage_50": self.coverage(0.5).mean(),
            "coverage_90": self.coverage(0.9).mean(),
            "distance_ks": distance_ks.mean(),
            "distance_ks_worst": distance_ks.max(),
            "bound_nats": np.nanmean(self.bounds),
            "bound_nats_first_step": np.nanmean(self.bounds[..., 0]),
            "bound_nats_second_half": np.nanmean(self.bounds[..., horizon // 2 :]),
        }
        if self.outside_bounds is not None:
            numbers["auroc"] = self.auroc()
        return {name: float(value) for name, value in numbers.items()}

    def summary(self) -> str:
        """The same numbers in words, and each quantity's calibration."""
        numbers = self.numbers()
        n_tasks, n_episodes, horizon = self.bounds.shape
        width = max(8, *(len(name) for name in self.quantities))
        lines = [
            f"{n_tasks} tasks, {n_episodes} episodes each, up to {horizon} steps",
            f"{'quantity':<{width}} {'KS distance':>12} {'within 50 %':>12} {'within 90 %':>12}",
        ]
        rows = zip(self.quantities, self.pit_ks(), self.coverage(0.5), self.coverage(0.9), strict=True)
        lines += [f"{name:<{width}} {ks:>12.3f} {half:>12.1%} {most:>12.1%}" for name, ks, half, most in rows]
        lines += [
            f"sets of transitions: KS distance {numbers['distance_ks']:.3f}, worst {numbers['distance_ks_worst']:.3f}",
            f"bound {numbers['bound_nats']:.3f} nats per transition: {numbers['bound_nats_first_step']:.3f} at first, "
            f"{numbers['bound_nats_second_half']:.3f} in the second half",
        ]
        if self.outside_tasks is not None:
            lines.append(f"outside tasks: {len(self.outside_tasks)}, told from these with AUROC {numbers['auroc']:.3f}")
        return "\n".join(lines)

    def save(self, path: str | Path) -> None:
        """Write everything as npz, exactly; the name is taken as it is."""
        arrays = {one.name: getattr(self, one.name) for one in fields(self)}
        with Path(path).open("wb") as file:
            np.savez_compressed(
                file, allow_pickle=False, **{key: one for key, one in arrays.items() if one is not None}
            )

    @classmethod
    def load(cls, path: str | Path) -> Diagnostics:
        """Read what ``save`` wrote.

        Raises:
            ValueError: if the file is not such a result.
        """
        try:
            with np.load(path, allow_pickle=False) as stored:
                return cls(**stored)
        except (OSError, TypeError, ValueError, zipfile.BadZipFile) as error:
            raise ValueError(f"path={str(path)!r} holds no Diagnostics: give a file that save() wrote.") from error


def _distances_from_uniform(levels: Floats) -> Floats:
    """The Kolmogorov-Smirnov distance of each entry of the last axis from uniform, NaN left out."""
    from scipy.stats import kstest

    columns = levels.reshape(-1, levels.shape[-1]).T
    return np.array([kstest(column[~np.isnan(column)], "uniform").statistic for column in columns])


def _scores(bounds: Floats) -> Floats:
    scores: Floats = -np.nanmean(bounds, axis=-1)
    return scores

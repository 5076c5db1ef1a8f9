"""What diagnostics of a belief measured, and the numbers read from it. Knows NumPy, and SciPy where it is used."""

from __future__ import annotations

import zipfile
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sb3_bruno.diagnostics.verdict import SOON, verdict
from sb3_bruno.evaluation.floats import Floats
from sb3_bruno.files.whole import whole_file


@dataclass(frozen=True, eq=False)
class Diagnostics:
    """What ``diagnose`` measured. After the end of an episode, every entry is NaN.

    Args:
        tasks: the hidden tasks, ``(n_tasks, task_dim)``.
        quantities: names of the modelled quantities, ``(n_quantities,)``: the reward, then the change of each entry of
            the observation, as far as the encoder models them and they vary.
        pit: probability integral transforms (PIT) of the modelled quantities under the one-step predictive,
            ``(n_tasks, n_episodes, n_steps, n_quantities)``; uniform if the predictive is right.
        log_scores: the log-density of each transition given those before it, in nats,
            ``(n_tasks, n_episodes, horizon)``.
        beliefs: posterior means after 0, 1, ... transitions, on their two principal axes,
            ``(n_tasks, n_episodes, horizon + 1, 2)``.
        explained: the share of the posterior means' variance on each of the two axes, ``(2,)``.
        real: the first quantity in the first episode of each task, ``(n_tasks, horizon)``.
        predicted: the predictive mean of that quantity and the ends of its central 90 % interval,
            ``(3, n_tasks, horizon)``.
        distance_levels: PIT of the squared Mahalanobis distance of each episode's set of transitions,
            ``(n_tasks, n_episodes, n_scales)``; there is a scale per latent dimension, or one that all share. None if
            the encoder measures no distance.
        outside_tasks: tasks that the agent should not know, ``(n_outside, task_dim)``, or None.
        outside_log_scores: those of the outside tasks, ``(n_outside, n_episodes, outside_horizon)``, or None.
        names: what the environment calls the tasks, ``(n_tasks,)``, ``""`` for nothing; None if it has no names.
        readout_entries: what the read-out's misses are of, with their units, ``(n_entries,)``: the entries of the task,
            or the probability of the true task where tasks are few. None if the agent has no read-out.
        readout_misses: how far the read-out is off after 0, 1, ... transitions,
            ``(n_tasks, n_episodes, horizon + 1, n_entries)``: from the task in its own units, or 1 minus that
            probability; None without a read-out.
        readout_holds: 1 where the read-out's 90 % interval holds the entry, or where its likeliest task is the true
            one, else 0, of the shape of ``readout_misses``; None without a read-out.

    Raises:
        ValueError: if only one of ``outside_tasks`` and ``outside_log_scores`` is None, or nothing was measured.
    """

    tasks: Floats
    quantities: NDArray[np.str_]
    pit: Floats
    log_scores: Floats
    beliefs: Floats
    explained: Floats
    real: Floats
    predicted: Floats
    distance_levels: Floats | None = None
    outside_tasks: Floats | None = None
    outside_log_scores: Floats | None = None
    names: NDArray[np.str_] | None = None
    readout_entries: NDArray[np.str_] | None = None
    readout_misses: Floats | None = None
    readout_holds: Floats | None = None

    def __post_init__(self) -> None:
        if (self.outside_tasks is None) != (self.outside_log_scores is None):
            missing = "outside_tasks" if self.outside_tasks is None else "outside_log_scores"
            raise ValueError(f"{missing} is None while the other is not: give both or neither.")
        for name in ("pit", "log_scores"):
            if np.isnan(getattr(self, name)).all(axis=(0, 1, 2)).any():
                raise ValueError(f"{name} holds nothing but NaN: diagnose episodes of one step at least.")

    def pit_ks(self) -> Floats:
        """Compute the Kolmogorov-Smirnov distance of each quantity's PIT from uniform, ``(n_quantities,)``."""
        return _distances_from_uniform(self.pit)

    def distance_ks(self) -> Floats:
        """Compute that distance for ``distance_levels``, ``(n_scales,)``; with few episodes, chance makes it large.

        Raises:
            ValueError: if there are none.
        """
        if self.distance_levels is None:
            raise ValueError("distance_levels is None: diagnose an encoder with the ability MeasuresDistance.")
        return _distances_from_uniform(self.distance_levels)

    def coverage(self, level: float) -> Floats:
        """Compute the share of each quantity's values in the central predictive interval, ``(n_quantities,)``.

        Args:
            level: the probability of the interval.

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
        """Score how strange each episode is: minus its mean log score in nats, ``(n_tasks, n_episodes)``."""
        return _scores(self.log_scores)

    def outside_scores(self) -> Floats:
        """Score the outside episodes in the same way, ``(n_outside, n_episodes)``.

        Raises:
            ValueError: if there are no outside episodes.
        """
        if self.outside_log_scores is None:
            raise ValueError(
                "outside_log_scores is None, so there is nothing to score: pass outside_tasks to diagnose."
            )
        return _scores(self.outside_log_scores)

    def auroc(self) -> float:
        """Compute the probability that an outside episode scores as stranger than an inside episode.

        This is the area under the ROC curve, computed as the Mann-Whitney statistic. A coin has 0.5.

        Raises:
            ValueError: if there are no outside episodes.
        """
        from scipy.stats import mannwhitneyu

        inside, outside = self.scores().ravel(), self.outside_scores().ravel()
        return float(mannwhitneyu(outside, inside).statistic) / (inside.size * outside.size)

    def numbers(self) -> dict[str, float]:
        """Return scalars for a log; each mean over quantities or scales comes with the worst of them."""
        pit_ks = self.pit_ks()
        horizon = self.log_scores.shape[-1]
        numbers = {
            "pit_ks": pit_ks.mean(),
            "pit_ks_worst": pit_ks.max(),
            "coverage_50": self.coverage(0.5).mean(),
            "coverage_90": self.coverage(0.9).mean(),
            "log_score": np.nanmean(self.log_scores),
            "log_score_first_step": np.nanmean(self.log_scores[..., 0]),
            "log_score_second_half": np.nanmean(self.log_scores[..., horizon // 2 :]),
        }
        if self.distance_levels is not None:
            distance_ks = self.distance_ks()
            numbers |= {"distance_ks": distance_ks.mean(), "distance_ks_worst": distance_ks.max()}
        if self.outside_log_scores is not None:
            numbers["auroc"] = self.auroc()
        if self.readout_misses is not None and self.readout_holds is not None:
            soon = min(SOON, horizon)
            numbers["readout_miss_at_first"] = np.nanmean(self.readout_misses[:, :, 0])
            numbers["readout_miss"] = np.nanmean(self.readout_misses[:, :, soon])
            numbers["readout_holds"] = np.nanmean(self.readout_holds[:, :, soon:])
        return {name: float(value) for name, value in numbers.items()}

    def summary(self) -> str:
        """Write the numbers in words, with the calibration of each quantity, and a verdict at the end."""
        numbers = self.numbers()
        n_tasks, n_episodes, horizon = self.log_scores.shape
        width = max(8, *(len(name) for name in self.quantities))
        lines = [
            f"{n_tasks} tasks, {n_episodes} episodes each, up to {horizon} steps",
            f"{'quantity':<{width}} {'KS distance':>12} {'within 50 %':>12} {'within 90 %':>12}",
        ]
        rows = zip(self.quantities, self.pit_ks(), self.coverage(0.5), self.coverage(0.9), strict=True)
        lines += [f"{name:<{width}} {ks:>12.3f} {half:>12.1%} {most:>12.1%}" for name, ks, half, most in rows]
        if self.distance_levels is not None:
            mean, worst = numbers["distance_ks"], numbers["distance_ks_worst"]
            lines.append(f"sets of transitions: KS distance {mean:.3f}, worst {worst:.3f}")
        lines += [
            f"log score {numbers['log_score']:.3f} nats per transition: {numbers['log_score_first_step']:.3f} "
            f"at first, {numbers['log_score_second_half']:.3f} in the second half",
        ]
        if self.outside_tasks is not None:
            lines.append(f"outside tasks: {len(self.outside_tasks)}, told from these with AUROC {numbers['auroc']:.3f}")
        return "\n".join([*lines, f"Verdict: {verdict(self)}"])

    def save(self, path: str | Path) -> None:
        """Write all arrays as npz, exactly; ``path`` gets no suffix."""
        arrays = {field.name: getattr(self, field.name) for field in fields(self)}
        known = {name: array for name, array in arrays.items() if array is not None}
        with whole_file(path) as part, part.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **known)

    @classmethod
    def load(cls, path: str | Path) -> Diagnostics:
        """Read what ``save`` wrote.

        Raises:
            ValueError: if the file holds no such result.
        """
        try:
            with np.load(path, allow_pickle=False) as stored:
                return cls(**stored)
        except (OSError, TypeError, ValueError, zipfile.BadZipFile) as error:
            raise ValueError(f"path={str(path)!r} holds no Diagnostics: give a file that save() wrote.") from error


def _distances_from_uniform(levels: Floats) -> Floats:
    """Compute the Kolmogorov-Smirnov distance from uniform for each entry of the last axis, without NaN."""
    from scipy.stats import kstest

    columns = levels.reshape(-1, levels.shape[-1]).T
    return np.array([kstest(column[~np.isnan(column)], "uniform").statistic for column in columns])


def _scores(log_scores: Floats) -> Floats:
    """Return minus the mean over an episode's steps, without NaN: ``(..., horizon)`` to ``(...)``."""
    scores: Floats = -np.nanmean(log_scores, axis=-1)
    return scores

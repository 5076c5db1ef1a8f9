"""Measures how far an agent's beliefs can be trusted: calibration, strangeness and predictions, on its own episodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch as th
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.algorithms.beliefs import AgentView, TaskBelief
from sb3_bruno.algorithms.task_estimate import TaskEstimate, TaskLabels
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.diagnostics.readout import compare_readout
from sb3_bruno.diagnostics.result import Diagnostics
from sb3_bruno.encoders import HasPosterior, MeasuresDistance, Predicts, TaskEncoder, Transitions
from sb3_bruno.encoders.abilities import check_ability
from sb3_bruno.encoders.base import map_memory
from sb3_bruno.evaluation.episodes import Episode, pad_episodes, play_episodes
from sb3_bruno.evaluation.floats import Floats
from sb3_bruno.evaluation.progress import progress

__all__ = ["Diagnostics", "diagnose"]

N_SAMPLES = 99  # of the predictive: ranks 0 to 99 among them
N_SCORED = 50  # steps of an episode whose PIT is taken, at most
N_CONTEXT = 20  # transitions of the sets whose distance is taken, at most
INTERVAL = (0.05, 0.95)  # the ends of the 90 % interval


def diagnose(
    model: TaskInference,
    make_env: Callable[[], gym.Env[Any, Any]],
    tasks: ArrayLike,
    *,
    n_episodes: int = 10,
    seed: int = 0,
    vec_normalize: VecNormalize | None = None,
    outside_tasks: ArrayLike | None = None,
    progress_bar: bool = False,
) -> Diagnostics:
    """Let the deterministic agent act, on new episodes, and compare what it believed with what came.

    - Calibration: each modelled quantity's rank among samples of its predictive given the transitions before it, at
      up to 50 steps spread over the episode. Beliefs and predictions are the agent's own, so the noise that augments
      their context is zero; a policy that may forget is taken as one that does not.
    - Distance: beta_n of up to 20 transitions spread over the episode, against chi-squared or F, where the encoder
      ``MeasuresDistance``. The model takes transitions of one task for independent given the task, and neighbours in
      an agent's stream are not. So the whole episode would show the correlation and not the model; these few show less
      of it, not none.
    - Log scores: of every transition given those before it. Like the distances, with noise drawn.
    - Read-out, where the agent has one: how far it is off the task after each step, and whether its intervals hold it.
    - Alarm: minus the mean log score of an episode. On trained agents the tail of beta_n told less: it asks only
      whether the latents fit together. An episode more regular than expected scores low and raises no alarm.

    All random numbers come from ``seed``; torch's own state is as it was before. Needs the ``plots`` extra, for SciPy.

    Args:
        model: the agent; its encoder has the abilities ``HasPosterior`` and ``Predicts``.
        make_env: makes one environment with a time limit, as for ``evaluate_adaptation``.
        tasks: the tasks to give at reset, ``(n_tasks, task_dim)``.
        n_episodes: per task, inside and outside.
        seed: of the environments and samples; the outside episodes have the next one.
        vec_normalize: the training environment's, whose statistics normalise the observations; not updated.
        outside_tasks: tasks that should raise the alarm, ``(n_outside, task_dim)``.
        progress_bar: show one, where stderr is a terminal.

    Returns:
        The measurements; ``summary()`` and ``plot_diagnostics`` show them.

    Raises:
        ValueError: if the encoder lacks an ability, or as ``play_episodes``.
    """
    encoder = model.policy.encoder
    check_diagnosable(encoder)

    def play(tasks: ArrayLike, seed: int) -> list[list[Episode]]:
        return play_episodes(
            model,
            make_env,
            tasks,
            n_episodes=n_episodes,
            seed=seed,
            vec_normalize=vec_normalize,
            progress_bar=progress_bar,
        )

    inside = play(tasks, seed)
    outside = None if outside_tasks is None else play(outside_tasks, seed + 1)
    view, rng = AgentView(model.policy, vec_normalize), np.random.default_rng(seed)
    with th.no_grad(), th.random.fork_rng([model.device] if model.device.type == "cuda" else []):
        th.manual_seed(seed)
        sequences = _pad(inside)
        compared = progress(sequences, shown=progress_bar, about="tasks")
        findings = [_compare(view, of_task, rng, model.task_labels) for of_task in compared]
        varies = _varying(findings)
        beliefs, explained = _principal_axes(np.stack([found.means for found in findings]))
        levels = None
        if isinstance(encoder, MeasuresDistance):
            levels = np.array([[_levels(view, encoder, episode) for episode in of_task] for of_task in inside])
        return Diagnostics(
            tasks=np.asarray(tasks, dtype=np.float64),
            quantities=np.array(findings[0].quantities)[varies],
            pit=np.stack([found.pit for found in findings])[..., varies],
            distance_levels=levels,
            log_scores=_log_scores(view, sequences),
            beliefs=beliefs,
            explained=explained,
            real=np.stack([found.real for found in findings]),
            predicted=np.stack([found.predicted for found in findings], axis=1),
            outside_tasks=None if outside is None else np.asarray(outside_tasks, dtype=np.float64),
            outside_log_scores=None if outside is None else _log_scores(view, _pad(outside)),
            names=np.array([of_task[0].task_name for of_task in inside]),
            **_of_readout(np.asarray(tasks, dtype=np.float64), findings),
        )


def check_diagnosable(encoder: TaskEncoder) -> None:
    """Refuse an encoder that ``diagnose`` cannot work with.

    Raises:
        ValueError: naming the ability that it lacks.
    """
    for ability in (HasPosterior, Predicts):
        check_ability(encoder, ability, "`diagnose`")


class _Comparison(NamedTuple):
    """What was believed and predicted in the episodes of one task, beside what came.

    Attributes:
        quantities: names of what is modelled.
        pit: (n_episodes, n_steps, n_quantities).
        bounds: the least and the greatest of each quantity, (2, n_quantities).
        means: posterior means, (n_episodes, horizon + 1, latent_dim).
        real: the first quantity in the first episode, (horizon,).
        predicted: its predictive mean and the ends of the interval, (3, horizon).
        estimate: what the read-out took the task for, batch shape (n_episodes, horizon + 1); None without one.
    """

    quantities: list[str]
    pit: Floats
    bounds: Floats
    means: Floats
    real: Floats
    predicted: Floats
    estimate: TaskEstimate | None


def _varying(findings: Sequence[_Comparison]) -> NDArray[np.bool_]:
    """Say which quantities vary, (n_quantities,): one that never does is always predicted, and tells nothing.

    The first counts whatever it does, for the figure shows it.
    """
    least, greatest = np.stack([found.bounds for found in findings]).swapaxes(0, 1)
    varies: NDArray[np.bool_] = greatest.max(axis=0) > least.min(axis=0)
    varies[0] = True
    return varies


class _Sequences(NamedTuple):
    """The episodes of one task, padded with NaN.

    Attributes:
        transitions: arrays (n_episodes, horizon, dim).
        absorbed: 1 where the agent was shown the transition, 0 at an inner end of a trial, (n_episodes, horizon).
    """

    transitions: Transitions
    absorbed: Floats


def _pad(episodes: Sequence[Sequence[Episode]]) -> list[_Sequences]:
    """Pad the episodes of each task to the longest of all."""
    every = [_transitions(episode) for of_task in episodes for episode in of_task]
    columns = [np.split(pad_episodes(column), len(episodes)) for column in zip(*every, strict=True)]
    absorbed = np.nan_to_num(pad_episodes([1.0 - episode.inner_ends for of_task in episodes for episode in of_task]))
    rows = zip(zip(*columns, strict=True), np.split(absorbed, len(episodes)), strict=True)
    return [_Sequences(Transitions(*parts), shown) for parts, shown in rows]


def _transitions(episode: Episode) -> Transitions:
    """Take the transitions of an episode, arrays (length, dim)."""
    columns: list[Any] = [episode.observations, episode.actions, episode.rewards, episode.next_observations]
    return Transitions(*(column.reshape(len(column), -1) for column in columns))


def _of_readout(tasks: Floats, findings: Sequence[_Comparison]) -> dict[str, Any]:
    """Compare the read-out with the tasks, as arguments of Diagnostics; there are none without a read-out."""
    estimates = [found.estimate for found in findings if found.estimate is not None]
    if not estimates:
        return {}
    is_known = np.asarray(np.isfinite(np.stack([found.means for found in findings])).all(axis=-1))
    entries, misses, holds = compare_readout(tasks, estimates, is_known)
    return {"readout_entries": np.array(entries), "readout_misses": misses, "readout_holds": holds}


def _compare(view: AgentView, sequences: _Sequences, rng: np.random.Generator, labels: TaskLabels) -> _Comparison:
    """Compare beliefs and predictions, given the transitions before, with what came."""
    observed = view.observe(*sequences.transitions)
    encoder: Any = view.encoder  # which has the abilities
    prefixes = encoder.prefixes(observed, th.as_tensor(sequences.absorbed).to(observed.rewards))
    horizon = sequences.absorbed.shape[1]

    def outcomes(episodes: slice, steps: list[int]) -> tuple[list[str], Floats, Floats]:
        """Return names (n_quantities,), real values (..., n_quantities) and samples (n_samples, ..., n_quantities)."""
        memory = map_memory(lambda columns: columns[episodes, steps], prefixes)
        belief = TaskBelief(encoder.posterior(memory), memory)
        here = Transitions(*(columns[episodes, steps] for columns in sequences.transitions))
        modelled = view.outcomes(belief, here.observations, here.actions, here.next_observations, N_SAMPLES)
        names, real, samples = [], [], []
        if modelled.rewards is not None:
            names, real, samples = ["reward"], [here.rewards], [modelled.rewards.cpu().numpy()]
        if modelled.next_observations is not None:
            # The change, for where the agent is says almost all of where it will be, and hides what was predicted.
            names += [f"change of observation {i}" for i in range(here.observations.shape[-1])]
            real.append(here.next_observations - here.observations)
            samples.append(modelled.next_observations.cpu().numpy() - here.observations)
        return names, np.concatenate(real, axis=-1), np.concatenate(samples, axis=-1)

    names, real, samples = outcomes(np.s_[:], _spread(horizon, N_SCORED))
    pit = _randomized_ranks(real, samples, rng)
    flat = real.reshape(-1, real.shape[-1])
    bounds = np.stack([np.nanmin(flat, axis=0), np.nanmax(flat, axis=0)])
    _, real, samples = outcomes(np.s_[:1], list(range(horizon)))
    first = samples[:, 0, :, 0]
    predicted = np.stack([first.mean(axis=0), *np.quantile(first, INTERVAL, axis=0)])
    means = encoder.posterior(prefixes).mean.cpu().double().numpy()
    is_over = np.isnan(np.asarray(sequences.transitions.rewards)[..., 0])
    means[np.pad(is_over, ((0, 0), (1, 0)))] = np.nan
    estimate = None if view.policy.readout is None else view.read_task(prefixes, labels)
    return _Comparison(names, pit, bounds, means, real[0, :, 0], predicted, estimate)


def _spread(length: int, at_most: int) -> list[int]:
    """Spread steps evenly over an episode, its first and its last among them."""
    steps: list[int] = np.unique(np.linspace(0, length - 1, at_most).astype(int)).tolist()
    return steps


def _randomized_ranks(values: Floats, samples: Floats, rng: np.random.Generator) -> Floats:
    """Rank values (...) among samples (n, ...), in (0, 1): uniform if they have one distribution, ties or not.

    Example: a value with 3 of 9 samples below and none equal is drawn from U(0.3, 0.4).
    """
    below, equal = (samples < values).sum(axis=0), (samples == values).sum(axis=0)
    ranks = (below + (equal + 1) * rng.random(values.shape)) / (len(samples) + 1)
    return np.where(np.isnan(values), np.nan, ranks)


def _log_scores(view: AgentView, sequences: list[_Sequences]) -> Floats:
    """Score every transition given all before it, (n_tasks, n_episodes, horizon)."""
    encoder: Any = view.encoder  # which predicts
    log_scores = [encoder.one_step_scores(view.observe(*of_task.transitions)) for of_task in sequences]
    return th.stack(log_scores).cpu().double().numpy()


def _levels(view: AgentView, encoder: MeasuresDistance, episode: Episode) -> Floats:
    """Compute the PIT of beta_n of transitions spread over an episode, (n_scales,)."""
    from scipy.stats import chi2, f

    spread = _spread(len(episode.rewards), N_CONTEXT)
    distance = encoder.distance(view.observe(*(columns[spread] for columns in _transitions(episode))))
    beta, n_values, df = (values.cpu().double().numpy() for values in distance)
    if np.isinf(df).all():
        levels: Floats = chi2.cdf(beta, n_values)
    else:
        levels = f.cdf(beta / n_values * df / (df - 2), n_values, df)
    return levels


def _principal_axes(means: Floats) -> tuple[Floats, Floats]:
    """Project points (..., dim) on their two principal axes (..., 2); tell the share of the variance on each (2,)."""
    known = means[~np.isnan(means).any(axis=-1)]
    center = known.mean(axis=0)
    _, spread, axes = np.linalg.svd(known - center, full_matrices=False)
    padded = np.zeros((2, means.shape[-1]))  # one latent dimension has but one axis
    padded[: len(axes)] = axes[:2]
    shares = np.zeros(2)
    shares[: len(spread)] = (spread**2 / max((spread**2).sum(), np.finfo(float).tiny))[:2]
    return (means - center) @ padded.T, shares

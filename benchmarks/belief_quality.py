"""Compare encoders by how well the hidden task can be read off their beliefs, without an agent.

    python benchmarks/belief_quality.py --out docs/results

Logs episodes of random actions in each environment. Every encoder with a loss of its own learns from the same
sequences, the first 100 transitions of episodes of the training tasks. A linear read-out (ridge) of its belief is
fitted on these tasks and tested on the test tasks: the share of the tasks' variance that it explains after some
transitions, after 100 in another order, and after 1,000, ten times what the encoder was trained on. Also measures
processor time, parameters and what an agent carries from step to step. A run that is already in the JSON file of
``--out`` is not made again.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch as th
from encoder_alone import updates
from kept_runs import KeptRuns, Row
from numpy.typing import NDArray
from torch import Tensor

from sb3_bruno.encoders import ENCODERS, TaskEncoder, TaskSequences, Transitions
from sb3_bruno.encoders.base import map_memory
from sb3_bruno.evaluation.band import Band
from sb3_bruno.plotting.style import plot_bands

FAMILIES = (
    "PointDir-v0",
    "PointGoal-v0",
    "PointRotation-v0",
    "CheetahDir-v0",
    "CheetahVel-v0",
    "CheetahParams-v0",
)
ENCODERS_WITH_A_LOSS = [name for name, encoder in ENCODERS.items() if encoder.learns_from == "own"]
CONTEXTS = (0, 1, 3, 10, 30, 100)
TRAINED = 100
"""Transitions of a sequence in training."""
LONG = 1_000
N_HELD = 5
"""Steps for which the logged behaviour holds a random action, so that bodies move."""
RIDGES = np.logspace(-6, 2, 9)


class Logged(NamedTuple):
    """Episodes of one task each: transitions (n, time, dim), tasks (n, task_dim)."""

    transitions: Transitions
    tasks: Tensor


@cache
def log_episodes(env_id: str, split: str, n_episodes: int, n_steps: int) -> Logged:
    """Act at random under the tasks of a split in turn, in episodes that do not end."""
    env = gym.make(f"sb3_bruno_envs:{env_id}", split=split, observe="plain", max_episode_steps=n_steps)
    tasks = env.get_wrapper_attr("task_distribution").tasks(split)
    env.action_space.seed(0)
    columns: list[list[Any]] = [[], [], [], []]
    for i in range(n_episodes):
        observation, _ = env.reset(seed=i, options={"task": tasks[i % len(tasks)]})
        for step in range(n_steps):
            if step % N_HELD == 0:
                action = env.action_space.sample()
            arrival, reward, terminated, *_ = env.step(action)
            assert not terminated, f"{env_id} ends its episodes: the benchmark needs environments that go on"
            for column, value in zip(columns, (observation, action, [reward], arrival), strict=True):
                column.append(value)
            observation = arrival
    arrays = (np.asarray(column, dtype=np.float32).reshape(n_episodes, n_steps, -1) for column in columns)
    repeated = tasks[np.arange(n_episodes) % len(tasks)]
    return Logged(Transitions(*map(th.as_tensor, arrays)), th.as_tensor(repeated, dtype=th.float32))


def train(encoder: TaskEncoder, logged: Logged, n_updates: int, seed: int) -> float:
    """Train an encoder on sequences of 16 episodes; return the processor time of an update, in ms."""
    if not any(parameter.requires_grad for parameter in encoder.parameters()):
        return 0.0  # a control that learns nothing
    rng = np.random.default_rng(seed)

    def draw() -> TaskSequences:
        rows = th.as_tensor(rng.choice(len(logged.tasks), 16, replace=False))
        sequences = Transitions(*(column[rows, :TRAINED] for column in logged.transitions))
        return TaskSequences(sequences, logged.tasks[rows])

    start = time.process_time()
    for _ in updates(encoder, draw, n_updates, encoder.learning_rate):
        pass
    encoder.eval()
    return 1e3 * (time.process_time() - start) / n_updates


@th.no_grad()
def beliefs(encoder: TaskEncoder, transitions: Transitions, contexts: tuple[int, ...]) -> dict[int, NDArray[Any]]:
    """Read beliefs, (n, belief_dim), off the memories of the first so many transitions."""
    found: dict[int, list[Tensor]] = {n: [] for n in contexts}
    for chunk in zip(*(column[:, : max(contexts)].split(20) for column in transitions), strict=True):
        memories = encoder.prefixes(Transitions(*chunk))
        for n in contexts:
            found[n].append(encoder.belief(map_memory(lambda states, n=n: states[:, n], memories)))
    return {n: th.cat(parts).double().numpy() for n, parts in found.items()}


def read_out(inputs: NDArray[Any], targets: NDArray[Any]) -> Callable[[NDArray[Any]], NDArray[Any]]:
    """Fit a linear function by ridge regression, whose strength generalised cross-validation chooses."""
    mean, std = inputs.mean(axis=0), inputs.std(axis=0)
    std = np.where(std > 1e-8, std, np.inf)  # a constant tells nothing
    left, singular, right = np.linalg.svd((inputs - mean) / std, full_matrices=False)
    centre = targets.mean(axis=0)
    rotated = left.T @ (targets - centre)

    def shrink(ridge: float) -> NDArray[Any]:
        squares: NDArray[Any] = singular**2 / (singular**2 + ridge * len(inputs))
        return squares

    def validation(ridge: float) -> float:
        residual = targets - centre - left @ (shrink(ridge)[:, None] * rotated)
        return float((residual**2).sum() / (1 - (1 + shrink(ridge).sum()) / len(inputs)) ** 2)

    ridge = min(RIDGES, key=validation)
    inverse = np.divide(shrink(ridge), singular, out=np.zeros_like(singular), where=singular > 1e-10)
    weights = right.T @ (inverse[:, None] * rotated)
    return lambda others: (others - mean) / std @ weights + centre


def explained(predicted: NDArray[Any], tasks: NDArray[Any]) -> float:
    """Take the share of the variance of each number of the task that is explained, in the mean over these numbers."""
    spread = ((tasks - tasks.mean(axis=0)) ** 2).sum(axis=0)
    shares = 1 - ((predicted - tasks) ** 2).sum(axis=0)[spread > 0] / spread[spread > 0]
    return float(shares.mean())


@th.no_grad()
def absorb_ms(encoder: TaskEncoder, transitions: Transitions) -> float:
    """Measure the processor time in which ten agents absorb a transition each, in ms."""
    memory, step = encoder.empty((10,)), Transitions(*(column[:10, 0] for column in transitions))
    start = time.process_time()
    for _ in range(TRAINED):
        memory = encoder.absorb(memory, step)
    return 1e3 * (time.process_time() - start) / TRAINED


def run(env_id: str, name: str, seed: int, n_updates: int, n_episodes: int) -> Row:
    """Train an encoder, and read the task off its beliefs."""
    known = log_episodes(env_id, "train", n_episodes, LONG)
    others = log_episodes(env_id, "test", n_episodes // 2, LONG)
    th.manual_seed(seed)
    dims = (known.transitions.observations.shape[-1], known.transitions.actions.shape[-1], known.tasks.shape[-1])
    encoder = ENCODERS[name].build(*dims)
    update = train(encoder, known, n_updates, seed)
    order = th.as_tensor(np.random.default_rng(seed).permutation(TRAINED))
    seen, unseen = (beliefs(encoder, logged.transitions, (*CONTEXTS, LONG)) for logged in (known, others))
    shuffled = beliefs(encoder, Transitions(*(column[:, order] for column in others.transitions)), (TRAINED,))
    fitted = {n: read_out(seen[n], known.tasks.numpy()) for n in seen}
    row = {f"after {n:,}": explained(fitted[n](unseen[n]), others.tasks.numpy()) for n in seen}
    row["after 100, shuffled"] = explained(fitted[TRAINED](shuffled[TRAINED]), others.tasks.numpy())
    return row | {
        "ms per update": update,
        "ms per step of ten": absorb_ms(encoder, others.transitions),
        "parameters": sum(parameter.numel() for parameter in encoder.parameters()),
        "bytes carried": sum(states.numel() * states.element_size() for states in encoder.empty()),
    }


def table(rows: dict[str, dict[str, Row]]) -> list[str]:
    """Write a row for each environment and encoder: medians over the seeds."""
    columns = list(next(iter(next(iter(rows.values())).values())))
    lines = ["| environment | encoder | " + " | ".join(columns) + " |", "|---" * (2 + len(columns)) + "|"]
    for name, by_seed in rows.items():
        medians = {column: float(np.median([row[column] for row in by_seed.values()])) for column in columns}
        cells = [f"{median:,.0f}" if median >= 100 else f"{median:.2f}" for median in medians.values()]
        lines.append(f"| {name.replace(' / ', ' | ')} | {' | '.join(cells)} |")
    return lines


def draw(rows: dict[str, dict[str, Row]], path: Path) -> None:
    """Draw how much of the task is known after how many transitions, a panel for each environment."""
    panels: dict[str, dict[str, Band]] = {}
    for name, by_seed in rows.items():
        env_id, encoder = name.split(" / ")
        shares = np.array([[row[f"after {n:,}"] for n in CONTEXTS[1:]] for row in by_seed.values()])
        panels.setdefault(env_id, {})[encoder] = Band.of(np.log10(CONTEXTS[1:]), shares.clip(min=-0.2))
    note = (
        "Line: mean of the seeds. Band: middle half. Read off beliefs of tasks that no encoder was trained on. "
        "Shares below -0.2 are drawn at -0.2."
    )
    plot_bands(panels, path, "log10 of transitions seen", "share of the task explained", note)


def main() -> None:
    """Parse the command line, and make the runs that are missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), choices=list(FAMILIES), metavar="ID")
    parser.add_argument("--encoders", nargs="+", default=ENCODERS_WITH_A_LOSS, choices=ENCODERS_WITH_A_LOSS)
    parser.add_argument("--updates", type=int, default=1_000)
    parser.add_argument("--episodes", type=int, default=200, help="of the training tasks; half as many of the others")
    parser.add_argument("--out", type=Path, help="folder for belief_quality.json, .md and .png")
    options = parser.parse_args()
    th.set_num_threads(1)
    kept = KeptRuns(options.out, "belief_quality", updates=options.updates, episodes=options.episodes)
    for family in options.families:
        for seed in options.seeds:
            for name in options.encoders:
                make = partial(run, family, name, seed, options.updates, options.episodes)
                kept.make(f"{family} / {name}", seed, make)
    kept.write_table(table(kept.rows), f"Medians over seeds, after {options.updates:,} updates.")
    if options.out is not None:
        draw(kept.rows, options.out / "belief_quality.png")


if __name__ == "__main__":
    main()

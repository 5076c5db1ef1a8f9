"""Train BrunoSAC with the library's defaults, and an oracle, on environments that nobody tuned them for.

    python benchmarks/untuned.py --out docs/results

The encoder and the buffer have their defaults, and the actor-critic has the same settings everywhere. Each agent is
tested on 20 tasks that it was not trained on: its return, its last reward (minus a distance in three of the
environments), how much of the task a linear read-out of the belief explains after 20 of its own transitions, fitted on
the training tasks, and the steps until its rewards are as good as they get. A run that is already in the JSON file of
``--out`` is not made again.

FetchReach needs gymnasium-robotics, which needs a MuJoCo older than this package's tests do: install it in an
environment of its own, and name it by ``--families``.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch as th
from encoder_alone import explained
from kept_runs import KeptRuns, Row
from numpy.typing import NDArray
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno import BrunoSAC, Transitions
from sb3_bruno.evaluation import AdaptationResult
from sb3_bruno.evaluation.episodes import Episode, pad_episodes, play_episodes
from sb3_bruno_envs import MetaTask, TaskObservation, TaskSet, TransitionObservation, hide_goal

N_ENVS, N_EPISODES, N_SEEN = 8, 3, 20
SETTINGS: dict[str, Any] = {
    "learning_rate": 1e-3,
    "learning_starts": 800,
    "gradient_steps": 4,  # for the steps of eight environments
    "gamma": 0.95,
}
PAPER = {"process": "gaussian", "flow_class": "paper_maf", "objective": "paper", "belief": "mean_var"}
AGENTS: dict[str, dict[str, Any]] = {
    "BrunoSAC": {},
    "oracle": {},
    "BrunoSAC, the paper's process": {"encoder_kwargs": PAPER},
}


def registered(env_id: str, agent: str, split: str) -> gym.Env[Any, Any]:
    """Make one of this package's environments."""
    return gym.make(f"sb3_bruno_envs:{env_id}", split=split, observe="task" if agent == "oracle" else "transition")


def observed(env: MetaTask, agent: str) -> gym.Env[Any, Any]:
    """Show the oracle the task, and the others their last transition."""
    return TaskObservation(env) if agent == "oracle" else TransitionObservation(env)


def pendulum_gravity(agent: str, split: str) -> gym.Env[Any, Any]:
    """Hide the gravity of Gymnasium's Pendulum, from 5 to 15 m/s^2."""
    train = np.linspace(5.0, 15.0, 41)
    tasks = TaskSet(train[:, None], (train[:-1] + train[1:])[::2, None] / 2)

    def set_gravity(pendulum: Any, task: NDArray[np.float32]) -> None:
        pendulum.g = float(task[0])

    return observed(MetaTask(gym.make("Pendulum-v1"), set_gravity, tasks, split=split), agent)


def fetch_reach(agent: str, split: str) -> gym.Env[Any, Any]:
    """Hide the goal of gymnasium-robotics' FetchReach, with its dense reward."""
    import gymnasium_robotics

    gym.register_envs(gymnasium_robotics)
    return observed(hide_goal(gym.make("FetchReachDense-v4"), split=split), agent)


FAMILIES: dict[str, Callable[[str, str], gym.Env[Any, Any]]] = {
    "PointGoal-v0": partial(registered, "PointGoal-v0"),
    "PointRotation-v0": partial(registered, "PointRotation-v0"),
    "Pendulum-v1, gravity hidden": pendulum_gravity,
    "FetchReachDense-v4, goal hidden": fetch_reach,
}


def run(family: str, agent: str, seed: int, n_timesteps: int) -> Row:
    """Train an agent and test it on tasks that it was not trained on."""
    make = partial(FAMILIES[family], agent)
    env = make_vec_env(lambda: make("train"), N_ENVS, seed=seed)
    algorithm = SAC if agent == "oracle" else BrunoSAC
    model = algorithm("MlpPolicy", env, seed=seed, device="cpu", **SETTINGS, **AGENTS[agent]).learn(n_timesteps)
    distribution: TaskSet = make("test").get_wrapper_attr("task_distribution")
    tasks = distribution.tasks("test")
    episodes = play_episodes(model, lambda: make("test"), tasks, n_episodes=N_EPISODES, seed=10_000)
    rewards = np.stack([pad_episodes([episode.rewards for episode in of_task]) for of_task in episodes])
    found = {
        "return": float(rewards.sum(axis=-1).mean()),
        "last reward": float(rewards[..., -1].mean()),
        "steps": float(np.median(AdaptationResult(tasks, rewards).steps_to_steady(window=1))),
    }
    if isinstance(model, BrunoSAC):
        known = play_episodes(model, lambda: make("train"), distribution.tasks("train"), n_episodes=1, seed=20_000)
        fitted = _beliefs(model, known), distribution.tasks("train")
        found["explained of unseen tasks"] = explained(
            fitted, (_beliefs(model, episodes), np.repeat(tasks, N_EPISODES, axis=0))
        )
    return found


def _beliefs(model: BrunoSAC, episodes: list[list[Episode]]) -> NDArray[np.float32]:
    """Compute the beliefs' means after the first transitions of all episodes, (n, latent_dim)."""
    return np.stack([_belief(model, episode) for of_task in episodes for episode in of_task])


def _belief(model: BrunoSAC, episode: Episode) -> NDArray[np.float32]:
    """Compute the belief's mean after the first transitions of an episode, (latent_dim,)."""
    columns = (episode.observations, episode.actions, episode.rewards[:, None], episode.next_observations)
    return model.infer(Transitions(*(column[:N_SEEN] for column in columns))).mean


def table(runs: dict[str, dict[str, Row]]) -> list[str]:
    """Write a row for each family and agent: medians, and the seeds' last rewards."""
    lines = [
        f"| environment | agent | return | last reward | by seed | explained after {N_SEEN} | steps |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, by_seed in runs.items():
        median = {
            key: float(np.median([row[key] for row in by_seed.values() if key in row] or [np.nan]))
            for key in ("return", "last reward", "explained of unseen tasks", "steps")
        }
        each = ", ".join(f"{row['last reward']:.3f}" for row in by_seed.values())
        share = median["explained of unseen tasks"]
        known = "" if np.isnan(share) else f"{share:.3f}"
        lines.append(
            f"| {name.replace(' / ', ' | ')} | {median['return']:.1f} | {median['last reward']:.3f} | {each} | {known} "
            f"| {median['steps']:.0f} |"
        )
    return lines


def main() -> None:
    """Parse the command line, and make the runs that are missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--steps", type=int, default=20_000, help="of training, over all environments")
    parser.add_argument("--families", nargs="+", default=list(FAMILIES)[:3], choices=list(FAMILIES), metavar="NAME")
    parser.add_argument("--agents", nargs="+", default=list(AGENTS)[:2], choices=list(AGENTS), metavar="NAME")
    parser.add_argument("--out", type=Path, help="folder for untuned.json and .md")
    options = parser.parse_args()
    th.set_num_threads(1)
    kept = KeptRuns(options.out, "untuned", steps=options.steps)
    for seed in options.seeds:
        for family in options.families:
            for agent in options.agents:
                kept.make(f"{family} / {agent}", seed, partial(run, family, agent, seed, options.steps))
    kept.write_table(table(kept.rows), f"Medians after {options.steps:,} steps.")


if __name__ == "__main__":
    main()

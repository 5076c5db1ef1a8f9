"""Train agents on Pendulum with its angle hidden: one that sees it, one without memory, and recurrent ones.

    python benchmarks/hidden_angle.py --out docs/results

Each agent learns for the same number of environment steps and is then tested, deterministically, on 20 episodes. Prints
the mean return of each seed. A run that is already in the JSON file of ``--out`` is not made again.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch as th
from gymnasium.spaces import Box
from gymnasium.wrappers import TransformObservation
from kept_runs import KeptRuns, Row
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

from sb3_bruno import RecurrentSAC
from sb3_bruno_envs import MetaTask, TransitionObservation

N_ENVS = 4
N_TESTS = 20  # episodes
SETTINGS: dict[str, Any] = {
    "learning_rate": 1e-3,
    "learning_starts": 800,
    "batch_size": 128,
    "gradient_steps": 2,  # for the steps of four environments
    "gamma": 0.95,
    "policy_kwargs": {"net_arch": [64, 64]},
}
RECURRENT: dict[str, dict[str, Any]] = {
    "RecurrentSAC, GRU": {},
    "RecurrentSAC, LSTM": {"encoder_kwargs": {"cell": "lstm"}},
}
RATES = (1e-4, 1e-3)  # of the encoder


def swing_up(hidden: bool, shown: bool = False) -> gym.Env[Any, Any]:
    """Make Pendulum-v1 with episodes of 100 steps.

    Args:
        hidden: show the angular velocity alone, and hide the angle.
        shown: show the last action and reward, as recurrent agents need them.
    """
    env: gym.Env[Any, Any] = gym.make("Pendulum-v1", max_episode_steps=100)
    if hidden:
        env = TransformObservation(env, lambda observation: observation[2:], Box(-8.0, 8.0, (1,)))  # rad/s
    return TransitionObservation(MetaTask(env)) if shown else env


def agents() -> dict[str, tuple[type[SAC], dict[str, Any], dict[str, Any]]]:
    """List the agents by name: class, further settings, arguments of ``swing_up``."""
    found: dict[str, tuple[type[SAC], dict[str, Any], dict[str, Any]]] = {
        "SAC, sees the angle": (SAC, {}, {"hidden": False}),
        "SAC": (SAC, {}, {"hidden": True}),
    }
    for name, settings in RECURRENT.items():
        for rate in RATES:
            more = {**settings, "encoder_learning_rate": rate}
            found[f"{name}, encoder's learning rate {rate:g}"] = (RecurrentSAC, more, {"hidden": True, "shown": True})
    return found


def run(name: str, seed: int, n_timesteps: int) -> Row:
    """Train an agent, and test it."""
    algorithm, more, env_kwargs = agents()[name]
    env = make_vec_env(swing_up, N_ENVS, seed=seed, env_kwargs=env_kwargs)
    model = algorithm("MlpPolicy", env, seed=seed, device="cpu", **SETTINGS, **more).learn(n_timesteps)
    test = make_vec_env(swing_up, N_TESTS, seed=10_000, env_kwargs=env_kwargs)
    mean, _ = evaluate_policy(model, test, n_eval_episodes=N_TESTS)
    return {"return": float(np.mean(mean))}


def main() -> None:
    """Parse the command line, and make the runs that are missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--steps", type=int, default=12_000, help="of training, over all environments")
    parser.add_argument("--agents", nargs="+", default=list(agents()), choices=list(agents()), metavar="NAME")
    parser.add_argument("--out", type=Path, help="folder for hidden_angle.json and .md")
    options = parser.parse_args()
    th.set_num_threads(1)
    kept = KeptRuns(options.out, "hidden_angle", steps=options.steps)
    for seed in options.seeds:
        for name in options.agents:
            kept.make(name, seed, partial(run, name, seed, options.steps))
    lines = ["| agent | mean return | by seed |", "|---|---|---|"]
    for name, by_seed in kept.rows.items():
        returns = [row["return"] for row in by_seed.values()]
        lines.append(f"| {name} | {np.mean(returns):.0f} | {', '.join(f'{value:.0f}' for value in returns)} |")
    kept.write_table(lines, f"After {options.steps:,} steps.")


if __name__ == "__main__":
    main()

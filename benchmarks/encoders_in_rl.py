"""Train an agent with each encoder, under the same settings, and test it on tasks that it was not trained on.

    python benchmarks/encoders_in_rl.py --out docs/results

Says whether a method works where it is known to. The critics read the belief, for all. The actor-critic has the
settings of `untuned.py`, and an encoder its own defaults, but for ``ENCODER_SETTINGS``. Beside them are two agents of
SB3's SAC: the oracle, which is told the task, and the Markov agent, which is not. A run that is already in the JSON
file of ``--out`` is not made again.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch as th
from kept_runs import KeptRuns, Row
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env
from untuned import N_ENVS, N_EPISODES, SETTINGS

from sb3_bruno import TaskSAC
from sb3_bruno.encoders import ENCODERS
from sb3_bruno.evaluation import evaluate_adaptation

FAMILIES: dict[str, tuple[int, dict[str, Any]]] = {
    "PointDir-v0": (6_000, {}),
    "PointGoal-v0, dim=2": (10_000, {"dim": 2}),
    "PointGoal-v0": (20_000, {}),
}
"""Environment steps of training, and arguments of the environment."""
OBSERVED = {"oracle": "task", "Markov": "plain"}
"""What the agents of SB3's SAC see."""
AT_THE_CRITICS_RATE = {"encoder_learning_rate": SETTINGS["learning_rate"]}
"""Those that the critics teach: their defaults are for runs of a hundred times as many updates."""
ENCODER_SETTINGS: dict[str, dict[str, Any]] = {
    # PEARL's own for its point robot, see docs/encoders.md
    "product_of_gaussians": {"encoder_kwargs": {"kl_weight": 8e-5, "latent_dim": 16}, **AT_THE_CRITICS_RATE},
    "recurrent": AT_THE_CRITICS_RATE,
    "split_aggregator": AT_THE_CRITICS_RATE,
    "causal_transformer": AT_THE_CRITICS_RATE,
}


def make(family: str, agent: str, split: str) -> gym.Env[Any, Any]:
    """Make an environment that shows an agent what it may see."""
    env_id, _, _ = family.partition(",")
    _, env_kwargs = FAMILIES[family]
    observe = OBSERVED.get(agent, "transition")
    return gym.make(f"sb3_bruno_envs:{env_id}", split=split, observe=observe, **env_kwargs)


def run(family: str, agent: str, seed: int, n_timesteps: int) -> Row:
    """Train an agent and test it."""
    env = make_vec_env(partial(make, family, agent, "train"), N_ENVS, seed=seed)
    common: dict[str, Any] = {"policy": "MlpPolicy", "env": env, "seed": seed, "device": "cpu", **SETTINGS}
    if agent in OBSERVED:
        model: SAC = SAC(**common).learn(n_timesteps)
    else:
        own = ENCODER_SETTINGS.get(agent, {})
        model = TaskSAC(**common, encoder_class=agent, critic_input="belief", **own).learn(n_timesteps)
    test = partial(make, family, agent, "test")
    tasks = test().get_wrapper_attr("task_distribution").tasks("test")
    result = evaluate_adaptation(model, test, tasks, n_episodes=N_EPISODES, seed=10_000)
    return {"return": float(result.mean_return().mean()), "last reward": float(result.rewards[..., -1].mean())}


def table(rows: dict[str, dict[str, Row]]) -> list[str]:
    """Write a row for each environment and agent: medians, and the seeds' returns."""
    lines = ["| environment | agent | return | by seed | last reward |", "|---" * 5 + "|"]
    for name, by_seed in rows.items():
        returns, last = ([row[key] for row in by_seed.values()] for key in ("return", "last reward"))
        each = ", ".join(f"{value:.1f}" for value in returns)
        family, agent = name.split(" / ")
        lines.append(f"| {family} | {agent} | {np.median(returns):.1f} | {each} | {np.median(last):.2f} |")
    return lines


def main() -> None:
    """Parse the command line, and make the runs that are missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    agents = [*OBSERVED, *ENCODERS]
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), choices=list(FAMILIES), metavar="NAME")
    parser.add_argument("--agents", nargs="+", default=agents, choices=agents, metavar="NAME")
    parser.add_argument("--divide-steps", type=int, default=1, metavar="N", help="train for an N-th of the steps")
    parser.add_argument("--out", type=Path, help="folder for encoders_in_rl.json and .md")
    options = parser.parse_args()
    th.set_num_threads(1)
    kept = KeptRuns(options.out, "encoders_in_rl", divide_steps=options.divide_steps)
    for seed in options.seeds:
        for family in options.families:
            for agent in options.agents:
                n_timesteps = FAMILIES[family][0] // options.divide_steps
                kept.make(f"{family} / {agent}", seed, partial(run, family, agent, seed, n_timesteps))
    kept.write_table(table(kept.rows), "Medians over seeds, on tasks that no agent was trained on.")


if __name__ == "__main__":
    main()

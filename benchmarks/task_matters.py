"""Measure what it is worth to know the task, in every family: an agent that is told it beside one that is not.

    python benchmarks/task_matters.py --out docs/results

Trains SAC with the settings of `zoo_configs/` on the training tasks, once told the task (the oracle) and once not (the
Markov agent), and tests both on the test tasks. The floor is what standing still or acting at random earns, whichever
is more. Where the Markov agent earns 90 % of what the oracle earns above the floor, the family hides nothing that is
worth knowing, and does not serve to compare agents. An oracle that leads the floor by less than a tenth of what is
earned has learned nothing, and tells nothing of its family. A run that is already in the JSON file of ``--out`` is not
made again.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import numpy as np
from kept_runs import KeptRuns, Row
from numpy.typing import NDArray

import sb3_bruno_envs
from sb3_bruno.cli.main import main as sb3_bruno_command
from sb3_bruno.evaluation import AdaptationResult, evaluate_adaptation

STEPS = {
    "PointDir-v0": 6_000,
    "PointGoal-v0": 20_000,
    "PointRotation-v0": 20_000,
    "SparsePointGoal-v0": 100_000,
    "Wind-v0": 600_000,  # half of them random: one random episode in 150 meets the goal
    "CartpoleSwingUp-v0": 100_000,
    "CheetahDir-v0": 100_000,
    "CheetahVel-v0": 100_000,
    "CheetahParams-v0": 100_000,
    "CheetahGravity-v0": 100_000,
    "HopperParams-v0": 100_000,
    "WalkerParams-v0": 200_000,
    "AntDir-v0": 200_000,
    "AntDir2D-v0": 200_000,
    "AntGoal-v0": 200_000,
    "HumanoidDir-v0": 200_000,
}
"""Environment steps of training, over all environments."""
N_EPISODES = 3


class Floor:
    """Acts without looking: stands still, or draws actions at random."""

    def __init__(self, env: gym.Env[Any, Any], at_random: bool) -> None:
        self.space, self.at_random = env.action_space, at_random
        self.space.seed(0)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[NDArray[Any], None]:
        """Return an action for each environment."""
        actions = [self.space.sample() for _ in range(len(observation))]
        return np.stack(actions) * float(self.at_random), None


def plain(env_id: str) -> gym.Env[Any, Any]:
    """Make an environment of the test tasks that shows its own observation."""
    return gym.make(f"{sb3_bruno_envs.__name__}:{env_id}", observe="plain", split="test")


def floor(env_id: str, at_random: bool) -> Row:
    """Test an agent that learns nothing."""
    env = plain(env_id)
    tasks = env.get_wrapper_attr("task_distribution").tasks("test")
    result = evaluate_adaptation(Floor(env, at_random), partial(plain, env_id), tasks, n_episodes=N_EPISODES)
    return {"return": float(result.mean_return().mean())}


def train(env_id: str, config: str, seed: int, n_timesteps: int) -> Row:
    """Train SAC with one of `zoo_configs/`, and test it."""
    with TemporaryDirectory() as temporary:
        folder = str(Path(temporary) / "logs")  # whose runs the commands trust
        common = ["--algo", "sac", "--env", env_id, "-f", folder]
        own = ["-conf", config, "--seed", str(seed), "-n", str(n_timesteps), "--eval-freq", "-1", "--verbose", "0"]
        for command in (["train", *common, *own], ["evaluate", *common, "--episodes", str(N_EPISODES)]):
            sb3_bruno_command(command)
        (found,) = Path(folder).rglob("adaptation.json")
        return {"return": float(AdaptationResult.load(found).mean_return().mean())}


def table(rows: dict[str, dict[str, Row]]) -> list[str]:
    """Write a row for each family whose four agents were tested: means over seeds."""
    agents = ("standing still", "at random", "markov", "oracle")
    lines = [
        "| family | standing still | at random | Markov agent | oracle | share of the oracle's | |",
        "|---" * 7 + "|",
    ]
    for env_id in dict.fromkeys(name.split(" / ")[0] for name in rows):
        of_agents = [rows.get(f"{env_id} / {agent}", {}).values() for agent in agents]
        if not all(of_agents):
            continue
        returns = [float(np.mean([row["return"] for row in by_seed])) for by_seed in of_agents]
        least, (markov, oracle) = max(returns[:2]), returns[2:]
        has_learned = oracle - least > 0.1 * max(abs(oracle), abs(least))
        share = f"{(markov - least) / (oracle - least):.2f}" if has_learned else ""
        verdict = "" if has_learned else "the oracle has learned nothing"
        if has_learned and markov - least >= 0.9 * (oracle - least):
            verdict = "hides nothing"
        cells = [env_id, *(f"{value:.1f}" for value in returns), share, verdict]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def main() -> None:
    """Parse the command line, and make the runs that are missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--families", nargs="+", default=list(STEPS), choices=list(STEPS), metavar="ID")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--divide-steps", type=int, default=1, metavar="N", help="train for an N-th of the steps")
    parser.add_argument("--out", type=Path, help="folder for task_matters.json and .md")
    options = parser.parse_args()
    kept = KeptRuns(options.out, "task_matters", divide_steps=options.divide_steps)
    for family in options.families:
        for name, at_random in (("standing still", False), ("at random", True)):
            kept.make(f"{family} / {name}", 0, partial(floor, family, at_random))
        for seed in options.seeds:
            for config in ("oracle", "markov"):
                steps = STEPS[family] // options.divide_steps
                kept.make(f"{family} / {config}", seed, partial(train, family, config, seed, steps))
    note = "Mean return over the test tasks. Share: what the Markov agent earns above the floor, of the oracle's."
    kept.write_table(table(kept.rows), note)


if __name__ == "__main__":
    main()

"""Measure how soon an agent notices that its task switched, how often it is wrong, and what noticing earns.

    python benchmarks/switch_detection.py --env PointDir-v0 --model logs/bruno_sac/PointDir-v0_1/PointDir-v0.zip \\
        --out docs/results

Runs a trained agent on episodes whose task switches half-way to another of the test tasks, and on as many whose task
stays, with each threshold of ``forget_threshold`` and without forgetting. Prints the share of switches noticed, the
median number of steps until then, false alarms per 1,000 steps, and the mean reward of the steps after the switch.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch as th
from made_by import about_this_run, made_by
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_bruno import BrunoSAC


class Switch(gym.Wrapper[Any, Any, Any, Any]):
    """Switch the environment to the task in ``options["then"]`` at step ``at``, unseen by the wrappers around it."""

    def __init__(self, env: gym.Env[Any, Any], at: int) -> None:
        super().__init__(env)
        self.at = at

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        options = dict(options or {})
        self.then, self.steps = options.pop("then", None), 0  # an automatic reset gives no options: no switch
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        if self.steps == self.at and self.then is not None:
            self.env.unwrapped.set_task(self.then)  # type: ignore[attr-defined]  # all our environments have it
        self.steps += 1
        return self.env.step(action)


def run(model: BrunoSAC, env_id: str, steps: int, n: int, *, switch: bool) -> tuple[NDArray[Any], NDArray[Any]]:
    """Run ``n`` episodes; return rewards and the number of transitions absorbed at each step, ``(n, steps)`` each."""
    venv = DummyVecEnv([lambda: Switch(gym.make(env_id, split="test", max_episode_steps=steps), steps // 2)] * n)
    tasks = venv.get_attr("task_distribution")[0].tasks("test")
    rng = np.random.default_rng(0)
    first = rng.integers(len(tasks), size=n)
    then = (first + rng.integers(1, len(tasks), size=n)) % len(tasks) if switch else first
    venv.seed(0)
    venv.set_options([{"task": tasks[a], "then": tasks[b]} for a, b in zip(first, then, strict=True)])
    observations, state, episode_start = venv.reset(), None, np.ones(n, dtype=bool)
    rewards, absorbed = [], []
    for _ in range(steps):
        actions, state = model.predict(observations, state, episode_start, deterministic=True)  # type: ignore[arg-type]
        absorbed.append(model.belief(state).memory.n[:, 0].cpu().numpy())
        observations, reward, episode_start, _ = venv.step(actions)
        rewards.append(reward)
    return np.stack(rewards, axis=1), np.stack(absorbed, axis=1)


def measure(model: BrunoSAC, env_id: str, steps: int, n: int, threshold: float | None) -> dict[str, Any]:
    """Measure delay, false alarms and rewards with a threshold; None never forgets."""
    model.policy.forget_threshold = threshold
    _, absorbed = run(model, env_id, steps, n, switch=False)
    alarms = int((np.diff(absorbed, axis=1) < 1).sum())
    rewards, absorbed = run(model, env_id, steps, n, switch=True)
    forgot = np.diff(absorbed, axis=1)[:, steps // 2 :] < 1  # column t: what the step t + 1 after the switch showed
    noticed = forgot.any(axis=1)
    return {
        "threshold": threshold,
        "noticed": float(noticed.mean()),
        "median delay": float(np.median(forgot.argmax(axis=1)[noticed] + 1)) if noticed.any() else None,
        "false alarms per 1,000 steps": 1_000 * alarms / (n * steps),
        "reward after the switch": float(rewards[:, steps // 2 :].mean()),
    }


def main() -> None:
    """Parse the command line and measure every threshold."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--env", default="PointDir-v0")
    parser.add_argument("--model", type=Path, required=True, help="a trained BrunoSAC")
    parser.add_argument("--steps", type=int, help="per episode (default: the environment's own)")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--thresholds", type=float, nargs="+", default=[2.0, 5.0, 10.0, 20.0], help="nats")
    parser.add_argument("--out", type=Path, help="folder for switch_ENV.md and .json")
    options = parser.parse_args()
    th.set_num_threads(1)
    model = BrunoSAC.load(options.model, device="cpu")
    env_id = f"sb3_bruno_envs:{options.env}"
    spec_steps = gym.make(env_id).spec.max_episode_steps  # type: ignore[union-attr]  # made from one
    steps = options.steps or spec_steps
    rows = [measure(model, env_id, steps, options.episodes, nats) for nats in (None, *options.thresholds)]
    lines = ["| " + " | ".join(rows[0]) + " |", "|---" * len(rows[0]) + "|"]
    for row in rows:
        cells = ("never" if value is None else f"{value:.3g}" for value in row.values())
        lines.append("| " + " | ".join(cells) + " |")
    print("\n".join(lines))
    if options.out:
        about = about_this_run()
        name = options.out / f"switch_{options.env}"
        name.with_suffix(".json").write_text(json.dumps({**about, "rows": rows}, indent=1) + "\n")
        name.with_suffix(".md").write_text("\n".join(lines) + f"\n\n{made_by(about)}\n")


if __name__ == "__main__":
    main()

"""Environment steps with policy and belief."""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np

from speed_sections.models import ACTION_DIM, CHEETAH, ENV_ID, KERNEL, plain, trained
from speed_sections.race import Row, Seconds, race, row


def rollouts(rounds: int) -> tuple[list[Row], Seconds]:
    """Time environment steps with policy and belief, beside SAC's rollout and MuJoCo alone."""
    physics = gym.make(ENV_ID).unwrapped
    physics.reset(seed=0)
    rows, everything = [], {}
    for n_envs, encoder_name, kwargs in (
        (1, "the default encoder", KERNEL),
        (10, "the default encoder", KERNEL),
        (10, "CheetahDir's encoder", CHEETAH),
        (20, "the default encoder", KERNEL),
    ):
        bruno, sac = trained(n_envs, gradient_steps=0, **kwargs), plain(n_envs, gradient_steps=0)
        bruno.learning_starts = sac.learning_starts = 0
        steps = 100 * n_envs
        work = {
            "bruno": partial(bruno.learn, steps, reset_num_timesteps=False),
            "SAC": partial(sac.learn, steps, reset_num_timesteps=False),
            "physics": partial(many_steps, physics, steps),
        }
        seconds = race(work, rounds, 1)
        what = f"env steps of a rollout, {n_envs} envs, {encoder_name}"
        target = "<= 1.5; the paper's code: 1,440 per second" if n_envs == 10 else ""
        rows.append(row(what, seconds, "bruno", "SAC", target, steps))
        rows.append(row(what, seconds, "bruno", "physics", "", steps))
        everything |= {f"{what}: {who}": times for who, times in seconds.items()}
    return rows, everything


def many_steps(physics: gym.Env[Any, Any], steps: int) -> None:
    """Step an environment that has no wrappers."""
    action = np.zeros(ACTION_DIM)
    for _ in range(steps):
        physics.step(action)

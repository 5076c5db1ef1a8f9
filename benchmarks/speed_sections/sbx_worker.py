"""Trains sbx's SAC in an environment of its own: started by ``rivals.py`` with that environment's interpreter.

Reads a line ``STEPS BATCH`` for each ``train()`` and answers with its seconds of processor time. It imports nothing of
sb3_bruno, and makes up transitions of the half-cheetah's size.
"""

from __future__ import annotations

import os
import sys
import time

os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

import gymnasium as gym
import numpy as np
from sbx import SAC


class Noise(gym.Env):
    """Shows noise, whatever the action."""

    observation_space = gym.spaces.Box(-np.inf, np.inf, (17,), np.float32)
    action_space = gym.spaces.Box(-1, 1, (6,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self._draw(), {}

    def step(self, action):
        return self._draw(), 1.0, False, False, {}

    def _draw(self):
        return self.np_random.standard_normal(17, dtype=np.float32)


def main() -> None:
    """Fill a buffer, then train as often as asked."""
    model = SAC("MlpPolicy", Noise(), seed=0, learning_starts=10**9, policy_kwargs={"net_arch": [256, 256]})
    model.learn(4_000)
    for line in sys.stdin:
        steps, batch = map(int, line.split())
        start = time.process_time()
        model.train(steps, batch)
        print(time.process_time() - start, flush=True)


if __name__ == "__main__":
    main()

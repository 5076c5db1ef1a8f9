"""Plays episodes of MuJoCo robots: the same torques for two environments, and what doing nothing earns."""

import numpy as np

STEPS = 40  # trajectories of different MuJoCo versions part after about 50


def torques(env, n=STEPS):
    """Torques over the whole range, so that feet hit the ground; (n, dim)."""
    high = env.action_space.high
    return np.random.default_rng(0).uniform(-high, high, (n, len(high))).astype(np.float32)


def rollout(env, n=STEPS):
    """All numbers of each step, the infos' too, flat, (n, numbers)."""
    steps = [env.step(action) for action in torques(env, n)]
    return np.array([np.hstack([*step[:4], *(np.ravel(value) for value in step[4].values())]) for step in steps])


def floor(env, n, *, random=False):
    """The mean return and the mean length of n episodes of zero or random actions."""
    returns, lengths = [], []
    env.action_space.seed(0)
    for episode in range(n):
        env.reset(seed=None if episode else 0)
        rewards, done = [], False
        while not done:
            action = env.action_space.sample() if random else np.zeros(env.action_space.shape, np.float32)
            _, reward, terminated, truncated, _ = env.step(action)
            rewards.append(reward)
            done = terminated or truncated
        returns.append(sum(rewards))
        lengths.append(len(rewards))
    return np.mean(returns), np.mean(lengths)

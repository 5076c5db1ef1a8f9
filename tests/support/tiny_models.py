"""Tiny models and the envs they meet: every algorithm keeps SB3's promises on them, and nothing is learned.

Three envs: PointDir, several tasks in NumPy alone; SparsePointGoal, trials of several episodes; and Pendulum with its
one constant task, whose actions are not in [-1, 1].
"""

import inspect
import re

import gymnasium as gym
import numpy as np
import pytest
import zuko
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno import BrunoCrossQ, BrunoSAC, BrunoTD3, BrunoTQC
from sb3_bruno_envs import MetaTask, TransitionObservation

ALGORITHMS = [BrunoSAC, BrunoTQC, BrunoCrossQ, BrunoTD3]
POINT = "sb3_bruno_envs:PointDir-v0"  # episodes of 30 steps
TRIAL = "sb3_bruno_envs:SparsePointGoal-v0"  # trials of three episodes of 20 steps
TINY_FLOW = {"flow_class": zuko.flows.MAF, "flow_kwargs": {"transforms": 2, "hidden_features": (16,)}}
TINY = {
    "policy_kwargs": {"net_arch": [16]},
    "encoder_kwargs": TINY_FLOW,
    "encoder_batch_size": 4,
    "replay_buffer_kwargs": {"n_sequences": 4, "sequence_length": 8},
    "buffer_size": 1_000,
    "batch_size": 16,
    "learning_starts": 40,
    "seed": 0,
    "device": "cpu",
}


def name_of(options):
    """A test's name, the same in every process: without the addresses of functions."""
    return re.sub(r" at 0x[0-9a-f]+", "", str(options))


def make_pendulum():
    return Monitor(TransitionObservation(MetaTask(gym.make("Pendulum-v1", max_episode_steps=25))))


def make_point():
    return Monitor(gym.make(POINT))


def for_each_that_takes(*options):
    """Run a test for every algorithm with each of the options that it has an argument for."""
    pairs = [
        (algorithm, option)
        for algorithm in ALGORITHMS
        for option in options
        if option.keys() <= arguments_of(algorithm)
    ]
    names = [f"{algorithm.__name__}-{name_of(option)}" for algorithm, option in pairs]
    return pytest.mark.parametrize(("algorithm", "options"), pairs, indirect=["algorithm"], ids=names, scope="module")


def arguments_of(algorithm):
    """The names of an algorithm's arguments: the mixin's and SB3's."""
    return {name for base in algorithm.__bases__ for name in inspect.signature(base).parameters}


def normalized(env_fn=make_pendulum, **kwargs):
    return VecNormalize(DummyVecEnv([env_fn]), **kwargs)


def rollout(model, env, n_steps, deterministic=True):
    """Observations, states and actions of one agent in a vec env that has been seeded."""
    observation, state, start = env.reset(), None, np.ones(env.num_envs, dtype=bool)
    steps = []
    for _ in range(n_steps):
        action, state = model.predict(observation, state, start, deterministic)
        steps.append((observation, state, action))
        observation, _, start, _ = env.step(action)
    return steps


def assert_same(one, other):
    """Two nests of dicts, lists, tensors and numbers are equal, bit for bit."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        one, other = list(one.values()), list(other.values())
    if isinstance(one, list | tuple):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_same(a, b)
    else:
        np.testing.assert_array_equal(one, other)

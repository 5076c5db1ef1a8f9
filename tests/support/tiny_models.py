"""Tiny models and the envs they meet: every algorithm keeps SB3's promises on them, and nothing is learned.

Three envs: PointDir, several tasks in NumPy alone; SparsePointGoal, trials of several episodes; and Pendulum with its
one constant task, whose actions are not in [-1, 1].
"""

import inspect
import re
from itertools import cycle

import gymnasium as gym
import numpy as np
import pytest
import torch as th
import zuko
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno import (
    BeliefSAC,
    BrunoCrossQ,
    BrunoSAC,
    BrunoTD3,
    BrunoTQC,
    PearlSAC,
    RecurrentCrossQ,
    RecurrentSAC,
    VaribadSAC,
)
from sb3_bruno.encoders import find_encoder
from sb3_bruno.encoders.base import map_memory
from sb3_bruno.maths.kernel_statistics import KernelStatistics
from sb3_bruno_envs import MetaTask, TransitionObservation

BRUNO = [BrunoSAC, BrunoTQC, BrunoCrossQ, BrunoTD3]
RECURRENT = [RecurrentSAC, RecurrentCrossQ]
ALGORITHMS = [*BRUNO, *RECURRENT, PearlSAC, VaribadSAC, BeliefSAC]
EACH_KIND = [BrunoTQC, BrunoTD3, RecurrentCrossQ, PearlSAC, VaribadSAC, BeliefSAC]
"""As few of them as have every base class and every encoder among them."""
POINT = "sb3_bruno_envs:PointDir-v0"  # episodes of 30 steps
TRIAL = "sb3_bruno_envs:SparsePointGoal-v0"  # trials of three episodes of 20 steps
TINY_BRUNO = {
    "flow_class": zuko.flows.MAF,
    "flow_kwargs": {"transforms": 2, "hidden_features": (16,)},
    "n_weights": 3,
    "net_arch": (16,),
}
TINY = {
    "policy_kwargs": {"net_arch": [16]},
    "replay_buffer_kwargs": {"n_sequences": 4, "sequence_length": 8},
    "buffer_size": 1_000,
    "batch_size": 16,
    "learning_starts": 40,
    "seed": 0,
    "device": "cpu",
}
TINY_ENCODER = {
    "bruno": {"encoder_kwargs": TINY_BRUNO, "encoder_batch_size": 4},
    "recurrent": {"encoder_kwargs": {"hidden_size": 8}},
    "product_of_gaussians": {"encoder_kwargs": {"net_arch": (16,)}},
    "recurrent_vae": {"encoder_kwargs": {"hidden_size": 8}},
    "supervised_belief": {"encoder_kwargs": {"hidden_size": 8}},
}
LEARNED = {
    "bruno": {"encoder/bound_nats", "belief/var"},
    "recurrent": {"encoder/gradient_norm"},
    "product_of_gaussians": {"encoder/gradient_norm", "encoder/kl_nats", "belief/var"},
    "recurrent_vae": {"encoder/kl_nats", "encoder/squared_error", "belief/var"},
    "supervised_belief": {"encoder/task_nats", "belief/var"},
}
"""What is logged of what an encoder learns."""
LSTM = {"encoder_kwargs": {"cell": "lstm"}}
OF_ITS_OWN_LOSS = {"encoder_batch_size", "encoder_update_ratio", "encoder_learning_starts"}


def name_of(options):
    """A test's name, the same in every process: without the addresses of functions."""
    return re.sub(r" at 0x[0-9a-f]+", "", str(options))


def make_pendulum():
    return Monitor(TransitionObservation(MetaTask(gym.make("Pendulum-v1", max_episode_steps=25))))


def make_point():
    return Monitor(gym.make(POINT))


def tiny(algorithm, **kwargs):
    """The arguments of a tiny model; dicts are merged into those of ``TINY`` and ``TINY_ENCODER``."""
    settings = {**TINY, **TINY_ENCODER[algorithm.default_encoder]}
    merged = {key: {**settings[key], **value} if isinstance(value, dict) else value for key, value in kwargs.items()}
    return {**settings, **merged}


def for_each(algorithms):
    """Run a test for some of the algorithms only."""
    names = [algorithm.__name__ for algorithm in algorithms]
    return pytest.mark.parametrize("algorithm", algorithms, indirect=True, ids=names, scope="module")


def for_each_that_takes(*options, algorithms=EACH_KIND):
    """Run a test for algorithms with each of the options that they have the arguments for."""
    pairs = [(algorithm, option) for algorithm in algorithms for option in options if takes(algorithm, option)]
    names = [f"{algorithm.__name__}-{name_of(option)}" for algorithm, option in pairs]
    return pytest.mark.parametrize(("algorithm", "options"), pairs, indirect=["algorithm"], ids=names, scope="module")


def for_each_in_turn(name, values):
    """Run a test once for an algorithm of each kind, with one of the values each: all of them have their turn."""
    pairs = list(zip(EACH_KIND, cycle(values), strict=False))
    names = [f"{algorithm.__name__}-{name_of(value)}" for algorithm, value in pairs]
    return pytest.mark.parametrize(("algorithm", name), pairs, indirect=["algorithm"], ids=names, scope="module")


def takes(algorithm, options):
    """Whether an algorithm has arguments of these names, and its encoder those of ``encoder_kwargs``."""
    encoder = find_encoder(algorithm.default_encoder)
    arguments = set(inspect.signature(algorithm).parameters)
    if encoder.learns_from != "own":
        arguments -= OF_ITS_OWN_LOSS
    encoder_kwargs = options.get("encoder_kwargs", {})
    return options.keys() <= arguments and encoder_kwargs.keys() <= inspect.signature(encoder).parameters.keys()


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


def assert_carries(model, lengths):
    """The agent carries what its encoder makes of its running episodes, all but the newest transition of each."""
    slots, found = model.replay_buffer.episodes.running()
    assert found.tolist() == lengths
    absorbed = model.replay_buffer.to_torch(model.replay_buffer.absorbed(slots)).float()
    with th.no_grad():
        prefixes = model.encoder.prefixes(model.replay_buffer.transitions(slots), absorbed)
    known = th.as_tensor(found) - 1
    assert_close(model._carried.memory, map_memory(lambda states: states[th.arange(len(known)), known], prefixes))


def assert_close(memory, expected):
    """Two memories are equal up to rounding. The sums of a process with a kernel are kept in two floats each."""
    for found, known in zip(sums_of(memory), sums_of(expected), strict=True):
        th.testing.assert_close(found, known, rtol=1e-4, atol=1e-4)


def sums_of(memory):
    return (memory.sums,) if isinstance(memory, KernelStatistics) else memory


def n_absorbed(model, memory):
    """How many transitions a BRUNO encoder's memory has absorbed, for each env."""
    variables = model.encoder.model.variables
    return (memory.sums[:, -1] / (variables.reward_dim + variables.change_dim)).round().int().tolist()


def assert_same(found, expected):
    """Two nests of dicts, lists, tensors and numbers are equal, bit for bit."""
    if isinstance(found, dict):
        assert found.keys() == expected.keys()
        found, expected = list(found.values()), list(expected.values())
    if isinstance(found, list | tuple):
        assert len(found) == len(expected)
        for a, b in zip(found, expected, strict=True):
            assert_same(a, b)
    else:
        np.testing.assert_array_equal(found, expected)

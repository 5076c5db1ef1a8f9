"""Writes an agent as plain data and tensors, reads that data, and builds the agent by its algorithm's constructor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium as gym
import torch as th
from gymnasium import spaces
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv
from torch import Tensor

from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.evaluation.versions import library_versions
from sb3_bruno.export.arguments import arguments_of, check_arguments
from sb3_bruno.export.classes import Unknown, find, key_of
from sb3_bruno.export.first_step import run_first_step
from sb3_bruno.export.limits import LARGEST_STEP, Budget
from sb3_bruno.export.normalization import normalized, write_normalization
from sb3_bruno.export.plain import from_plain, to_plain
from sb3_bruno.export.readout import add_readout, check_tasks, write_readout
from sb3_bruno.export.space_json import read_box, read_space, write_space
from sb3_bruno.export.tensors import put_tensors, tensors_of
from sb3_bruno.files.shown import shown

FORMAT = "sb3_bruno agent"
VERSION = 1
_KEYS = {
    "format",
    "version",
    "algorithm",
    "policy",
    "arguments",
    "observation_space",
    "action_space",
    "task_space",
    "normalization",
    "readout",
    "num_timesteps",
    "seed",
    "versions",
}
_NO_BUFFER = 1  # transitions, where there is no env to store any of


def write_agent(model: TaskInference) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Write an agent as plain data, and its tensors by name.

    Raises:
        ValueError: if it is no plain data, or would not be read again.
    """
    policies, policy = type(model).policy_aliases, type(model.policy)
    usual = next((name for name, known in policies.items() if known is policy), None)
    vec_normalize = model.get_vec_normalize_env()
    normalization, statistics = (None, {}) if vec_normalize is None else write_normalization(vec_normalize)
    arguments = arguments_of(model)
    check_arguments(type(model), arguments)
    written = {
        "format": FORMAT,
        "version": VERSION,
        "algorithm": key_of(type(model), "model"),
        "policy": usual or key_of(policy, "policy"),
        "arguments": {name: to_plain(value, name) for name, value in arguments.items()},
        "observation_space": write_space(model.observation_space, "observation_space"),
        "action_space": write_space(model.action_space, "action_space"),
        "task_space": write_space(model.task_space, "task_space"),
        "normalization": normalization,
        "readout": write_readout(model),
        "num_timesteps": to_plain(model.num_timesteps, "num_timesteps"),
        "seed": to_plain(model.seed, "seed"),
        "versions": library_versions(),
    }
    return written, {**tensors_of(model), **{f"normalization.{name}": value for name, value in statistics.items()}}


class WrittenAgent(NamedTuple):
    """An agent as a file tells it.

    Attributes:
        algorithm: its class.
        policy: the class of its policy, or its usual name.
        arguments: of the algorithm, by name.
        observation_space: of its env.
        action_space: of its env.
        task_space: of its env.
        normalization: the settings of VecNormalize as JSON; None without one.
        readout: what its read-out of the task was made with, as JSON; None without one.
        num_timesteps: env steps that it was trained for.
        seed: of its training.
    """

    algorithm: type[TaskInference]
    policy: Any
    arguments: dict[str, Any]
    observation_space: spaces.Dict
    action_space: spaces.Box
    task_space: spaces.Box
    normalization: Any
    readout: Any
    num_timesteps: int
    seed: int | None

    @classmethod
    def read(cls, plain: Mapping[str, Any]) -> WrittenAgent:
        """Read what ``write_agent`` wrote.

        Raises:
            ValueError: if it is not that.
        """
        version = plain.get("version")
        if plain.get("format") != FORMAT or type(version) is not int or version < 1:
            raise ValueError("it is no agent of sb3_bruno")
        if version > VERSION:
            raise Unknown(f"it is of version {version} of the format, and this sb3_bruno reads {VERSION}: update it")
        if set(plain) != _KEYS:
            raise ValueError(f"it has too much or too little: {shown(sorted(set(plain) ^ _KEYS))}")
        algorithm = find("algorithm", plain["algorithm"])
        policy = plain["policy"]
        if not (isinstance(policy, str) and policy in algorithm.policy_aliases):
            policy = find("policy", policy)
        arguments = from_plain(plain["arguments"])
        if not isinstance(arguments, dict):
            raise ValueError("its arguments have no names")
        check_arguments(algorithm, arguments)
        observation_space = read_space(plain["observation_space"])
        if not isinstance(observation_space, spaces.Dict):
            raise ValueError("its observation space is no Dict")
        counted, seed = plain["num_timesteps"], plain["seed"]
        if type(counted) is not int or counted < 0 or not (seed is None or type(seed) is int):
            raise ValueError("its env steps or its seed are no whole numbers")
        boxes = read_box(plain["action_space"]), read_box(plain["task_space"])
        return cls(
            algorithm,
            policy,
            arguments,
            observation_space,
            *boxes,
            plain["normalization"],
            plain["readout"],
            counted,
            seed,
        )

    def build(self, tensors: dict[str, Tensor], venv: VecEnv | None, device: th.device | str) -> TaskInference:
        """Build the agent, and put its tensors into it.

        Raises:
            Exception: of any kind, if a constructor refuses its arguments, or tensors are not those of the agent.
        """
        arguments = self.arguments if venv is not None else {**self.arguments, "buffer_size": _NO_BUFFER}
        env: VecEnv = venv if venv is not None else DummyVecEnv([lambda: _Nowhere(self)])
        statistics = {name: tensor for name, tensor in tensors.items() if name.startswith("normalization.")}
        if self.normalization is not None:
            own = {name.removeprefix("normalization."): tensors.pop(name) for name in statistics}
            env = normalized(env, self.normalization, own)
        with Budget(tensors), th.random.fork_rng(devices=[]):
            model = self.algorithm(self.policy, env, device=device, task_readout=False, **arguments)
            add_readout(model, self.readout)
        put_tensors(model, tensors)
        check_tasks(model)
        with Budget(tensors, LARGEST_STEP):
            run_first_step(model)
        model.num_timesteps, model.seed = self.num_timesteps, self.seed
        if venv is None:
            model.env, model.replay_buffer = None, None  # type: ignore[assignment]  # there is nothing to learn from
            model.buffer_size = self.arguments["buffer_size"]
        model.warn_of_other_tasks()
        return model


class _Nowhere(gym.Env[Any, Any]):
    """Has the spaces of an agent's env, for an agent that is loaded without one. Nothing happens in it."""

    def __init__(self, agent: WrittenAgent) -> None:
        self.observation_space = agent.observation_space
        self.action_space = agent.action_space
        self.task_space = agent.task_space

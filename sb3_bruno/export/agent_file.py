"""Saves an agent as plain data, to load it where its author need not be trusted: no code of the file is run.

A file is a zip archive of JSON and tensors (``archive.py``). It names classes by keys (``classes.py``), and the agent
is built by its algorithm's constructor, from plain arguments that the constructor checks.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import safetensors.torch
import torch as th
from gymnasium import spaces
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.common.utils import check_for_correct_spaces
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, unwrap_vec_normalize
from torch import Tensor

from sb3_bruno.algorithms.checks import read_task_space
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.evaluation.versions import library_versions
from sb3_bruno.export.archive import read_archive, write_archive
from sb3_bruno.export.arguments import arguments_of, check_arguments
from sb3_bruno.export.classes import Unknown, find, key_of
from sb3_bruno.export.limits import LARGEST_BUFFER, Budget
from sb3_bruno.export.normalization import normalized, write_normalization
from sb3_bruno.export.plain import from_plain, read_json, to_plain
from sb3_bruno.export.readout import add_readout, write_readout
from sb3_bruno.export.space_json import read_box, read_space, write_space
from sb3_bruno.export.tensors import put_tensors, read_tensors, tensors_of

FORMAT = "sb3_bruno agent"
VERSION = 1
SUFFIX = ".agent"
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


def save_agent(model: TaskInference, path: str | Path) -> None:
    """Save what an agent acts with: policy, encoder, the normalisation of its observations, and how it was made.

    Optimisers and replay buffer are not saved: to go on with a training, use checkpoints.

    Args:
        model: the agent, of an algorithm of this package or one that ``register_agent_class`` knows.
        path: where to write it, by custom ``NAME.agent``.

    Raises:
        TypeError: if ``model`` is no algorithm with task inference.
        ValueError: if an argument of it is no plain data, such as a function, or a class that has no key; a weight is
            not finite; or the file cannot be written.
    """
    if not isinstance(model, TaskInference):
        raise TypeError(f"`model={model!r}` is no agent that infers a task: save it by its own `save`.")
    try:
        written, tensors = _write(model)
        data = safetensors.torch.save(tensors)
        write_archive(Path(path), json.dumps(written, indent=1, allow_nan=False).encode(), data)
    except OSError as error:
        raise ValueError(
            f"`path={str(path)!r}` cannot be written ({error.strerror or error}): give another."
        ) from error
    except ValueError as error:
        raise ValueError(f"The agent cannot be saved as {str(path)!r}: {error}.") from error


def load_agent(path: str | Path, env: GymEnv | None = None, device: th.device | str = "auto") -> TaskInference:
    """Load an agent that ``save_agent`` saved. Nothing in the file is run, whoever wrote it.

    The agent acts, and tells what it believes. If its observations were normalised, it takes normalised ones:
    ``load_agent(path, env).get_env()`` gives them, as does ``agent.get_vec_normalize_env().normalize_obs(...)``.
    With an ``env`` it may also learn, but from the start: with a new replay buffer, new optimisers and no schedule that
    is half over.

    Args:
        path: the file.
        env: an env like that of its training, without VecNormalize, which the file brings; None for none.
        device: as in SB3.

    Raises:
        ValueError: if the file is not as ``save_agent`` writes it, of a newer version, or of a class that is not
            registered here; or ``env`` is not like that of its training.
    """
    venv = None if env is None else TaskInference._wrap_env(env)
    if venv is not None and unwrap_vec_normalize(venv) is not None:
        raise ValueError("`env` has a VecNormalize, and the file brings the agent's own: give the env without it.")
    try:
        written, data = read_archive(Path(path))
        agent = _Written.read(read_json(written))
        tensors = read_tensors(data)
    except Exception as error:  # a damaged or hostile file may raise anything
        raise _refusal(path, error) from error
    if venv is not None:
        check_for_correct_spaces(venv, agent.observation_space, agent.action_space)
        read_task_space(venv, agent.task_space)
        buffer_size = agent.arguments["buffer_size"]
        if buffer_size > LARGEST_BUFFER:
            raise ValueError(f"{str(path)!r} has `buffer_size={buffer_size:,}`, too many: load it without an `env`.")
    try:
        return agent.build(tensors, venv, device)
    except Exception as error:
        raise _refusal(path, error) from error


def _refusal(path: str | Path, error: Exception) -> ValueError:
    told = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    remedy = "" if isinstance(error, Unknown) else " Get another copy of it."
    return ValueError(f"{str(path)!r} cannot be loaded as an agent: {told[:500].rstrip('.')}.{remedy}")


def _write(model: TaskInference) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Write an agent as plain data, and its tensors by name."""
    policies, policy = type(model).policy_aliases, type(model.policy)
    usual = next((name for name, known in policies.items() if known is policy), None)
    vec_normalize = model.get_vec_normalize_env()
    normalization, statistics = (None, {}) if vec_normalize is None else write_normalization(vec_normalize)
    written = {
        "format": FORMAT,
        "version": VERSION,
        "algorithm": key_of(type(model), "model"),
        "policy": usual or key_of(policy, "policy"),
        "arguments": {name: to_plain(value, name) for name, value in arguments_of(model).items()},
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


class _Written(NamedTuple):
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
    def read(cls, plain: Mapping[str, Any]) -> _Written:
        """Read what ``_write`` wrote.

        Raises:
            ValueError: if it is not that.
        """
        version = plain.get("version")
        if plain.get("format") != FORMAT or type(version) is not int or version < 1:
            raise ValueError("it is no agent of sb3_bruno")
        if version > VERSION:
            raise Unknown(f"it is of version {version} of the format, and this sb3_bruno reads {VERSION}: update it")
        if set(plain) != _KEYS:
            raise ValueError(f"it has too much or too little: {', '.join(sorted(set(plain) ^ _KEYS))[:200]}")
        algorithm = find("algorithm", plain["algorithm"])
        policy = plain["policy"]
        if policy not in algorithm.policy_aliases:
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
        model.num_timesteps, model.seed = self.num_timesteps, self.seed
        if venv is None:
            model.env, model.replay_buffer = None, None  # type: ignore[assignment]  # there is nothing to learn from
            model.buffer_size = self.arguments["buffer_size"]
        return model


class _Nowhere(gym.Env[Any, Any]):
    """Has the spaces of an agent's env, for an agent that is loaded without one. Nothing happens in it."""

    def __init__(self, agent: _Written) -> None:
        self.observation_space = agent.observation_space
        self.action_space = agent.action_space
        self.task_space = agent.task_space

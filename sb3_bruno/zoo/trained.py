"""A trained agent found in rl_zoo3's log folder, with the environment and the tasks that it is to be tested on."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import rl_zoo3
import torch as th
import yaml
from huggingface_sb3 import EnvironmentName
from numpy.typing import NDArray
from rl_zoo3.utils import get_model_path, get_saved_hyperparams
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno.runs.clock import TrainingClock
from sb3_bruno.runs.origin import trained_at
from sb3_bruno.zoo.configs import config_file, config_name, read_configs
from sb3_bruno.zoo.one_line import in_one_line
from sb3_bruno.zoo.registry import import_packages


class TrainedAgent(NamedTuple):
    """An agent and its test.

    :ivar model: the agent, on the CPU
    :ivar make_env: makes a test environment
    :ivar tasks: all tasks of the split, (n_tasks, task_dim)
    :ivar inside: which of them the training tasks surround
    :ivar n_inner: episodes of a trial, 1 where episodes are no trials
    :ivar vec_normalize: the training environment's, if it had one
    :ivar folder: of the run
    :ivar config: what tells this run from others, JSON values
    """

    model: BaseAlgorithm
    make_env: Callable[..., gym.Env[Any, Any]]
    tasks: NDArray[np.float32]
    inside: NDArray[np.bool_]
    n_inner: int
    vec_normalize: VecNormalize | None
    folder: Path
    config: dict[str, Any]


def load_trained(options: argparse.Namespace) -> TrainedAgent:
    """The agent that the flags choose.

    :raises ValueError: if there is none that can be loaded, or its environment has no list of tasks or is of trials and
        ``--steps`` would cut them
    """
    th.set_num_threads(1)
    env_name = EnvironmentName(options.env)
    try:
        _, model_path, folder = get_model_path(
            options.exp_id, options.folder, options.algo, env_name, options.load_best
        )
    except (AssertionError, ValueError) as error:
        raise ValueError(str(error)) from error
    params = Path(folder) / env_name
    import_packages(_arguments(params).get("gym_packages", []))
    env_kwargs = _env_kwargs(params) | {"split": options.split}
    if options.steps is not None:
        env_kwargs["max_episode_steps"] = options.steps
    make_env = partial(gym.make, env_name.gym_id, **env_kwargs)
    tasks, inside, n_inner = _tasks(make_env, options.split)
    if options.steps is not None and n_inner > 1:
        raise ValueError(f"--steps {options.steps}: a trial is as long as its {n_inner} episodes, so leave it out")
    model = _load(options.algo, model_path)
    clock = TrainingClock.of_run(Path(folder))
    config = {
        "algo": options.algo,
        **_given(params, options.algo, env_name.gym_id),
        "env": env_name.gym_id,
        "split": options.split,
        "env_steps": model.num_timesteps,
        "seed": model.seed,
        "wall_seconds": None if clock is None else float(clock.seconds[-1]),
        "trained_at": trained_at(Path(folder)),
        "inside_train_box": inside.tolist(),
        "n_inner_episodes": n_inner,
    }
    return TrainedAgent(model, make_env, tasks, inside, n_inner, _vec_normalize(params, make_env), Path(folder), config)


def _tasks(make_env: Callable[[], gym.Env[Any, Any]], split: str) -> tuple[NDArray[np.float32], NDArray[np.bool_], int]:
    """All tasks of a split, (n_tasks, task_dim), which of them lie between training tasks, episodes per trial.

    :raises ValueError: if the environment has no list of them
    """
    try:
        env = make_env()
        distribution = env.get_wrapper_attr("task_distribution")
        tasks: NDArray[np.float32] = distribution.tasks(split)
    except (TypeError, AttributeError) as error:
        raise ValueError(f"the environment has no list of {split} tasks to test on: {error}") from error
    n_inner = env.get_wrapper_attr("n_episodes") if env.has_wrapper_attr("n_episodes") else 1
    env.close()
    return tasks, distribution.inside_train_box(tasks), n_inner


def _env_kwargs(params: Path) -> dict[str, Any]:
    """What the run's environment was made with, by config and command line."""
    return {**_hyperparams(params).get("env_kwargs", {}), **(_arguments(params)["env_kwargs"] or {})}


def _given(params: Path, algo: str, env_id: str) -> dict[str, Any]:
    """What tells the run from others: the config that it chose, where it differs from that, and all hyperparameters.

    From the config as it is now, whatever it was when the run was made: what a run tried and the config has taken over
    tells nothing, and what the config has changed since does. Part by part, as encoder_kwargs.belief; None where the
    config alone has it.
    """
    arguments, used = _arguments(params), dict(_hyperparams(params))
    if _env_kwargs(params):
        used["env_kwargs"] = _env_kwargs(params)
    config = _config(algo, arguments["conf_file"]).get(env_id)
    if config is None:
        differing = dict(arguments["hyperparams"] or {})
    else:
        config = _flat({"normalize": False, **config, "n_timesteps": used["n_timesteps"]})
        found = _flat(used)
        differing = {name: found.get(name) for name in {**found, **config} if found.get(name) != config.get(name)}
    chosen = {"conf": config_name(algo, arguments["conf_file"]), "params": differing, "hyperparameters": used}
    as_json: dict[str, Any] = json.loads(json.dumps(chosen, default=str))
    return as_json


def _flat(settings: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """{"a": {"b": 1}} becomes {"a.b": 1}."""
    flat: dict[str, Any] = {}
    for name, value in settings.items():
        flat |= _flat(value, f"{path}{name}.") if isinstance(value, Mapping) else {f"{path}{name}": value}
    return flat


def _config(algo: str, conf: str | None) -> dict[str, Any]:
    """What the config that a run chose says now, by environment; nothing, if it is none of ours or is gone."""
    try:
        return read_configs(config_file(algo, conf))
    except ValueError:
        return {}


def _hyperparams(params: Path) -> dict[str, Any]:
    hyperparams: dict[str, Any] = get_saved_hyperparams(str(params))[0]
    hyperparams.pop("normalize_kwargs", None)  # what rl_zoo3 reads off "normalize" for tests
    policy_kwargs = hyperparams.get("policy_kwargs")
    if isinstance(policy_kwargs, dict) and policy_kwargs.get("use_sde") is False:
        del policy_kwargs["use_sde"]  # its default, which SB3 writes into the dict that it is given
    return hyperparams


def _arguments(params: Path) -> dict[str, Any]:
    try:
        with open(params / "args.yml", encoding="utf-8") as file:
            arguments: dict[str, Any] = yaml.unsafe_load(file)  # rl_zoo3 wrote an OrderedDict
    except FileNotFoundError as error:
        raise ValueError(f"{params} has no args.yml, which `sb3-bruno train` writes: train there") from error
    return arguments


def _load(algo: str, path: str) -> BaseAlgorithm:
    try:
        model: BaseAlgorithm = rl_zoo3.ALGOS[algo].load(path, device="cpu")
    except Exception as error:  # whatever a damaged file, or one of another algorithm, makes of it
        raise ValueError(f"{path} cannot be loaded as {algo}: {in_one_line(error)}") from error
    return model


def _vec_normalize(params: Path, make_env: Any) -> VecNormalize | None:
    path = params / "vecnormalize.pkl"
    return VecNormalize.load(str(path), DummyVecEnv([make_env])) if path.is_file() else None

"""Saves a training run in one file, from which it continues exactly; a kill at any moment leaves the last one whole."""

from __future__ import annotations

import io
import pathlib
import random
import warnings
from typing import Any

import cloudpickle
import numpy as np
import torch as th
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.her.her_replay_buffer import HerReplayBuffer

from sb3_bruno.algorithms.checks import check_family
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.files.sealed import Damaged, sealing, unsealed
from sb3_bruno.resume.env_state import EnvState, restore_envs, restore_wrappers, save_envs, wrapped_alike

FORMAT = "sb3_bruno checkpoint 1"
"""The first line of a checkpoint. Its number grows when older checkpoints can no longer be read."""

_PARTS = {"class", "model", "replay_buffer", "random", "envs"}


def save_checkpoint(model: OffPolicyAlgorithm, path: str | pathlib.Path) -> None:
    """Save model, optimisers, replay buffer, counters, random states, beliefs, envs and their wrappers to one file.

    Args:
        model: a model at the start of a rollout.
        path: the file to write; an older file there stays whole until the new one replaces it.

    Raises:
        ValueError: naming an attribute of the model that cannot be pickled.
    """
    assert model.env is not None  # for mypy: a model in training has one
    archive = io.BytesIO()
    try:
        model.save(archive)
    except Exception as error:  # pickling may raise anything
        names = _unpicklable(model)
        if not names:
            raise
        raise ValueError(
            f"The model cannot be saved, for its attributes {names} cannot be pickled ({error}): keep them elsewhere."
        ) from error
    checkpoint = {
        "class": type(model),
        "model": archive.getvalue(),
        "replay_buffer": model.replay_buffer,
        "random": _random_states(model),
        "envs": save_envs(model.env),
    }
    with sealing(path, FORMAT) as file:
        cloudpickle.dump(checkpoint, file)


def _unpicklable(model: OffPolicyAlgorithm) -> list[str]:
    """Name the attributes of a model that SB3 would save and cannot."""
    state_dicts, variables = model._get_torch_save_params()
    left_out = {*model._excluded_save_params(), *(name.split(".")[0] for name in [*state_dicts, *variables])}
    names = []
    for name, value in vars(model).items():
        if name not in left_out:
            try:
                cloudpickle.dumps(value)
            except Exception:  # likewise
                names.append(name)
    return names


def resume(path: str | pathlib.Path, env: GymEnv, device: th.device | str = "auto") -> OffPolicyAlgorithm:
    """Load a checkpoint of ``ResumeCallback``; continue with ``learn(remaining, reset_num_timesteps=False)``.

    If the total number of environment steps is the same, the run equals the uninterrupted one, bit for bit on the same
    machine. There are two exceptions: gSDE's exploration matrix and correlated action noise are drawn anew.

    Environments whose state cannot be saved begin a new episode, and a warning says so. Monitors write to the files of
    ``env``. If a file was opened with ``override_existing=False``, the rows written after the checkpoint are cut off,
    except in a SubprocVecEnv.

    Args:
        path: the checkpoint file.
        env: environments made and wrapped as for the first start; an outermost VecNormalize may be left out.
        device: PyTorch device.

    Returns:
        The model, at the start of a rollout.

    Raises:
        FileNotFoundError: if there is no checkpoint at ``path``.
        ValueError: if the file is damaged or of another version, or if ``env`` has other wrappers, or another number of
            envs or Monitors, than the checkpoint, or is of another env family.

    Example:
        Continue a run of 100,000 steps:

        >>> model = resume("run/checkpoint.pkl", make_env())
        >>> model.learn(100_000 - model.num_timesteps, ResumeCallback("run/checkpoint.pkl"), reset_num_timesteps=False)
    """
    checkpoint = _read(path)
    buffer, state = checkpoint["replay_buffer"], checkpoint["envs"]
    assert isinstance(state, EnvState)  # for mypy
    vec_env = OffPolicyAlgorithm._wrap_env(env)
    if vec_env.num_envs != buffer.n_envs:
        raise ValueError(f"env has {vec_env.num_envs} envs, the checkpoint {buffer.n_envs}: make as many.")
    check_family(buffer, vec_env)
    vec_env = wrapped_alike(vec_env, state.wrappers)
    missing_because = restore_envs(vec_env, state)
    restore_wrappers(vec_env, state.wrappers)
    model: OffPolicyAlgorithm = checkpoint["class"].load(
        io.BytesIO(checkpoint["model"]), env=vec_env, device=device, force_reset=False
    )
    buffer.device = model.device
    model.replay_buffer = buffer
    if isinstance(model, TaskInference):
        model.bind_buffer()
    elif isinstance(buffer, HerReplayBuffer):
        buffer.set_env(vec_env)
    vec_env.unwrapped._reset_seeds()  # those that load has set would start the next episodes anew
    if missing_because:
        warnings.warn(f"The run goes on with a new episode, because {missing_because}.", stacklevel=2)
        model._last_obs = None
        vec_env.seed((model.seed or 0) + model.num_timesteps)  # or the first episodes would repeat
    _set_random_states(model, checkpoint["random"])
    return model


def _read(path: str | pathlib.Path) -> dict[str, Any]:
    """Unpickle a checkpoint that is as it was written; raise a ValueError that explains whatever is wrong with it."""
    remedy = "Resume from a copy, with the version that wrote it, or train anew."
    try:
        with unsealed(path, FORMAT) as file:
            checkpoint = cloudpickle.load(file)
    except Damaged as error:
        raise ValueError(
            f"path={path} is damaged, or no checkpoint of this version of sb3_bruno ({error}). {remedy}"
        ) from error
    except FileNotFoundError:
        raise
    except Exception as error:  # classes that have changed since may raise anything
        raise ValueError(
            f"path={path} cannot be read ({error}): libraries or classes have changed since it was written. {remedy}"
        ) from error
    if not isinstance(checkpoint, dict) or not checkpoint.keys() >= _PARTS:
        raise ValueError(f"path={path} holds something else than a checkpoint. {remedy}")
    return checkpoint


def _random_states(model: OffPolicyAlgorithm) -> dict[str, Any]:
    """Return the states of all generators that training draws from, by name."""
    return {
        "python": random.getstate(),
        "numpy": np.random.get_state(),  # noqa: NPY002  # what SB3 draws from
        "torch": th.get_rng_state(),
        "cuda": th.cuda.get_rng_state_all() if th.cuda.is_available() else [],
        "action_space": model.action_space.np_random.bit_generator.state,
    }


def _set_random_states(model: OffPolicyAlgorithm, states: dict[str, Any]) -> None:
    """Restore the states of all generators; those of the GPUs only if there are as many GPUs as before."""
    random.setstate(states["python"])
    np.random.set_state(states["numpy"])  # noqa: NPY002
    th.set_rng_state(states["torch"])
    if th.cuda.is_available() and len(states["cuda"]) == th.cuda.device_count():
        th.cuda.set_rng_state_all(states["cuda"])
    model.action_space.np_random.bit_generator.state = states["action_space"]

"""Exact resume: a checkpoint of everything a training run stands on, whole after a kill at any moment."""

from __future__ import annotations

import io
import os
import pathlib
import random
import warnings
from typing import Any

import cloudpickle
import numpy as np
import torch as th
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.her.her_replay_buffer import HerReplayBuffer

from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.resume.env_state import EnvState, restore_envs, restore_wrappers, save_envs


class ResumeCallback(BaseCallback):
    """Keep a checkpoint from which ``resume`` goes on as if nothing had happened.

    It is taken at the start of a rollout, where no transition is half stored, written to a temporary file and
    renamed, so that the file at ``path`` is whole whenever the process dies.

    :param path: the checkpoint file; each checkpoint replaces the last
    :param save_freq: env steps between checkpoints
    :param verbose: 1 to print a line per checkpoint
    :raises ValueError: if ``save_freq`` is not positive, or the model is not off-policy
    """

    def __init__(self, path: str | pathlib.Path, save_freq: int = 10_000, verbose: int = 0) -> None:
        super().__init__(verbose)
        if save_freq < 1:
            raise ValueError(f"`save_freq` must be at least 1 env step, got {save_freq}.")
        self.path = pathlib.Path(path)
        self.save_freq = save_freq
        self._saved_at = 0

    def _init_callback(self) -> None:
        if not isinstance(self.model, OffPolicyAlgorithm):
            raise ValueError(
                f"Only off-policy algorithms can be resumed exactly, got {type(self.model).__name__}: use SB3's "
                "CheckpointCallback."
            )

    def _on_training_start(self) -> None:
        self._saved_at = self.num_timesteps

    def _on_rollout_start(self) -> None:
        if self.model.num_timesteps - self._saved_at < self.save_freq:
            return
        self._saved_at = self.model.num_timesteps
        assert isinstance(self.model, OffPolicyAlgorithm)  # checked at the start
        save_checkpoint(self.model, self.path)
        if self.verbose > 0:
            print(f"Checkpoint at {self._saved_at} env steps: {self.path}")

    def _on_step(self) -> bool:
        return True


def save_checkpoint(model: OffPolicyAlgorithm, path: str | pathlib.Path) -> None:
    """Save model, optimisers, replay buffer, counters, random states, beliefs, envs and their wrappers to one file.

    :param model: a model that is at the start of a rollout
    :param path: the file; an older one there stays whole until the new one takes its place
    """
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    assert model.env is not None  # it is at the start of a rollout
    archive = io.BytesIO()
    model.save(archive)
    checkpoint = {
        "class": type(model),
        "model": archive.getvalue(),
        "replay_buffer": model.replay_buffer,
        "random": _random_states(model),
        "envs": save_envs(model.env),
    }
    unfinished = path.with_name(path.name + ".tmp")  # one a kill left behind is overwritten
    with open(unfinished, "wb") as file:
        cloudpickle.dump(checkpoint, file)
        file.flush()
        os.fsync(file.fileno())
    os.replace(unfinished, path)


def resume(path: str | pathlib.Path, env: GymEnv, device: th.device | str = "auto") -> OffPolicyAlgorithm:
    """Load a checkpoint of ``ResumeCallback``; go on with ``learn(remaining, reset_num_timesteps=False)``.

    With the same total of env steps the run equals the uninterrupted one, bit for bit on the same machine (gSDE's
    exploration matrix and correlated action noise excepted: they are drawn anew). Envs whose state cannot be saved
    go on with a new episode, which a warning says. Monitors write to the files of ``env``; where these were opened
    with ``override_existing=False``, rows written after the checkpoint are cut off, but for those of a SubprocVecEnv.

    Example: a run of 100,000 steps goes on with

        >>> model = resume("run/checkpoint.pkl", make_env())
        >>> model.learn(100_000 - model.num_timesteps, ResumeCallback("run/checkpoint.pkl"), reset_num_timesteps=False)

    :param path: the checkpoint file
    :param env: envs made and wrapped as they were for the first start; an outermost VecNormalize may be left out
    :param device: PyTorch device
    :return: the model, at the start of a rollout
    :raises FileNotFoundError: if there is no checkpoint at ``path``
    :raises ValueError: if the file is damaged or of another version, or ``env`` has other wrappers, or another number
        of envs or Monitors, than the checkpoint
    """
    checkpoint = _read(path)
    buffer, state = checkpoint["replay_buffer"], checkpoint["envs"]
    assert isinstance(state, EnvState)  # for mypy
    vec_env = OffPolicyAlgorithm._wrap_env(env)
    if vec_env.num_envs != buffer.n_envs:
        raise ValueError(f"`env` has {vec_env.num_envs} envs, the checkpoint {buffer.n_envs}: make as many.")
    vec_env = restore_wrappers(vec_env, state.wrappers)
    model: OffPolicyAlgorithm = checkpoint["class"].load(
        io.BytesIO(checkpoint["model"]), env=vec_env, device=device, force_reset=False
    )
    buffer.device = model.device
    model.replay_buffer = buffer
    if isinstance(model, TaskInference):
        model.bind_buffer()
    elif isinstance(buffer, HerReplayBuffer):
        buffer.set_env(vec_env)
    restore_envs(vec_env, state)
    if state.envs is None:
        warnings.warn(f"The run goes on with a new episode, because {state.missing_because}.", stacklevel=2)
        model._last_obs = None
        vec_env.seed((model.seed or 0) + model.num_timesteps)  # or the run's first episodes would come again
    _set_random_states(model, checkpoint["random"])
    return model


def _read(path: str | pathlib.Path) -> dict[str, Any]:
    with open(path, "rb") as file:
        try:
            checkpoint: dict[str, Any] = cloudpickle.load(file)
        except Exception as error:  # whatever bytes cut short, or classes that have changed since, make of it
            raise ValueError(
                f"{path} cannot be read ({error}): it is damaged, or of another version of sb3_bruno. Go on with the "
                "version that wrote it."
            ) from error
    return checkpoint


def _random_states(model: OffPolicyAlgorithm) -> dict[str, Any]:
    return {
        "python": random.getstate(),
        "numpy": np.random.get_state(),  # noqa: NPY002  # what SB3 draws from
        "torch": th.get_rng_state(),
        "cuda": th.cuda.get_rng_state_all() if th.cuda.is_available() else [],
        "action_space": model.action_space.np_random.bit_generator.state,
    }


def _set_random_states(model: OffPolicyAlgorithm, states: dict[str, Any]) -> None:
    random.setstate(states["python"])
    np.random.set_state(states["numpy"])  # noqa: NPY002
    th.set_rng_state(states["torch"])
    if th.cuda.is_available() and len(states["cuda"]) == th.cuda.device_count():
        th.cuda.set_rng_state_all(states["cuda"])
    model.action_space.np_random.bit_generator.state = states["action_space"]

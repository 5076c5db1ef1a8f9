"""Exact resume: a checkpoint of everything a training run stands on, whole after a kill at any moment."""

from __future__ import annotations

import io
import os
import pathlib
import random
import tempfile
import warnings
from typing import Any

import cloudpickle
import numpy as np
import torch as th
from gymnasium import Env, Wrapper
from gymnasium.utils import EzPickle
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecNormalize

from sb3_bruno.task_inference import TaskInference


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
    """Save model, optimisers, replay buffer, VecNormalize, counters, random states, beliefs and envs to one file.

    :param model: a model that is at the start of a rollout
    :param path: the file; an older one there stays whole until the new one takes its place
    """
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    archive = io.BytesIO()
    model.save(archive)
    envs, why_not = _pickle_envs(model.env)
    checkpoint = {
        "class": type(model),
        "model": archive.getvalue(),
        "replay_buffer": model.replay_buffer,
        "vec_normalize": model.get_vec_normalize_env(),
        "random": _random_states(model),
        "envs": envs,
        "envs_missing_because": why_not,
        "monitor_sizes": _monitor_sizes(model.env),
    }
    if model.get_vec_normalize_env() is not None:
        checkpoint["returns"] = model.get_vec_normalize_env().returns  # type: ignore[union-attr]  # not None
    with tempfile.NamedTemporaryFile(dir=path.parent, prefix=path.name, delete=False) as file:
        try:
            cloudpickle.dump(checkpoint, file)
            file.flush()
            os.fsync(file.fileno())
            os.replace(file.name, path)
        except BaseException:
            os.unlink(file.name)
            raise


def resume(path: str | pathlib.Path, env: GymEnv, device: th.device | str = "auto") -> OffPolicyAlgorithm:
    """Load a checkpoint of ``ResumeCallback``; go on with ``learn(remaining, reset_num_timesteps=False)``.

    With the same total of env steps the run equals the uninterrupted one, bit for bit on the same machine (gSDE's
    exploration matrix and correlated action noise excepted: they are drawn anew). Envs whose state cannot be saved
    go on with a new episode, which a warning says. Monitors write to the files of ``env``; where these were opened
    with ``override_existing=False``, rows written after the checkpoint are cut off.

    Example: a run of 100,000 steps goes on with

        >>> model = resume("run/checkpoint.pkl", make_env())
        >>> model.learn(100_000 - model.num_timesteps, ResumeCallback("run/checkpoint.pkl"), reset_num_timesteps=False)

    :param path: the checkpoint file
    :param env: envs made as they were for the first start; a VecNormalize around them may be left out
    :param device: PyTorch device
    :return: the model, at the start of a rollout
    :raises FileNotFoundError: if there is no checkpoint at ``path``
    :raises ValueError: if ``env`` has another number of envs than the checkpoint
    """
    with open(path, "rb") as file:
        checkpoint = cloudpickle.load(file)
    vec_env = OffPolicyAlgorithm._wrap_env(env)
    if checkpoint["vec_normalize"] is not None:
        vec_env = _renew_vec_normalize(checkpoint["vec_normalize"], checkpoint["returns"], vec_env)
    model: OffPolicyAlgorithm = checkpoint["class"].load(
        io.BytesIO(checkpoint["model"]), env=vec_env, device=device, force_reset=False
    )
    buffer = checkpoint["replay_buffer"]
    if vec_env.num_envs != buffer.n_envs:
        raise ValueError(f"`env` has {vec_env.num_envs} envs, the checkpoint {buffer.n_envs}: make as many.")
    buffer.device = model.device
    model.replay_buffer = buffer
    if isinstance(model, TaskInference):
        model.bind_buffer()
    if checkpoint["envs"] is None:
        warnings.warn(
            f"The run goes on with a new episode, because {checkpoint['envs_missing_because']}.", stacklevel=2
        )
        model._last_obs = None
    else:
        inner = _innermost(vec_env)
        _cut_monitors(inner, checkpoint["monitor_sizes"])
        writers = [monitor.results_writer for monitor in _monitors(inner)]
        inner.envs = cloudpickle.loads(checkpoint["envs"])
        for monitor, writer in zip(_monitors(inner), writers, strict=True):
            monitor.results_writer = writer
        inner._reset_seeds()
    _set_random_states(model, checkpoint["random"])
    return model


def _innermost(vec_env: VecEnv) -> DummyVecEnv:
    inner = vec_env.unwrapped
    assert isinstance(inner, DummyVecEnv)  # or its envs would not have been pickled
    return inner


def _renew_vec_normalize(saved: VecNormalize, returns: np.ndarray, vec_env: VecEnv) -> VecNormalize:
    saved.set_venv(vec_env.venv if isinstance(vec_env, VecNormalize) else vec_env)
    saved.returns = returns
    return saved


def _pickle_envs(vec_env: VecEnv | None) -> tuple[bytes | None, str]:
    """The envs as bytes, or None and the reason why their state cannot be saved."""
    inner = vec_env.venv if isinstance(vec_env, VecNormalize) else vec_env
    if not isinstance(inner, DummyVecEnv):
        return None, f"the state of envs inside {type(inner).__name__} cannot be reached"
    for env in inner.envs:
        for layer in _layers(env):
            # EzPickle makes a new env of the constructor's arguments: the state in between is lost.
            if isinstance(layer, EzPickle) and type(layer).__getstate__ is EzPickle.__getstate__:
                return None, f"{type(layer).__name__} pickles its constructor's arguments and not its state"
    monitors = _monitors(inner)
    writers = [monitor.results_writer for monitor in monitors]
    for monitor in monitors:
        monitor.results_writer = None  # an open file cannot be pickled
    try:
        return cloudpickle.dumps(inner.envs), ""
    except Exception as error:  # whatever a user's env raises when it is pickled
        return None, f"the envs cannot be pickled ({error})"
    finally:
        for monitor, writer in zip(monitors, writers, strict=True):
            monitor.results_writer = writer


def _monitors(vec_env: DummyVecEnv) -> list[Monitor[Any, Any]]:
    return [layer for env in vec_env.envs for layer in _layers(env) if isinstance(layer, Monitor)]


def _monitor_sizes(vec_env: VecEnv | None) -> list[int]:
    """How far each Monitor's file has been written, in bytes; 0 where there is none."""
    inner = vec_env.venv if isinstance(vec_env, VecNormalize) else vec_env
    writers = [one.results_writer for one in _monitors(inner)] if isinstance(inner, DummyVecEnv) else []
    return [0 if writer is None else writer.file_handler.tell() for writer in writers]


def _cut_monitors(vec_env: DummyVecEnv, sizes: list[int]) -> None:
    for monitor, size in zip(_monitors(vec_env), sizes, strict=True):
        writer = monitor.results_writer
        if writer is not None and writer.file_handler.mode.startswith("a"):
            writer.file_handler.truncate(min(size, writer.file_handler.tell()))


def _layers(env: Env[Any, Any]) -> list[Env[Any, Any]]:
    layers = [env]
    while isinstance(layers[-1], Wrapper):
        layers.append(layers[-1].env)
    return layers


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

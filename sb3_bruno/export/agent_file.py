"""Saves an agent as plain data, to load it where its author need not be trusted: no code of the file is run.

A file is a zip archive of JSON and tensors (``archive.py``). It names classes by keys (``classes.py``), and the agent
is built by its algorithm's constructor, from plain arguments that the constructor checks.
"""

from __future__ import annotations

import json
import os
import warnings
from pathlib import Path

import safetensors.torch
import torch as th
from stable_baselines3.common.base_class import maybe_make_env
from stable_baselines3.common.type_aliases import GymEnv
from stable_baselines3.common.utils import check_for_correct_spaces
from stable_baselines3.common.vec_env import unwrap_vec_normalize
from torch import Tensor

from sb3_bruno.algorithms.checks import read_task_space
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.export.archive import read_archive, write_archive
from sb3_bruno.export.classes import Unknown
from sb3_bruno.export.limits import LARGEST_BUFFER
from sb3_bruno.export.plain import read_json
from sb3_bruno.export.tensors import read_tensors
from sb3_bruno.export.written_agent import WrittenAgent, write_agent
from sb3_bruno.files.shown import printable


def save_agent(model: TaskInference, path: str | Path) -> None:
    """Save what an agent acts with: policy, encoder, the normalisation of its observations, and how it was made.

    Optimisers and replay buffer are not saved: to go on with a training, use checkpoints. The agent is loaded again
    before the file is written, so that what is saved can be loaded.

    Args:
        model: the agent, of an algorithm of this package or one that ``register_agent_class`` knows.
        path: where to write it, by custom ``NAME.agent``.

    Raises:
        TypeError: if ``model`` is no algorithm with task inference, or ``path`` no path.
        ValueError: if an argument of it is no plain data, such as a function, or a class that has no key; a weight is
            not finite; ``load_agent`` would refuse the file, as it does if the agent asks for much memory; or the file
            cannot be written.
    """
    if not isinstance(model, TaskInference):
        raise TypeError(f"`model={model!r}` is no agent that infers a task: save it by its own `save`.")
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"`path={path!r}` is no path: give the name of a file, such as 'mine.agent'.")
    try:
        written, tensors = write_agent(model)
        content = json.dumps(written, indent=1, allow_nan=False).encode(), safetensors.torch.save(tensors)
        _load_again(*content)
        write_archive(Path(path), *content)
    except OSError as error:
        raise ValueError(
            f"`path={str(path)!r}` cannot be written ({error.strerror or error}): give another."
        ) from error
    except ValueError as error:
        raise ValueError(f"The agent cannot be saved as {str(path)!r}: {error}.") from error


def load_agent(path: str | Path, env: GymEnv | str | None = None, device: th.device | str = "auto") -> TaskInference:
    """Load an agent that ``save_agent`` saved. Nothing in the file is run, whoever wrote it.

    The agent acts, and tells what it believes. If its observations were normalised, it takes normalised ones:
    ``load_agent(path, env).get_env()`` gives them, as does ``agent.get_vec_normalize_env().normalize_obs(...)``.
    With an ``env`` it may also learn, but from the start: with a new replay buffer, new optimisers and no schedule that
    is half over.

    Args:
        path: the file.
        env: an env like that of its training, or the id of one, without VecNormalize, which the file brings; None for
            none.
        device: as in SB3.

    Raises:
        ValueError: if the file is not as ``save_agent`` writes it, of a newer version, or of a class that is not
            registered here; or ``env`` is not like that of its training.
    """
    venv = None if env is None else TaskInference._wrap_env(maybe_make_env(env, verbose=0))
    if venv is not None and unwrap_vec_normalize(venv) is not None:
        raise ValueError("`env` has a VecNormalize, and the file brings the agent's own: give the env without it.")
    try:
        agent, tensors = _read(*read_archive(Path(path)))
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


def _read(written: bytes, data: bytes) -> tuple[WrittenAgent, dict[str, Tensor]]:
    return WrittenAgent.read(read_json(written)), read_tensors(data)


def _load_again(written: bytes, data: bytes) -> None:
    """Build an agent from what its file would hold.

    Raises:
        ValueError: if ``load_agent`` would refuse it.
    """
    try:
        agent, tensors = _read(written, data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they were told when the agent was made
            agent.build(tensors, None, "cpu")
    except Exception as error:  # a constructor of the user's own may raise anything
        remedy = "make it with other settings, such as a smaller encoder, or save it by `model.save` alone"
        raise ValueError(f"it could not be loaded again, as {_told(error)}: {remedy}") from error


def _refusal(path: str | Path, error: Exception) -> ValueError:
    remedy = "" if isinstance(error, Unknown) else " Get another copy of it."
    return ValueError(f"{str(path)!r} cannot be loaded as an agent: {_told(error)}.{remedy}")


def _told(error: Exception) -> str:
    """Say in one line why an agent was refused."""
    if isinstance(error, RecursionError):
        return "its JSON is nested too deep"
    is_ours = isinstance(error, ValueError) or str(error).startswith("`")  # the name of an argument
    told = str(error) if is_ours else f"{type(error).__name__}: {error}"
    return printable(told[:500]).rstrip(".")

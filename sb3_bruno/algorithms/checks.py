"""Refuses what cannot work, before any work is lost, each time with what to do instead."""

from __future__ import annotations

import inspect
import math
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.preprocessing import is_image_space
from stable_baselines3.common.vec_env import VecEnv

from sb3_bruno.algorithms.arguments import check_names
from sb3_bruno.algorithms.values import check_ranges
from sb3_bruno.buffers.task_buffer import TaskReplayBuffer
from sb3_bruno.encoders import TaskEncoder, find_encoder

WRAP = "wrap the env in `sb3_bruno_envs.MetaTask` and then in `sb3_bruno_envs.TransitionObservation`"


def check_algorithm(model: OffPolicyAlgorithm) -> None:
    """Refuse settings of SB3 that cannot be honoured, and what ``load`` was told in vain.

    Raises:
        ValueError: naming the argument, its value and the remedy.
    """
    if model.n_steps > 1:
        raise ValueError(
            f"`n_steps={model.n_steps}` is not supported: sampled transitions need not follow one another. "
            "Use `n_steps=1`."
        )
    buffer_class = model.replay_buffer_class or TaskReplayBuffer
    if not (isinstance(buffer_class, type) and issubclass(buffer_class, TaskReplayBuffer)):
        name = getattr(buffer_class, "__name__", repr(buffer_class))
        raise ValueError(
            f"`replay_buffer_class={name}` is not supported: transitions must be grouped by task. "
            "Leave it out, or subclass `TaskReplayBuffer`. A goal that is relabelled (HER) is no hidden task."
        )
    check_ranges(vars(model))
    _check_quantiles(model)
    filled = {"buffer_size", "observation_space", "action_space", "device", "n_envs", "optimize_memory_usage"}
    check_names("replay_buffer_kwargs", model.replay_buffer_kwargs, buffer_class, filled)
    _check_loaded(model)
    _check_spaces(model.observation_space, model.action_space)


def _check_quantiles(model: OffPolicyAlgorithm) -> None:
    """Refuse to drop all quantiles of a critic."""
    dropped, n_quantiles = vars(model).get("top_quantiles_to_drop_per_net"), model.policy_kwargs.get("n_quantiles", 25)
    if dropped is not None and dropped >= n_quantiles:
        raise ValueError(
            f"`top_quantiles_to_drop_per_net={dropped}` leaves none of the {n_quantiles} quantiles of a critic: give "
            "less, or more quantiles by `policy_kwargs=dict(n_quantiles=...)`."
        )


def check_encoder_arguments(encoder_class: type[TaskEncoder], encoder_kwargs: Mapping[str, Any] | None) -> None:
    """Refuse names that the encoder does not take: neither its ``build`` nor, where that passes on, its constructor.

    Raises:
        ValueError: naming the nearest right name.
    """
    filled = {"observation_dim", "action_dim", "task_dim"}
    parameters = inspect.signature(encoder_class.build).parameters
    own = {name for name, parameter in parameters.items() if parameter.kind is not parameter.VAR_KEYWORD}
    if len(own) == len(parameters):
        check_names("encoder_kwargs", encoder_kwargs, encoder_class.build, filled)
        return
    passed_on = {name: value for name, value in (encoder_kwargs or {}).items() if name not in own - filled}
    check_names("encoder_kwargs", passed_on, encoder_class, filled)


def check_encoder_updates(encoder: TaskEncoder, updates: Mapping[str, float | None]) -> None:
    """Refuse settings of the encoder's updates that are out of range, or not its own.

    Args:
        encoder: the encoder.
        updates: ``encoder_batch_size``, ``encoder_update_ratio`` and ``encoder_learning_starts``, as they were given.

    Raises:
        ValueError: naming the argument, its value and the remedy.
    """
    for name, value in updates.items():
        if value is None:
            continue
        if encoder.learns_from != "own":
            raise ValueError(
                f"`{name}={value}` is for encoders that learn from a loss of their own: leave it out, for "
                f"{type(encoder).__name__} learns from the {encoder.learns_from}'s, whenever that is computed."
            )
        if name == "encoder_batch_size" and not value >= 1:
            raise ValueError(f"`{name}` must be at least 1, got {value}.")
        if not 0 <= value < math.inf:
            raise ValueError(f"`{name}` must be finite and not be negative, got {value}.")


def check_has_buffer(buffer: ReplayBuffer | None) -> None:
    """Refuse to learn without a replay buffer of this package.

    Raises:
        ValueError: if it is none.
    """
    if buffer is None:
        raise ValueError(
            "The agent has no replay buffer to learn from, for an agent file that is loaded without an env brings "
            "none: give it one, `load_agent(path, env)`, or call `load_replay_buffer`."
        )
    if not isinstance(buffer, TaskReplayBuffer):
        raise ValueError(
            f"The replay buffer is a {type(buffer).__name__}, no `TaskReplayBuffer`: leave out `replay_buffer_class`, "
            "or give a subclass."
        )


def check_buffer(buffer: ReplayBuffer | None, model: OffPolicyAlgorithm, encoder: TaskEncoder) -> None:
    """Refuse a replay buffer that the algorithm or its encoder cannot work with.

    Raises:
        ValueError: if it is no ``TaskReplayBuffer``, holds transitions of another number of envs or another env, has
            sequences that are too short for the encoder's loss, or shuffles them where the encoder reads them in
            their order.
    """
    check_has_buffer(buffer)
    assert isinstance(buffer, TaskReplayBuffer)  # for mypy
    if buffer.n_envs != model.n_envs:
        raise ValueError(
            f"The replay buffer is of `n_envs={buffer.n_envs}`, the model has {model.n_envs}: make as many."
        )
    assert isinstance(model.observation_space, spaces.Dict)  # for mypy: _check_spaces saw it
    holds = {
        "observations of shape": (buffer.observation_space.shape, model.observation_space["observation"].shape),
        "actions of shape": (buffer.action_space.shape, model.action_space.shape),
        "tasks of shape": ((buffer.tasks.task_dim,), model.policy_kwargs["task_space"].shape),
    }
    for what, (held, wanted) in holds.items():
        if held not in (wanted, (None,)):
            raise ValueError(f"The replay buffer holds {what} {held}, the model's have {wanted}: load its own buffer.")
    if buffer.sequence_length < encoder.shortest_sequence:
        raise ValueError(
            f"`sequence_length={buffer.sequence_length}` is too short for the encoder's objective: "
            f"`replay_buffer_kwargs=dict(sequence_length={encoder.shortest_sequence})` or more."
        )
    if encoder.order == "time" and buffer.context != "episode":
        raise ValueError(
            f"`context={buffer.context!r}` shuffles transitions, which {type(encoder).__name__} must read in their "
            "order: `replay_buffer_kwargs=dict(context='episode')`."
        )


def family_of(env: VecEnv | None) -> str | None:
    """Name the env family that an env is of: the id that it was registered with; None if there is none."""
    if env is None or not env.has_attr("family_id"):
        return None
    family_id: str | None = env.get_attr("family_id", 0)[0]
    return family_id


def check_family(buffer: ReplayBuffer | None, env: VecEnv | None) -> None:
    """Refuse a replay buffer that was filled in another env family, whose sizes may be the same.

    Raises:
        ValueError: naming both families.
    """
    filled_in, own = getattr(buffer, "family", None), family_of(env)
    if None not in (filled_in, own) and filled_in != own:
        raise ValueError(f"The replay buffer was filled in {filled_in}, and the env is {own}: load its own buffer.")


def _check_loaded(model: OffPolicyAlgorithm) -> None:
    """Refuse what ``load`` was told about how encoder and policy are built, where it differs from what was saved.

    SB3's ``load`` makes attributes of its arguments, and builds the policy by what was saved.
    """
    for name in ("encoder_class", "encoder_kwargs", "critic_input"):
        if name in vars(model):
            given, built = vars(model).pop(name), model.policy_kwargs[name]
            if name == "encoder_class":
                given, built = find_encoder(given), find_encoder(built)
            if (given or {}) != (built or {}):
                raise ValueError(f"`{name}={given!r}` is not what the model was saved with, {built!r}: leave it out.")
    if "task_readout" in vars(model):
        given, built = vars(model).pop("task_readout"), model.policy_kwargs.get("readout") is not None
        if given != built:
            raise ValueError(
                f"`task_readout={given}` does not fit a model that was saved {'with' if built else 'without'} a "
                "read-out of the task: leave it out. `fit_readout` adds one."
            )
    has_target, tau = model.policy_kwargs["target_encoder"], vars(model)["encoder_tau"]
    if tau is not None and not 0 < tau <= 1:
        raise ValueError(f"`encoder_tau` must be in (0, 1], got {tau}: None makes no target encoder.")
    if has_target != (tau is not None):
        kind = "with a target encoder" if has_target else "without a target encoder"
        raise ValueError(f"`encoder_tau={tau}` does not fit a model that was saved {kind}: leave it out.")


def _check_spaces(observation_space: spaces.Space[Any], action_space: spaces.Space[Any]) -> None:
    keys = {"observation", "action", "reward", "episode_start"}
    if not isinstance(observation_space, spaces.Dict) or set(observation_space.spaces) != keys:
        raise ValueError(
            f"The observation space must be a Dict of {sorted(keys)}, got {observation_space}: {WRAP}. Wrappers of the "
            "observation itself (stacked frames, say) go below MetaTask."
        )
    if not all(isinstance(space, spaces.Box) for space in observation_space.spaces.values()):
        raise ValueError(f"Every key of the observation space must be a Box, got {observation_space}: {WRAP}.")
    if is_image_space(observation_space["observation"]):
        raise ValueError(
            f"Images are not supported, got {observation_space['observation']}: extract features in an observation "
            "wrapper."
        )
    wanted = (spaces.flatdim(action_space),)
    if observation_space["action"].shape != wanted:
        raise ValueError(
            f"`action` must have shape {wanted}, got {observation_space['action'].shape}: {WRAP}. Wrappers of the "
            "action go below MetaTask, and Gymnasium's `FrameStackObservation` does, in place of `VecFrameStack`."
        )


def read_task_space(env: VecEnv, known: spaces.Box | None = None) -> spaces.Box:
    """Read the task space of an env.

    Args:
        env: the env.
        known: the task space that it must equal, if the model has one already.

    Raises:
        ValueError: if the env has none, or another than the one known.
    """
    if not env.has_attr("task_space"):
        raise ValueError(f"The env has no `task_space`: {WRAP}.")
    found = env.get_attr("task_space")
    if not isinstance(found[0], spaces.Box) or any(space != found[0] for space in found[1:]):
        raise ValueError(f"Every env must have the same Box as its `task_space`, got {found}.")
    task_space: spaces.Box = found[0]
    if known is not None and known.shape != task_space.shape:
        raise ValueError(
            f"The env's `task_space` {task_space} differs from the model's {known}: use the env family that the "
            "model was trained on."
        )
    if known is not None and known != task_space:
        warnings.warn(
            f"The env's `task_space` {task_space} has other bounds than the model's {known}: its tasks may lie "
            "outside those trained on.",
            stacklevel=2,
        )
    return known or task_space


def warn_of_missing_trial(encoder: TaskEncoder, env: VecEnv) -> None:
    """Warn whose encoder needs several episodes of a task, and whose env gives each episode another."""
    if encoder.needs_trial and not env.has_attr("n_episodes"):
        warnings.warn(
            f"{type(encoder).__name__} explores in the first episodes of a task (`exploration_episodes`), and each "
            "episode of this env has a task of its own, so it never uses what it finds: join episodes by "
            "`sb3_bruno_envs.Trial`.",
            stacklevel=3,
        )


def check_early_resets(env: VecEnv) -> None:
    """Check that no Monitor refuses the reset with which learning begins.

    Raises:
        ValueError: if one does, with the remedy.
    """
    if not (env.has_attr("allow_early_resets") and env.has_attr("needs_reset")):
        return
    for allowed, has_ended in zip(env.get_attr("allow_early_resets"), env.get_attr("needs_reset"), strict=True):
        if not allowed and not has_ended:
            raise ValueError(
                "`allow_early_resets=False` of the env's Monitor forbids to leave an episode, and learning begins with "
                "a new one: it starts anew, or stopped in the middle of a rollout. Use "
                "`Monitor(env, allow_early_resets=True)`, or give the model new envs by `set_env`."
            )


def check_task_infos(env: VecEnv) -> None:
    """Check the infos of a reset that just happened.

    Raises:
        ValueError: if an info has no "task", or one that is not in the task space.
    """
    space = read_task_space(env)
    for info in env.unwrapped.reset_infos:
        if "task" not in info:
            raise ValueError(f'The reset info has no "task": {WRAP}, or put the task vector there yourself.')
        task = np.asarray(info["task"], dtype=space.dtype)
        if not space.contains(task):
            raise ValueError(f'The reset info\'s "task" {task} is not in the task space {space}: widen `task_space`.')

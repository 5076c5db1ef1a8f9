"""Saves agents and their replay buffers, and loads them whole or, if they would not be what they were, not at all."""

from __future__ import annotations

import copy
import importlib
import io
import pathlib
import pickle
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar

import torch as th
from stable_baselines3.common.save_util import load_from_zip_file
from stable_baselines3.common.type_aliases import GymEnv, TensorDict
from stable_baselines3.common.vec_env import VecNormalize
from torch import Tensor

from sb3_bruno.algorithms.arguments import check_names
from sb3_bruno.algorithms.checks import check_family, check_has_buffer
from sb3_bruno.algorithms.readout_training import ReadoutTraining
from sb3_bruno.algorithms.values import check_none, check_values
from sb3_bruno.buffers.random_generator import random_generator
from sb3_bruno.buffers.task_buffer import SAMPLING, TaskReplayBuffer

SelfSaving = TypeVar("SelfSaving", bound="Saving")


class OtherParameters(ValueError, RuntimeError):
    """The parameters are not those of such an agent. SB3 raises a RuntimeError here, and its callers look for one."""


class Saving(ReadoutTraining):
    """Takes the encoder, its optimiser and what is carried along when an agent is saved. Part of ``TaskInference``."""

    _saved_by: list[str]

    def save(
        self,
        path: str | pathlib.Path | io.BufferedIOBase,
        exclude: Iterable[str] | None = None,
        include: Iterable[str] | None = None,
    ) -> None:
        """Save as in SB3. What is carried in a running episode is kept as arrays, which load on any device."""
        self.policy_kwargs["forget_threshold"] = self.policy.forget_threshold  # which may have been set since
        self._saved_by = _names_of_classes(self)
        carried = self._carried
        self._carried = None if carried is None else carried.pack()  # type: ignore[assignment]  # for now
        try:
            super().save(path, exclude, include)
        finally:
            self._carried = carried

    def export(self, path: str | pathlib.Path, *, vec_normalize: VecNormalize | None = None) -> pathlib.Path:
        """Write the agent, as it is now, to a file that acts without this package (docs/deploy.md).

        Args:
            path: ``.onnx`` for onnxruntime and ``sb3_bruno.export.Controller``, ``.pt`` for torch and libtorch.
            vec_normalize: the VecNormalize that it was trained with. None: that of its env, if it has one.

        Raises:
            ValueError: if the suffix is another, or the agent cannot be exported.
        """
        # By its name, and only now: that room stands above this one, and needs what only exporting needs.
        export: Any = importlib.import_module("sb3_bruno.export")
        written: pathlib.Path = export.export_agent(self, path, vec_normalize=vec_normalize)
        return written

    def _excluded_save_params(self) -> list[str]:
        own = ["encoder", "encoder_optimizer", "_next_carried", "_scalars_of_updates"]
        return [*super()._excluded_save_params(), *own]

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        state_dicts, variables = super()._get_torch_save_params()
        return [*state_dicts, "encoder_optimizer"], variables

    def load_replay_buffer(self, path: str | pathlib.Path | io.BufferedIOBase, truncate_last_traj: bool = True) -> None:
        """Load as in SB3. ``truncate_last_traj`` begins new episodes, without it the buffer's own go on.

        What is stored comes from the file. How samples are drawn of it, and with which random numbers, is the model's.

        Raises:
            ValueError: if it cannot serve: ``check_buffer``; or the file is no buffer, or not a whole one.
        """
        before: Any = getattr(self, "replay_buffer", None)
        try:
            super().load_replay_buffer(path, truncate_last_traj)
            check_has_buffer(self.replay_buffer)
            self._sample_as(before)
            check_family(self.replay_buffer, self.env)
            self.bind_buffer()
        except Exception as error:
            self.replay_buffer = before
            if isinstance(error, EOFError | pickle.UnpicklingError | AssertionError):
                raise ValueError(
                    f"`path={str(path)!r}` holds no replay buffer: it was cut short, or `save_replay_buffer` did not "
                    "write it. Give another file."
                ) from error
            raise
        if truncate_last_traj:
            self._last_obs = None

    def _sample_as(self, before: TaskReplayBuffer | None) -> None:
        """Draw from the replay buffer as from the one before it, or as the arguments say."""
        settings = self.replay_buffer_kwargs if before is None else vars(before)
        for name in SAMPLING:
            if name in settings:
                setattr(self.replay_buffer, name, settings[name])
        self.replay_buffer.rng = random_generator() if before is None else before.rng

    def set_parameters(
        self,
        load_path_or_dict: str | TensorDict,
        exact_match: bool = True,
        device: th.device | str = "auto",
    ) -> None:
        """Set as in SB3; all of them, or none if one is refused.

        A read-out that tells the same few tasks in another order brings its order along.

        Raises:
            ValueError: if a name is unknown or missing, a shape is another, a number is not finite, or the read-out is
                of other tasks. If torch finds a tensor missing or of another shape, it is a RuntimeError too.
        """
        given: Any = load_path_or_dict
        if not isinstance(load_path_or_dict, Mapping):
            given = load_from_zip_file(load_path_or_dict, device=device, load_data=False)[1]
        _check_finite(given)
        before = copy.deepcopy(self.get_parameters())
        try:
            super().set_parameters(given, exact_match, device)
        except Exception as error:
            super().set_parameters(before)  # type: ignore[arg-type]  # SB3 gives them as it takes them
            if isinstance(error, RuntimeError):  # of torch, on a line for each name
                told = " ".join(str(error).split())[:300]
                message = f"The parameters are not those of such an agent: {told}. Give its own."
                raise OtherParameters(message) from error
            raise

    @classmethod
    def load(
        cls: type[SelfSaving],
        path: str | pathlib.Path | io.BufferedIOBase,
        env: GymEnv | None = None,
        device: th.device | str = "auto",
        custom_objects: dict[str, Any] | None = None,
        print_system_info: bool = False,
        force_reset: bool = True,
        **kwargs: Any,
    ) -> SelfSaving:
        """Load as in SB3. A read-out that does not know all tasks of ``env`` is warned of.

        Args:
            path: where ``save`` put it.
            env: the env; None for an agent that only acts.
            device: as in SB3.
            custom_objects: as in SB3.
            print_system_info: as in SB3.
            force_reset: as in SB3.
            **kwargs: arguments of the constructor that shall have another value than they were saved with.

        Raises:
            TypeError: if an argument has a wrong name, or a value of a wrong kind.
            ValueError: if another algorithm saved the agent, a number of it is not finite, or the file is not whole.
        """
        check_names(f"{cls.__name__}.load", kwargs, cls, {"policy", "env"}, TypeError)
        check_none(kwargs, cls)
        check_values({**kwargs, "device": device})
        data, parameters, variables = load_from_zip_file(path, "policy_kwargs" in kwargs, custom_objects, "cpu")
        if not parameters:
            raise ValueError(
                f"`path={str(path)!r}` holds no agent: it was cut short, or `save` did not write it. Give another file."
            )
        _check_finite({**parameters, **(variables or {})})
        if data is not None:
            _check_policy_kwargs(kwargs.pop("policy_kwargs"), data["policy_kwargs"])
        try:
            model = super().load(path, env, device, custom_objects, print_system_info, force_reset, **kwargs)
        except KeyError as error:  # SB3 takes a refusal for that of an old DQN, whose optimiser it looks for
            raise (error.__context__ if isinstance(error.__context__, ValueError) else error) from None
        model.warn_of_other_tasks()
        return model

    def _check_saved_class(self) -> None:
        """Refuse to be loaded from what another class saved, unless one of the two is made from the other."""
        own, saved_by = _names_of_classes(self), self._saved_by
        if saved_by and own[0] not in saved_by and saved_by[0] not in own:
            raise ValueError(f"The agent was saved by {saved_by[0]}, not by {own[0]}: use `{saved_by[0]}.load`.")


def _check_policy_kwargs(given: Mapping[str, Any] | None, saved: Mapping[str, Any]) -> None:
    """Refuse arguments of the policy other than those it was built with, as SB3 does.

    Args:
        given: those that the constructor was given; those of task inference are arguments of its own.
        saved: all that the policy was built with.
    """
    own = {"encoder_class", "encoder_kwargs", "target_encoder", "critic_input", "readout", "task_space", "use_sde"}
    built = {name: value for name, value in saved.items() if name not in own}
    written = {"forget_threshold": None, "n_critics": 2}  # by ``save`` and by SB3, where nothing was given
    if {**written, **(given or {})} != {**written, **built}:
        raise ValueError(f"`policy_kwargs={given!r}` is not what the agent was saved with, {built!r}: leave it out.")


def _names_of_classes(model: Saving) -> list[str]:
    """Name the class of a model and those that it inherits from, as far as they infer a task."""
    return [cls.__name__ for cls in type(model).__mro__ if issubclass(cls, Saving)]


def _check_finite(parameters: Mapping[str, Any]) -> None:
    """Refuse parameters, nested by name, one of which holds a number that is not finite."""
    for name, tensor in _tensors(parameters):
        if tensor.is_floating_point() and not th.isfinite(tensor).all():
            raise ValueError(
                f"The parameter `{name}` holds a number that is not finite, for the training that made it diverged: "
                "take an agent saved earlier, and train on with a lower `learning_rate`."
            )


def _tensors(nested: Any, name: str = "") -> Iterator[tuple[str, Tensor]]:
    if isinstance(nested, Tensor):
        yield name, nested
    elif isinstance(nested, Mapping):
        for key, value in nested.items():
            yield from _tensors(value, f"{name}.{key}" if name else str(key))

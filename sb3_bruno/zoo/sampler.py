"""The search space of our algorithms, in the form that rl_zoo3 gives its own.

Each encoder brings the part for its own arguments. One core can afford the upper ends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import optuna

from sb3_bruno.encoders import TaskEncoder
from sb3_bruno.zoo.tried import encoder_or_class, try_encoder

NETS = {"small": [64, 64], "medium": [128, 128], "big": [256, 256]}


class SearchSpace:
    """Draws hyperparameters of encoder, actor-critic and schedule, and converts what was drawn.

    Args:
        encoder: the encoder's class, whose ``search_space`` is searched too.
        encoder_kwargs: the encoder's arguments that are not drawn.
    """

    def __init__(self, encoder: type[TaskEncoder], encoder_kwargs: Mapping[str, Any] | None = None) -> None:
        self.encoder = encoder
        self.encoder_kwargs = encoder_kwargs or {}

    def sample(
        self, trial: optuna.Trial, n_actions: int, n_envs: int, additional_args: dict[str, Any]
    ) -> dict[str, Any]:
        """Draw hyperparameters, as rl_zoo3 calls it.

        Args:
            trial: the Optuna trial.
            n_actions: unused; rl_zoo3 passes it.
            n_envs: number of environments. Gradient steps are drawn per environment step.
            additional_args: unused; rl_zoo3 passes it.

        Returns:
            Constructor arguments, plain values only.
        """
        trial.suggest_float("learning_rate", 2e-4, 3e-3, log=True)
        trial.suggest_float("one_minus_gamma", 5e-3, 0.2, log=True)
        trial.suggest_int("batch_size_pow", 6, 8)
        trial.suggest_categorical("net", list(NETS))
        trial.suggest_int("updates_per_step_pow", -3, -1)
        for name, choices in self.searched.items():
            if isinstance(choices, range):
                trial.suggest_int(name, choices[0], choices[-1], step=choices.step)
            else:
                trial.suggest_categorical(name, choices)
        encoder = self._drawn_encoder(trial.params)
        if encoder.order == "any":
            trial.suggest_categorical("context", ["iid", "episode"])
            trial.suggest_int("sequence_length_pow", 5, 6)
        rate = encoder.learning_rate
        trial.suggest_float("encoder_learning_rate", 0.3 * rate, 5 * rate, log=True)
        if encoder.learns_from == "own":
            trial.suggest_int("encoder_update_ratio_pow", -3, 0)
        return self.convert({**trial.params, "n_envs": n_envs})

    @cached_property
    def searched(self) -> dict[str, Sequence[Any]]:
        """The encoder's arguments to draw, each with the values that the encoder takes beside those that are not drawn.

        An argument of which it takes no value is left out. If it refuses what is not drawn as well, the argument stays,
        so that its own error is told.
        """
        is_complete = try_encoder(self.encoder, self.encoder_kwargs) is not None
        searched: dict[str, Sequence[Any]] = {}
        for name, choices in self.encoder.search_space.items():
            kwargs = [{**self.encoder_kwargs, name: choice} for choice in choices]
            taken = [entry[name] for entry in kwargs if try_encoder(self.encoder, entry) is not None]
            if taken or not is_complete:
                searched[name] = taken if 0 < len(taken) < len(choices) else choices
        return searched

    def _drawn_encoder(self, drawn: Mapping[str, Any]) -> TaskEncoder | type[TaskEncoder]:
        """Find the encoder that the drawn values make, or its class if it refuses them."""
        return encoder_or_class(self.encoder, {**self.encoder_kwargs, **self._of_encoder(drawn)})

    def _of_encoder(self, drawn: Mapping[str, Any]) -> dict[str, Any]:
        """Pick the encoder's arguments from what was drawn."""
        return {name: drawn[name] for name in self.searched}

    def convert(self, sampled_params: Mapping[str, Any]) -> dict[str, Any]:
        """Convert drawn values to constructor arguments.

        Args:
            sampled_params: the drawn values, and ``n_envs``. The search does not draw ``n_envs``, so ``trial.params``
                lacks it; without it, ``gradient_steps`` is left out.
        """
        drawn = sampled_params
        encoder = self._drawn_encoder(drawn)
        arguments: dict[str, Any] = {
            "learning_rate": drawn["learning_rate"],
            "gamma": 1 - drawn["one_minus_gamma"],
            "batch_size": 2 ** drawn["batch_size_pow"],
            "policy_kwargs": {"net_arch": NETS[drawn["net"]]},
            "encoder_kwargs": self._of_encoder(drawn),
            "encoder_learning_rate": drawn["encoder_learning_rate"],
        }
        if encoder.order == "any":
            length = 2 ** drawn["sequence_length_pow"]
            arguments["replay_buffer_kwargs"] = {"context": drawn["context"], "sequence_length": length}
        if encoder.learns_from == "own":
            arguments["encoder_update_ratio"] = 2.0 ** drawn["encoder_update_ratio_pow"]
        if "n_envs" in drawn:
            arguments["gradient_steps"] = max(round(drawn["n_envs"] * 2.0 ** drawn["updates_per_step_pow"]), 1)
        return arguments

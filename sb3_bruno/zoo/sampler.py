"""The search space of our algorithms, in the form that rl_zoo3 gives its own.

Each encoder brings the part for its own arguments. One core can afford the upper ends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import optuna
import torch as th

from sb3_bruno.encoders import TaskEncoder

TRIED_DIMS = (8, 2, 2)  # of the observation, action and task of the encoders that are built to try an argument
NETS = {"small": [64, 64], "medium": [128, 128], "big": [256, 256]}


class SearchSpace:
    """Draws hyperparameters of encoder, actor-critic and schedule, and converts what was drawn.

    Args:
        encoder: the encoder's class, whose ``search_space`` is searched too.
        encoder_kwargs: the encoder's arguments that are not drawn. Values that it refuses beside them are left out.
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
        if self.encoder.order == "any":
            trial.suggest_categorical("context", ["iid", "episode"])
            trial.suggest_int("sequence_length_pow", 5, 6)
        for name, choices in self.encoder.search_space.items():
            if isinstance(choices, range):
                trial.suggest_int(name, choices[0], choices[-1], step=choices.step)
            else:
                trial.suggest_categorical(name, self._accepted(name, choices))
        rate = self.encoder.learning_rate
        trial.suggest_float("encoder_learning_rate", 0.3 * rate, 5 * rate, log=True)
        if self.encoder.learns_from == "own":
            trial.suggest_int("encoder_update_ratio_pow", -3, 0)
        return self.convert({**trial.params, "n_envs": n_envs})

    def _accepted(self, name: str, choices: Sequence[Any]) -> list[Any]:
        """Keep the values that the encoder takes; all of them if it takes none, so that its own error is told."""
        accepted = [choice for choice in choices if self._takes({**self.encoder_kwargs, name: choice})]
        return accepted or list(choices)

    def _takes(self, encoder_kwargs: dict[str, Any]) -> bool:
        with th.random.fork_rng([]):
            try:
                self.encoder.build(*TRIED_DIMS, **encoder_kwargs)
            except ValueError:
                return False
        return True

    def convert(self, sampled_params: Mapping[str, Any]) -> dict[str, Any]:
        """Convert drawn values to constructor arguments.

        Args:
            sampled_params: the drawn values, and ``n_envs``. The search does not draw ``n_envs``, so ``trial.params``
                lacks it; without it, ``gradient_steps`` is left out.
        """
        drawn = sampled_params
        arguments: dict[str, Any] = {
            "learning_rate": drawn["learning_rate"],
            "gamma": 1 - drawn["one_minus_gamma"],
            "batch_size": 2 ** drawn["batch_size_pow"],
            "policy_kwargs": {"net_arch": NETS[drawn["net"]]},
            "encoder_kwargs": {name: drawn[name] for name in self.encoder.search_space},
            "encoder_learning_rate": drawn["encoder_learning_rate"],
        }
        if self.encoder.order == "any":
            length = 2 ** drawn["sequence_length_pow"]
            arguments["replay_buffer_kwargs"] = {"context": drawn["context"], "sequence_length": length}
        if self.encoder.learns_from == "own":
            arguments["encoder_update_ratio"] = 2.0 ** drawn["encoder_update_ratio_pow"]
        if "n_envs" in drawn:
            arguments["gradient_steps"] = max(round(drawn["n_envs"] * 2.0 ** drawn["updates_per_step_pow"]), 1)
        return arguments

"""The search space of our algorithms, in the form that rl_zoo3 gives its own.

One core can afford the upper ends.
"""

from __future__ import annotations

from typing import Any

import optuna

NETS = {"small": [64, 64], "medium": [128, 128], "big": [256, 256]}
ENCODER_KWARGS = ("flow_class", "extra_dims", "condition_on_next", "process", "objective")


def sample_bruno(trial: optuna.Trial, n_actions: int, n_envs: int, additional_args: dict[str, Any]) -> dict[str, Any]:
    """Draw hyperparameters of encoder, actor-critic and schedule.

    Args:
        trial: the Optuna trial.
        n_actions: unused; rl_zoo3 passes it.
        n_envs: number of environments. Gradient steps are drawn per environment step.
        additional_args: unused; rl_zoo3 passes it.

    Returns:
        Constructor arguments, plain values only.
    """
    drawn = {
        "learning_rate": trial.suggest_float("learning_rate", 2e-4, 3e-3, log=True),
        "one_minus_gamma": trial.suggest_float("one_minus_gamma", 5e-3, 0.2, log=True),
        "batch_size_pow": trial.suggest_int("batch_size_pow", 6, 8),
        "net": trial.suggest_categorical("net", list(NETS)),
        "updates_per_step_pow": trial.suggest_int("updates_per_step_pow", -3, -1),
        "n_envs": n_envs,
        "context": trial.suggest_categorical("context", ["iid", "episode"]),
        "sequence_length_pow": trial.suggest_int("sequence_length_pow", 5, 6),
        "flow_class": trial.suggest_categorical("flow_class", ["paper_maf", "reflected_maf"]),
        "extra_dims": trial.suggest_int("extra_dims", 1, 4),
        "condition_on_next": trial.suggest_categorical("condition_on_next", [False, True]),
        "process": trial.suggest_categorical("process", ["gaussian", "student_t"]),
        "objective": trial.suggest_categorical("objective", ["paper", "prequential"]),
        "encoder_learning_rate": trial.suggest_float("encoder_learning_rate", 3e-4, 5e-3, log=True),
        "encoder_update_ratio_pow": trial.suggest_int("encoder_update_ratio_pow", -3, 0),
    }
    return convert_bruno(drawn)


def convert_bruno(sampled_params: dict[str, Any]) -> dict[str, Any]:
    """Convert drawn values to constructor arguments.

    Args:
        sampled_params: the drawn values, and ``n_envs``. The search does not draw ``n_envs``, so ``trial.params`` lacks
            it; without it, ``gradient_steps`` is left out.
    """
    drawn = sampled_params
    arguments: dict[str, Any] = {
        "learning_rate": drawn["learning_rate"],
        "gamma": 1 - drawn["one_minus_gamma"],
        "batch_size": 2 ** drawn["batch_size_pow"],
        "policy_kwargs": {"net_arch": NETS[drawn["net"]]},
        "replay_buffer_kwargs": {
            "context": drawn["context"],
            "sequence_length": 2 ** drawn["sequence_length_pow"],
        },
        "encoder_kwargs": {key: drawn[key] for key in ENCODER_KWARGS},
        "encoder_learning_rate": drawn["encoder_learning_rate"],
        "encoder_update_ratio": 2.0 ** drawn["encoder_update_ratio_pow"],
    }
    if "n_envs" in drawn:
        arguments["gradient_steps"] = max(round(drawn["n_envs"] * 2.0 ** drawn["updates_per_step_pow"]), 1)
    return arguments

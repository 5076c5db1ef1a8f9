"""The arguments of ``BrunoEncoder``: their names and types for editors, and what can be chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, TypedDict

from zuko.lazy import Flow

from sb3_bruno.encoders.choices import check_choice
from sb3_bruno.encoders.variables import Modelled

ProcessName = Literal["kernel", "kernel_student_t", "gaussian"]
Objective = Literal["paper", "holdout", "prequential"]
BeliefForm = Literal["mean", "mean_std", "mean_var"]


class BrunoArguments(TypedDict, total=False):
    """The ``encoder_kwargs`` of ``BrunoEncoder``."""

    modelled: Modelled
    condition_on_next: bool | None
    process: ProcessName
    n_weights: int
    net_arch: Sequence[int]
    extra_dims: int
    flow_class: str | Callable[..., Flow] | None
    flow_kwargs: dict[str, Any] | None
    objective: Objective
    belief: BeliefForm


def check_choices(**chosen: str) -> None:
    """Refuse what cannot be chosen.

    Args:
        **chosen: ``modelled``, ``process``, ``objective`` and ``belief``.

    Raises:
        ValueError: naming the argument, its value and what there is.
    """
    choices = {"modelled": Modelled, "process": ProcessName, "objective": Objective, "belief": BeliefForm}
    for name, value in chosen.items():
        check_choice(name, value, choices[name])

"""The arguments of ``ProductOfGaussians``: their names and types for editors, and which go together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypedDict, Unpack

from sb3_bruno.encoders.choices import check_choice, check_layers, check_least

BeliefForm = Literal["mean", "mean_var", "sample"]
KL_WEIGHT = 0.032
"""PEARL's, in the unit of SB3's SAC: 0.1 for a sum over 16 tasks, beside squared errors of rewards times 5, is
0.1 * 16 / (2 * 5^2) for a mean over tasks, beside half the sum of two critics' mean squared errors."""


class ProductArguments(TypedDict, total=False):
    """The ``encoder_kwargs`` of ``ProductOfGaussians``."""

    latent_dim: int
    net_arch: Sequence[int]
    belief: BeliefForm | None
    exploration_episodes: int | None
    kl_weight: float
    prior_factor: bool | None
    information_bottleneck: bool


def check_together(**arguments: Unpack[ProductArguments]) -> None:
    """Refuse arguments that are none of their choices, or do not go together. All are given.

    Raises:
        TypeError: if one is of a wrong kind.
        ValueError: naming the argument, its value and the remedy.
    """
    belief, n_explored = arguments["belief"], arguments["exploration_episodes"]
    if not arguments["information_bottleneck"]:
        needs_it = {
            "belief": belief not in (None, "mean"),
            "kl_weight": arguments["kl_weight"] != KL_WEIGHT,
            "prior_factor": bool(arguments["prior_factor"]),
        }
        for name in (name for name, is_wrong in needs_it.items() if is_wrong):
            value = dict(arguments)[name]
            raise ValueError(f"`{name}={value!r}` needs the information bottleneck: leave it out, or turn that on.")
    if belief is not None:
        check_choice("belief", belief, BeliefForm)
    if arguments["prior_factor"] is not None and not isinstance(arguments["prior_factor"], bool):
        raise TypeError(f"`prior_factor={arguments['prior_factor']!r}` is neither True nor False: give one of them.")
    check_least("latent_dim", arguments["latent_dim"], 1)
    check_layers("net_arch", arguments["net_arch"])
    check_least("kl_weight", arguments["kl_weight"], 0.0)
    if n_explored is None:
        return
    if not isinstance(n_explored, int) or isinstance(n_explored, bool) or n_explored < 1:
        raise ValueError(f"`exploration_episodes` must be a whole number of 1 or more, got {n_explored!r}.")
    if belief != "sample":
        raise ValueError(f"`exploration_episodes={n_explored}` needs a z to hold: `belief='sample'`, or leave it out.")

"""Predicts the rewards and changes of transitions from a code of their task, by networks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import torch as th
from torch import Tensor, nn
from zuko.nn import MLP

from sb3_bruno.encoders.variables import Modelled, Values, Variables


class Decoder(nn.Module):
    """Creates a network for r given (code, s, a, s'), one for s' - s given (code, s, a), or both.

    Args:
        variables: that standardise, with all of r, s' and s' - s.
        modelled: what is predicted: ``"rewards"``, ``"next_observations"`` or ``"both"``.
        code_dim: dimension of the code.
        net_arch: widths of the hidden layers.
        n_numbers: how many numbers are told of each predicted value: 1 for a mean, 2 for a mean and a scale.
    """

    def __init__(
        self, variables: Variables, modelled: Modelled, code_dim: int, net_arch: Sequence[int], n_numbers: int = 1
    ) -> None:
        super().__init__()
        self._n_numbers = n_numbers
        self.rewards: MLP | None = None
        self.changes: MLP | None = None
        if modelled != "next_observations":
            self.rewards = MLP(code_dim + variables.x_dim, n_numbers * variables.reward_dim, net_arch)
        if modelled != "rewards":
            self.changes = MLP(code_dim + variables.here_dim, n_numbers * variables.change_dim, net_arch)

    def forward(self, code: Tensor, values: Values) -> Iterator[tuple[Tensor, Tensor]]:
        """Predict values, each in turn: the rewards, the changes.

        Args:
            code: shape (..., code_dim).
            values: standardised values of transitions, (..., dim).

        Yields:
            What is told of the value, shape (..., n_numbers, dim), and the value itself, (..., dim).
        """
        for network, given, value in (
            (self.rewards, values.x, values.rewards),
            (self.changes, values.here, values.changes),
        ):
            if network is not None:
                numbers = network(th.cat([code, given], dim=-1))
                yield numbers.unflatten(-1, (self._n_numbers, value.shape[-1])), value

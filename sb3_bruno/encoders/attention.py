"""A layer of a transformer that attends to the last steps alone: over whole sequences, or one step at a time."""

from __future__ import annotations

import math

import torch as th
from torch import Tensor, nn
from torch.nn import functional as F


class WindowedLayer(nn.Module):
    """Creates a layer with a norm before each part, and a learned bias for each distance: x -> x + attention + MLP.

    Args:
        size: of what it reads and writes; a quarter of the MLP's hidden layer.
        n_heads: number of heads.
        window: to how many steps, the current one included, a step attends.
    """

    def __init__(self, size: int, n_heads: int, window: int) -> None:
        super().__init__()
        self.window = window
        self._n_heads = n_heads
        self.before_attention = nn.LayerNorm(size)
        self.query = nn.Linear(size, size)
        self.key_and_value = nn.Linear(size, 2 * size)
        self.out = nn.Linear(size, size)
        self.of_distance = nn.Parameter(th.zeros(n_heads, window))  # the current step's first
        self.mlp = nn.Sequential(nn.LayerNorm(size), nn.Linear(size, 4 * size), nn.ReLU(), nn.Linear(4 * size, size))

    def keys_and_values(self, x: Tensor) -> Tensor:
        """Compute the keys and values of steps, (..., size) -> (..., 2 * size)."""
        found: Tensor = self.key_and_value(self.before_attention(x))
        return found

    def last(self, x: Tensor, seen: Tensor, n: Tensor) -> Tensor:
        """Run one step.

        Args:
            x: the step, shape (..., size).
            seen: keys and values of the window, oldest first and the step's own last, shape (..., window, 2 * size).
            n: how many of them there are, shape (..., 1).
        """
        distance = th.arange(self.window - 1, -1, -1, device=x.device)
        is_there = (distance < n)[..., None, None, :]
        bias = th.where(is_there, self.of_distance[:, distance].unsqueeze(-2), -math.inf)  # (..., n_heads, 1, window)
        return self._attend(x.unsqueeze(-2), seen, bias).squeeze(-2)

    def forward(self, x: Tensor, seen: Tensor) -> Tensor:
        """Run all steps of sequences, block by block, so that the cost grows with time and not with its square.

        Example: with a window of 2, the block of the steps 2 3 sees the steps 0 1 2 3, and each step of it attends to
        itself and the one before.

        Args:
            x: shape (batch, time, size).
            seen: their keys and values, shape (batch, time, 2 * size).
        """
        time = x.shape[1]
        size, before = (time, 0) if time <= self.window else (self.window, self.window)
        n_blocks = -(-time // size)
        missing = n_blocks * size - time
        queries = F.pad(x, (0, 0, 0, missing)).unflatten(1, (n_blocks, size))
        blocks = F.pad(seen, (0, 0, before, missing)).unfold(1, before + size, size).transpose(-1, -2)
        here, there = (th.arange(first, size, device=x.device) for first in (0, -before))
        distance = here[:, None] - there  # (size, before + size), from each step of a block to what the block sees
        exists = there + size * th.arange(n_blocks, device=x.device)[:, None] >= 0  # (n_blocks, before + size)
        is_seen = (distance >= 0) & (distance < self.window) & exists.unsqueeze(1)
        bias = self.of_distance[:, distance.clamp(0, self.window - 1)]  # (n_heads, size, before + size)
        found = self._attend(queries, blocks, th.where(is_seen.unsqueeze(1), bias, -math.inf))
        return found.flatten(1, 2)[:, :time]

    def _attend(self, x: Tensor, seen: Tensor, bias: Tensor) -> Tensor:
        """Add attention and MLP.

        Args:
            x: steps, shape (..., n, size).
            seen: the keys and values that they may attend to, shape (..., m, 2 * size).
            bias: of the scores, shape (..., n_heads, n, m).
        """
        queries = self._by_head(self.query(self.before_attention(x)))
        keys, values = (self._by_head(part) for part in seen.chunk(2, dim=-1))
        scores = queries @ keys.transpose(-1, -2) / math.sqrt(queries.shape[-1]) + bias
        attended = (scores.softmax(dim=-1) @ values).transpose(-2, -3).flatten(-2)
        x = x + self.out(attended)
        result: Tensor = x + self.mlp(x)
        return result

    def _by_head(self, x: Tensor) -> Tensor:
        """(..., n, size) -> (..., n_heads, n, size / n_heads)"""
        heads: Tensor = x.unflatten(-1, (self._n_heads, -1))
        return heads.transpose(-2, -3)

"""Takes the drawing of noise out of an encoder, so that a caller gives it: an exported step is a pure function."""

from __future__ import annotations

from typing import Any

import torch as th

from sb3_bruno.encoders import TaskEncoder

SEED = 0


def drawn_by_redraw(encoder: TaskEncoder) -> list[int]:
    """Tell which entries of an encoder's memory ``redraw`` draws.

    Raises:
        ValueError: if it draws anything else than standard normal numbers.
    """
    memory = encoder.empty((1,))
    with th.random.fork_rng(devices=[]):
        th.manual_seed(SEED)
        redrawn = encoder.redraw(memory)
        noise = [i for i, (old, new) in enumerate(zip(memory, redrawn, strict=True)) if not th.equal(old, new)]
        th.manual_seed(SEED)
        is_normal = all(th.equal(redrawn[i], th.randn_like(memory[i])) for i in noise)
    if not is_normal:
        raise ValueError(
            f"{type(encoder).__name__} cannot be exported: an exported agent is given standard normal noise, and "
            "`redraw` draws another. Draw by `torch.randn_like`, each entry of the memory once, in order."
        )
    return noise


def keep_noise(encoder: TaskEncoder) -> None:
    """Have ``redraw``, and with it ``start_episode``, keep the noise that is in the memory."""
    substitute: Any = encoder
    substitute.redraw = lambda memory: memory

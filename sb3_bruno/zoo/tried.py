"""Builds an encoder only to look at it: whether it takes its arguments, whom it learns from, how it reads."""

from __future__ import annotations

from typing import Any

import torch as th

from sb3_bruno.encoders import TaskEncoder

DIMS = (8, 2, 2)
"""Of the observation, action and task."""


def try_encoder(encoder_class: type[TaskEncoder], encoder_kwargs: Any) -> TaskEncoder | None:
    """Build an encoder with its arguments, or None for none; return None if it refuses them.

    Torch's generator stays as it was.
    """
    with th.random.fork_rng([]):
        try:
            return encoder_class.build(*DIMS, **(encoder_kwargs or {}))
        except Exception:  # arguments of any kind, and maybe an encoder of somebody else's
            return None


def encoder_or_class(encoder_class: type[TaskEncoder], encoder_kwargs: Any) -> TaskEncoder | type[TaskEncoder]:
    """Build an encoder to read its attributes; return its class, which has them too, if it refuses its arguments.

    Its arguments may change whom it learns from and how it reads.
    """
    encoder = try_encoder(encoder_class, encoder_kwargs)
    return encoder_class if encoder is None else encoder

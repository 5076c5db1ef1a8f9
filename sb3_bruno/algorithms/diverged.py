"""Says whose training diverged, where the actions of an agent are not finite any more."""

from __future__ import annotations

import torch as th

from sb3_bruno.encoders import TaskEncoder


def explain_divergence(encoder: TaskEncoder) -> str:
    """Return the text of an error: the encoder is to blame if its parameters are not finite, else the actor.

    Whatever reads its beliefs diverges with it. One that others teach may have been led astray by them.
    """
    if all(bool(th.isfinite(parameter).all()) for parameter in encoder.parameters()):
        whose, rate = "The actor's actions are not finite, for its", "`learning_rate`"
    else:
        whose, rate = "The encoder's parameters are not finite, for its", "`encoder_learning_rate`"
        if encoder.learns_from != "own":
            rate += f", or `learning_rate` of the {encoder.learns_from} that teaches it"
    return f"{whose} training diverged: train with a lower {rate}, or load an agent from before."

"""A small BrunoEncoder in float64, seeded, and transitions to give it."""

import torch as th
import zuko

from sb3_bruno.encoders import BrunoEncoder, Transitions

SMALL = {"flow_class": zuko.flows.MAF, "flow_kwargs": {"transforms": 2, "hidden_features": (32,)}}


def encoder_of(**kwargs) -> BrunoEncoder:
    th.manual_seed(0)
    return BrunoEncoder(3, 2, **{**SMALL, **kwargs}).double()


def transitions_of(*shape: int, seed: int = 0) -> Transitions:
    generator = th.Generator().manual_seed(seed)
    return Transitions(*(th.randn(*shape, dim, generator=generator, dtype=th.float64) for dim in (3, 2, 1, 3)))

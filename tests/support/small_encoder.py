"""Small BrunoEncoders in float64, seeded, and transitions to give them."""

import torch as th
import zuko

from sb3_bruno.encoders import BrunoEncoder, Transitions
from sb3_bruno.maths.processes import EXCHANGEABLE, KERNEL

SMALL = {
    "flow_class": zuko.flows.MAF,
    "flow_kwargs": {"transforms": 2, "hidden_features": (32,)},
    "n_weights": 4,
    "net_arch": (32,),
}
NOISY = {"process": "gaussian", "extra_dims": 4}
"""The paper's process, whose noise augments what is modelled."""
PROCESSES = [*KERNEL, *EXCHANGEABLE]


def encoder_of(**kwargs) -> BrunoEncoder:
    th.manual_seed(0)
    return BrunoEncoder(3, 2, **{**SMALL, "modelled": "rewards", **kwargs}).double()


def transitions_of(*shape: int, seed: int = 0) -> Transitions:
    generator = th.Generator().manual_seed(seed)
    return Transitions(*(th.randn(*shape, dim, generator=generator, dtype=th.float64) for dim in (3, 2, 1, 3)))

"""Updates of the encoder and of the actor-critic, each by itself."""

from __future__ import annotations

from functools import partial
from typing import Any

import torch as th
from zuko.flows import MAF

from sb3_bruno.maths.flow import ConditionalFlow
from speed_sections.models import ACTION_DIM, OBSERVATION_DIM, PAPERS, plain, trained
from speed_sections.race import Row, Seconds, race, row

NETS: dict[str, Any] = {"2 x 256": [256, 256], "2 x 128": [128, 128], "the paper's": {"pi": [128, 128], "qf": [128]}}


def encoder_updates(rounds: int) -> tuple[list[Row], Seconds]:
    """Time an encoder update on 10 x 100 transitions, sampling and optimiser included, beside zuko's flow alone."""
    kwargs: dict[str, Any] = {"encoder_batch_size": 10, "replay_buffer_kwargs": {"sequence_length": 100}}
    papers = trained(encoder_kwargs=PAPERS["encoder_kwargs"], **kwargs)
    ours = trained(**kwargs)
    y, x = th.randn(10, 100, 5), th.randn(10, 100, OBSERVATION_DIM + ACTION_DIM)
    zukos = ConditionalFlow(5, OBSERVATION_DIM + ACTION_DIM, MAF, {"transforms": 6, "hidden_features": (128,)})

    def bare() -> None:
        z, log_det = zukos(y, x)
        (z.square().mean() - log_det.mean()).backward()

    flow_alone = "bare zuko forward and backward"
    work = {"the paper's": papers._update_encoder, "the default": ours._update_encoder, flow_alone: bare}
    seconds = race(work, rounds, 10)
    target = "<= 1.25; the paper's code: 31 per second"
    rows = [row(f"encoder update, 10 x 100, {who}", seconds, who, flow_alone, target) for who in [*work][:2]]
    return rows, seconds


def actor_critic_updates(rounds: int) -> tuple[list[Row], Seconds]:
    """Time a gradient step with its beliefs but no encoder update, beside SAC's own."""
    rows, everything = [], {}
    for net, batch, steps in [*((net, 256, steps) for net in NETS for steps in (1, 5)), ("the paper's", 1_000, 5)]:
        kwargs: dict[str, Any] = {"policy_kwargs": {"net_arch": NETS[net]}}
        bruno, sac = trained(encoder_update_ratio=0, **kwargs), plain(**kwargs)
        work = {"bruno": partial(bruno.train, steps, batch), "SAC": partial(sac.train, steps, batch)}
        seconds = race(work, rounds, 10 // steps)
        target = {"2 x 256": "<= 1.3", "2 x 128": "<= 1.5"}.get(net, "")
        if batch == 1_000:
            target = "the paper's code: 28 per second"
        what = f"actor-critic update, {net}, batch {batch}, {steps} per call"
        rows.append(row(what, seconds, "bruno", "SAC", target, steps))
        everything |= {f"{what}: {name}": times for name, times in seconds.items()}
    return rows, everything

"""Show how soon a belief tells the cheetah's direction, as encoder updates go on: the encoder alone, no agent.

    python benchmarks/belief_sharpness.py --flow reflected_maf --extra-dims 1 --condition-on-next --seed 0

Trains BRUNO on transitions of random actions on CheetahDir-v0. Prints, as it goes, the bound in nats per transition and
the share of 800 sequences whose direction a linear read-out of the posterior mean gets right after 1, 3, 10 and 40
transitions: first for the transitions it was trained on, then for as many others. If the two differ, it has learned the
transitions by heart. The read-out is fitted on 800 other sequences of the same transitions.
"""

from __future__ import annotations

import argparse
from functools import partial

import numpy as np
import torch as th
from encoder_alone import random_transitions, read_out, updates

from sb3_bruno import BrunoEncoder, TaskReplayBuffer
from sb3_bruno.encoders.base import map_memory

CONTEXTS = (1, 3, 10, 40)


def accuracy(encoder: BrunoEncoder, buffer: TaskReplayBuffer) -> list[float]:
    """Measure the share of directions that are right after each of ``CONTEXTS`` transitions."""
    slots, tasks = buffer.exchangeable_slots(1_600, buffer.sequence_length)
    direction = tasks[:, 1] > tasks[:, 0]
    with th.no_grad():
        prefixes = encoder.eval().prefixes(buffer.transitions(slots[:, : CONTEXTS[-1]]))
    shares = []
    for n in CONTEXTS:
        means = encoder.posterior(map_memory(lambda states, n=n: states[:, n], prefixes)).mean.detach().numpy()
        predictions = read_out(means, np.where(direction, 1.0, -1.0), 800)
        shares.append(float(((predictions > 0) == direction[800:]).mean()))
    return shares


def main() -> None:
    """Parse the command line and run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--transitions", type=int, default=20_000)
    parser.add_argument("--updates", type=int, default=3_000)
    parser.add_argument("--every", type=int, default=500, help="updates between two lines")
    parser.add_argument("--flow", choices=["paper_maf", "reflected_maf"], default="paper_maf")
    parser.add_argument("--extra-dims", type=int, default=4, help="noise dimensions (the paper: 4)")
    parser.add_argument("--condition-on-next", action="store_true", help="condition on (s, a, s')")
    parser.add_argument("--learning-rate", type=float, default=2e-3)
    options = parser.parse_args()
    th.set_num_threads(1)
    buffer, others = (
        random_transitions("CheetahDir-v0", options.transitions, options.seed + plus, sequence_length=64)
        for plus in (0, 1_000)
    )
    th.manual_seed(options.seed)
    encoder = BrunoEncoder(
        17,
        6,
        flow_class=options.flow,
        extra_dims=options.extra_dims,
        condition_on_next=options.condition_on_next,
        modelled="rewards",
        process="gaussian",
        objective="paper",
    )
    print(f"{'updates':>8} {'nats':>6}  right after {CONTEXTS} transitions: trained on | others")
    bounds = []
    draw = partial(buffer.sample_sequences, 16)
    for update, loss in enumerate(updates(encoder, draw, options.updates, options.learning_rate), start=1):
        bounds.append(loss.scalars["bound_nats"].item())
        if update % options.every == 0:
            trained, other = (
                " ".join(f"{share:.2f}" for share in accuracy(encoder, data)) for data in (buffer, others)
            )
            print(f"{update:>8} {np.mean(bounds[-100:]):>6.2f}  {trained} | {other}", flush=True)


if __name__ == "__main__":
    main()

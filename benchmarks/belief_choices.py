"""Compare processes, objectives and conditionings by their belief: the encoder alone, on data of random actions.

    python benchmarks/belief_choices.py --out docs/results

Trains BRUNO on transitions of random actions under the training tasks of CheetahVel-v0, in every combination, each with
the same data and number of updates. Tests it on the test tasks: the bound in nats per transition given those before it,
over all steps and over those with ten or more before them (the same quantity whatever the objective); and how much of
the task's variance a linear read-out of the posterior mean explains after 1, 10 and 40 transitions. Prints a row per
combination, median and range over the seeds, and saves every number as JSON.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from pathlib import Path
from typing import Any, get_args

import numpy as np
import torch as th
from encoder_alone import random_transitions, read_out, updates

from sb3_bruno import BrunoEncoder, TaskReplayBuffer
from sb3_bruno.encoders.base import map_memory
from sb3_bruno.encoders.bruno import Objective
from sb3_bruno.evaluation import library_versions
from sb3_bruno.maths.processes import PROCESSES

CONTEXTS = (1, 10, 40)
N_SEQUENCES = 400


def train(choice: dict[str, Any], buffer: TaskReplayBuffer, n_updates: int, learning_rate: float) -> BrunoEncoder:
    """Train an encoder as the cheetah configs have it, with ``choice`` changed."""
    encoder = BrunoEncoder(17, 6, flow_class="reflected_maf", extra_dims=1, **choice)
    for _ in updates(encoder, buffer, n_updates, 8, learning_rate):
        pass
    return encoder.eval()


@th.no_grad()
def test(encoder: BrunoEncoder, buffer: TaskReplayBuffer) -> dict[str, float]:
    """Measure the bound per transition and the share of the task's variance explained.

    Half of the sequences fit the read-out, the other half test it.
    """
    slots, tasks = buffer.exchangeable_slots(N_SEQUENCES, buffer.sequence_length)
    transitions = buffer.transitions(slots)
    nats = encoder.one_step_scores(transitions).mean(dim=0)
    found = {"nats": float(nats.mean()), f"nats after {CONTEXTS[1]} or more": float(nats[CONTEXTS[1] :].mean())}
    prefixes = encoder.prefixes(transitions)
    half = N_SEQUENCES // 2
    for n in CONTEXTS:
        means = encoder.posterior(map_memory(lambda states, n=n: states[:, n], prefixes)).mean.numpy()
        errors = read_out(means, tasks, half) - tasks[half:]
        found[f"explained after {n}"] = float(1 - errors.var() / tasks[half:].var())
    return found


def main() -> None:
    """Parse the command line, train and test every choice with every seed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--transitions", type=int, default=40_000)
    parser.add_argument("--updates", type=int, default=800)
    parser.add_argument("--learning-rate", type=float, default=2e-3)
    parser.add_argument("--out", type=Path, help="folder for belief_choices.json and belief_choices.md")
    options = parser.parse_args()
    th.set_num_threads(1)
    columns = ["nats", f"nats after {CONTEXTS[1]} or more", *(f"explained after {n}" for n in CONTEXTS)]
    lines = [
        "| conditioned on | process | objective | " + " | ".join(columns) + " |",
        "|---" * (3 + len(columns)) + "|",
    ]
    print("\n".join(lines), flush=True)
    data = {
        seed: tuple(
            random_transitions("CheetahVel-v0", options.transitions, seed, CONTEXTS[-1], split=split)
            for split in ("train", "test")
        )
        for seed in options.seeds
    }
    runs = []
    for on_next, process, objective in itertools.product((False, True), PROCESSES, get_args(Objective)):
        choice = {"condition_on_next": on_next, "process": process, "objective": objective}
        tested = []
        for seed, (seen, unseen) in data.items():
            th.manual_seed(seed)
            tested.append(test(train(choice, seen, options.updates, options.learning_rate), unseen))
            runs.append({**choice, "seed": seed, **tested[-1]})
        values = ([result[column] for result in tested] for column in columns)
        cells = [f"{np.median(column):.3f} ({min(column):.3f} to {max(column):.3f})" for column in values]
        lines.append(
            f"| {'(s, a, s_next)' if on_next else '(s, a)'} | {process} | {objective} | " + " | ".join(cells) + " |"
        )
        print(lines[-1], flush=True)
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        about = {"command": " ".join(["python", *sys.argv]), "versions": library_versions()}
        lines += [
            "",
            f"Median (least to greatest) over seeds {options.seeds}.",
            f"Made by `{about['command']}`, {about['versions']}.",
        ]
        (options.out / "belief_choices.md").write_text("\n".join(lines) + "\n")
        (options.out / "belief_choices.json").write_text(json.dumps({**about, "runs": runs}, indent=1) + "\n")


if __name__ == "__main__":
    main()

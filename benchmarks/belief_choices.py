"""Compare processes, flows and sizes by their belief: the encoder alone, on data of random actions.

    python benchmarks/belief_choices.py --out docs/results

Trains BRUNO on transitions of random actions under the training tasks of a family, with each choice, on the same data
and with the same number of updates. Tests it on the test tasks: log score of a transition given those before it, in
nats, over all steps and over those with ten or more before them; and how much of the task's variance a linear read-out
of the posterior mean, fitted on the training tasks, explains after some transitions. Prints a row for each choice,
median and range over the seeds, and saves every number as JSON.
"""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch as th
from encoder_alone import explained, random_transitions, updates
from made_by import about_this_run, made_by

from sb3_bruno import BrunoEncoder, TaskReplayBuffer
from sb3_bruno.encoders.base import map_memory

CONTEXTS = (1, 5, 20, 40)
N_SEQUENCES = 400
FAMILIES = {
    "PointGoal-v0": {"modelled": "rewards"},
    "PointRotation-v0": {"modelled": "next_observations"},
    "CheetahVel-v0": {"modelled": "rewards"},
}
PAPER = {"process": "gaussian", "flow_class": "paper_maf", "extra_dims": 4}
CHOICES: dict[str, dict[str, Any]] = {
    "kernel": {},
    "kernel, 4 weights": {"n_weights": 4},
    "kernel, 16 weights": {"n_weights": 16},
    "kernel, no flow": {"flow_class": None},
    "kernel_student_t": {"process": "kernel_student_t"},
    "gaussian, the paper's flow and noise": PAPER,
    "gaussian, the paper's objective too": {**PAPER, "objective": "paper"},
    "gaussian, reflected_maf": {"process": "gaussian", "flow_class": "reflected_maf", "extra_dims": 1},
}


def train(
    kwargs: dict[str, Any], buffer: TaskReplayBuffer, dims: tuple[int, int], n_updates: int, learning_rate: float
) -> BrunoEncoder:
    """Train an encoder of observations and actions of ``dims``."""
    encoder = BrunoEncoder(*dims, **kwargs)
    for _ in updates(encoder, partial(buffer.sample_sequences, 16), n_updates, learning_rate):
        pass
    return encoder.eval()


@th.no_grad()
def test(encoder: BrunoEncoder, seen: TaskReplayBuffer, unseen: TaskReplayBuffer) -> dict[str, float]:
    """Measure the log score of a transition and the share of the task's variance explained, on unseen tasks.

    The read-out is fitted on the seen tasks.
    """
    drawn = [buffer.exchangeable_slots(N_SEQUENCES, buffer.sequence_length) for buffer in (seen, unseen)]
    tasks = [of_buffer for _, of_buffer in drawn]
    transitions = [buffer.transitions(slots) for buffer, (slots, _) in zip((seen, unseen), drawn, strict=True)]
    nats = encoder.one_step_scores(transitions[1]).mean(dim=0)
    found = {"nats": float(nats.mean()), "nats after 10 or more": float(nats[10:].mean())}
    prefixes = [encoder.prefixes(of_buffer) for of_buffer in transitions]
    for n in CONTEXTS:
        means = [
            encoder.posterior(map_memory(lambda states, n=n: states[:, n], memory)).mean.numpy() for memory in prefixes
        ]
        found[f"explained after {n}"] = explained((means[0], tasks[0]), (means[1], tasks[1]))
    return found


def main() -> None:
    """Parse the command line, train and test every choice with every seed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), choices=list(FAMILIES), metavar="ID")
    parser.add_argument("--choices", nargs="+", default=list(CHOICES), choices=list(CHOICES), metavar="NAME")
    parser.add_argument("--transitions", type=int, default=40_000)
    parser.add_argument("--updates", type=int, default=1_000)
    parser.add_argument("--learning-rate", type=float, default=1e-3)
    parser.add_argument("--out", type=Path, help="folder for belief_choices.json and belief_choices.md")
    options = parser.parse_args()
    th.set_num_threads(1)
    columns = ["nats", "nats after 10 or more", *(f"explained after {n}" for n in CONTEXTS)]
    lines = ["| family | choice | " + " | ".join(columns) + " |", "|---" * (2 + len(columns)) + "|"]
    print("\n".join(lines), flush=True)
    runs = []
    for family in options.families:
        observation, action = (
            gym.make(f"sb3_bruno_envs:{family}", observe="plain").get_wrapper_attr(name).shape[0]
            for name in ("observation_space", "action_space")
        )
        data = {
            seed: [
                random_transitions(family, options.transitions, seed, 64, split=split) for split in ("train", "test")
            ]
            for seed in options.seeds
        }
        for choice in options.choices:
            tested = []
            for seed, (seen, unseen) in data.items():
                th.manual_seed(seed)
                kwargs = {**FAMILIES[family], **CHOICES[choice]}
                encoder = train(kwargs, seen, (observation, action), options.updates, options.learning_rate)
                tested.append(test(encoder, seen, unseen))
                runs.append({"family": family, "choice": choice, "seed": seed, **tested[-1]})
            values = ([result[column] for result in tested] for column in columns)
            cells = [f"{np.median(column):.2f} ({min(column):.2f} to {max(column):.2f})" for column in values]
            lines.append(f"| {family} | {choice} | " + " | ".join(cells) + " |")
            print(lines[-1], flush=True)
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        about = about_this_run()
        lines += ["", f"Median (least to greatest) over seeds {options.seeds}.", made_by(about)]
        (options.out / "belief_choices.md").write_text("\n".join(lines) + "\n")
        (options.out / "belief_choices.json").write_text(json.dumps({**about, "runs": runs}, indent=1) + "\n")


if __name__ == "__main__":
    main()

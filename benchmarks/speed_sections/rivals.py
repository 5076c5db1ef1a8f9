"""``train()`` beside what a user would pick instead, and beside the limit of this core."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from speed_sections.limit import matrix_products
from speed_sections.models import CHEETAH, CONFIG, KERNEL, plain, trained
from speed_sections.race import Row, Seconds, race, row

LIMIT = "bare matrix products"
SBX = "sbx's SAC (JAX)"
TARGETS = {"CheetahDir's config": "<= 0.85", "CheetahDir's config, the default encoder": "<= 0.85"}


def training(rounds: int, sbx: str | None) -> tuple[list[Row], Seconds]:
    """Time ``train()`` with beliefs and encoder updates at CheetahDir's config, all batches of one size.

    SB3's SAC is as a user finds it, and with the fused Adam that the config has.

    Args:
        rounds: of the comparison.
        sbx: the interpreter of an environment that has sbx; None leaves that row out.
    """
    steps, batch = CONFIG["gradient_steps"], CONFIG["batch_size"]
    net: dict[str, Any] = {"net_arch": [256, 256]}
    models = {
        "SB3's SAC": plain(policy_kwargs=net),
        "SB3's SAC, fused Adam": plain(policy_kwargs={**net, "optimizer_kwargs": {"fused": True}}),
        "CheetahDir's config": trained(**CHEETAH),
        "CheetahDir's config, the default encoder": trained(**KERNEL),
    }
    for name in TARGETS:
        models[name].encoder_learning_starts = 0
    work: dict[str, Any] = {name: partial(model.train, steps, batch) for name, model in models.items()}
    products = matrix_products(batch)
    work[LIMIT] = lambda: [products() for _ in range(steps)] and None
    with sbx_training(sbx, steps, batch) as rival:
        if rival is not None:
            work[SBX] = rival
        seconds = race(work, rounds, 4)
    title = f"train({steps}), batch {batch}, "
    rows = [row(title + name, seconds, name, "SB3's SAC", TARGETS.get(name, ""), steps, LIMIT) for name in work]
    return rows, seconds


@contextmanager
def sbx_training(interpreter: str | None, steps: int, batch: int) -> Iterator[Any]:
    """Start sbx's SAC in a process of its own, and give a function that trains it there and returns the seconds."""
    if interpreter is None:
        print(f"{SBX} is left out: `--sbx PYTHON` names the interpreter of an environment with `pip install sbx-rl`.")
        yield None
        return
    command = [interpreter, str(Path(__file__).with_name("sbx_worker.py"))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as worker:
        assert worker.stdin is not None and worker.stdout is not None  # for mypy

        def train() -> float:
            print(steps, batch, file=worker.stdin, flush=True)
            return float(worker.stdout.readline())

        train()  # which compiles
        yield train
        worker.stdin.close()

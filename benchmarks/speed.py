"""Measure how fast everything is on one thread, each beside what it should be compared with, in the same run.

    python -m venv sbx && sbx/bin/pip install sbx-rl
    python benchmarks/speed.py --out docs/performance --sbx sbx/bin/python

Every comparison runs its contestants in turn, for many rounds of a fixed amount of work, and takes the ratio within a
round: a machine that is slow for a while is slow for both. Time is the processor time of a process, so what other
processes use does not count. Prints the median over the rounds and the quartiles in brackets; ``speed.json`` has all
rounds. Takes less than ten minutes on an idle machine: leave it alone meanwhile.
"""

from __future__ import annotations

import argparse
import json
import platform
import resource
from functools import partial
from pathlib import Path
from typing import Any

import torch as th
from made_by import about_this_run, made_by
from speed_sections.acting import acting
from speed_sections.parts import parts
from speed_sections.race import table
from speed_sections.rivals import training
from speed_sections.rollouts import rollouts
from speed_sections.sizes import episodes, growth, memory, sampling
from speed_sections.updates import actor_critic_updates, encoder_updates

ALL = (training, parts, encoder_updates, actor_critic_updates, rollouts, acting, sampling, episodes, growth, memory)
SECTIONS: dict[str, Any] = {section.__name__: section for section in ALL}


def main() -> None:
    """Parse the command line, measure, write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--rounds", type=int, default=20, help="rounds of each comparison (default 20)")
    parser.add_argument("--only", nargs="+", choices=SECTIONS, default=[*SECTIONS], help="sections to run")
    parser.add_argument("--sbx", metavar="PYTHON", help="interpreter of an environment that has sbx-rl")
    parser.add_argument("--out", type=Path, help="folder for speed.md and speed.json")
    options = parser.parse_args()
    th.set_num_threads(1)
    sections = {**SECTIONS, "training": partial(training, sbx=options.sbx)}
    rows, seconds = [], {}
    for name in options.only:
        new, seconds[name] = sections[name](options.rounds)
        print(table(new), flush=True)
        rows += new
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # MiB: Linux counts in KiB
    about = {**about_this_run(), "machine": platform.machine(), "torch_threads": 1, "peak_mib": peak}
    print(f"peak memory of this process: {peak:,.0f} MiB")
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        told = f"{made_by(about)} One thread; peak memory {peak:,.0f} MiB.\n\n"
        (options.out / "speed.md").write_text(told + table(rows), encoding="utf-8")
        text = json.dumps({**about, "rows": [entry._asdict() for entry in rows], "seconds": seconds}, indent=1)
        (options.out / "speed.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

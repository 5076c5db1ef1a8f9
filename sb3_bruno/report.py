"""A results page from recorded runs: the table, the figures, and the command that made them.

python -m sb3_bruno.report runs/*_seed* --out docs/results
"""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from sb3_bruno.adaptation_result import AdaptationResult
from sb3_bruno.eval_callback import load_learning_curve
from sb3_bruno.plotting import plot_adaptation, plot_learning_curves


def main(arguments: list[str] | None = None) -> None:
    """Parse the command line, record the runs' raw data beside the page, draw and write."""
    parser = argparse.ArgumentParser(prog="python -m sb3_bruno.report", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("runs", nargs="+", type=Path, help="folders that `python -m sb3_bruno.quickstart` wrote")
    parser.add_argument("--out", type=Path, default=Path("docs/results"), help="folder of raw data and figures")
    options = parser.parse_args(arguments)
    missing = [str(run) for run in options.runs if not (run / "summary.json").is_file()]
    if missing:
        parser.error(f"no summary.json in {', '.join(missing)}: give folders of finished runs")
    recorded = [record(run, options.out) for run in sorted(options.runs)]
    results = {
        f"seed {load(run)['config']['seed']}": AdaptationResult.load(run / "adaptation.json") for run in recorded
    }
    plot_adaptation({"BrunoSAC": pooled(list(results.values()))}, options.out / "adaptation.png")
    curves = [load_learning_curve(run) for run in recorded]
    plot_learning_curves({"BrunoSAC": curves}, options.out / "learning_curves.png")
    table = markdown([load(run) for run in recorded])
    (options.out / "table.md").write_text(table, encoding="utf-8")
    print(table)


def record(run: Path, out: Path) -> Path:
    """Copy a run's raw data, not its model and checkpoint, to ``out``."""
    folder = out / run.name
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("summary.json", "adaptation.json", "evaluations.npz", "evaluation_tasks.npz"):
        if run.resolve() != folder.resolve():
            shutil.copyfile(run / name, folder / name)
    return folder


def load(run: Path) -> dict[str, Any]:
    """A run's summary."""
    summary: dict[str, Any] = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    return summary


def pooled(results: list[AdaptationResult]) -> AdaptationResult:
    """All seeds' episodes as one result."""
    return AdaptationResult(results[0].tasks, np.concatenate([one.rewards for one in results], axis=1))


def markdown(summaries: list[dict[str, Any]]) -> str:
    """One row per seed, and the median over seeds."""
    lines = [
        "| seed | env steps | 1,000 steps: mean | backward | forward | lowest episode | 200 steps: backward | forward "
        "| steps to 90 % | commit |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for one in summaries:
        long, short, config = one["return_1000"], one["return_200"], one["config"]
        steady = " / ".join(map(str, one["steps_to_steady"]))
        numbers = [long["mean"], long["backward"], long["forward"], one["lowest_episode_1000"], *short.values()]
        cells = [str(config["seed"]), f"{config['env_steps']:,}", *(f"{number:.0f}" for number in numbers), steady]
        lines.append(f"| {' | '.join(cells)} | {one['versions'].get('commit', '?')[:7]} |")
    median = np.median([one["return_1000"]["mean"] for one in summaries])
    lines.append(
        f"\nMedian over {len(summaries)} seeds of the mean return over both directions at 1,000 steps: {median:.0f}."
    )
    names = ("python", "torch", "stable_baselines3", "gymnasium", "mujoco", "zuko")
    lines.append("Versions: " + ", ".join(f"{name} {summaries[0]['versions'].get(name, '?')}" for name in names) + ".")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()

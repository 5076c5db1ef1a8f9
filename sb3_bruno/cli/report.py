"""``sb3-bruno report``: record runs, then make a results page of all recorded runs.

sb3-bruno report logs/*/CheetahDir-v0_* --out docs/results/cheetah_dir
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sb3_bruno.cli.mistake import Mistake, check_installed, told_as_mistake
from sb3_bruno.cli.parser import command_parser
from sb3_bruno.cli.values import writable_folder

if TYPE_CHECKING:
    from sb3_bruno.runs.record import RunRecord

LONGEST = 100  # characters of a folder's name


def report(arguments: list[str]) -> None:
    """Record runs that ``evaluate`` tested, then make tables and figures of all runs recorded in a folder.

    example: sb3-bruno report logs/bruno_sac/CheetahDir-v0_* --out results
    """
    parser = command_parser("report", report)
    parser.add_argument("runs", nargs="*", type=Path, help="folders of tested runs, or files adaptation*.json in them")
    parser.add_argument(
        "--out", type=writable_folder, default=Path("results"), help="where the records and the page are"
    )
    options = parser.parse_args(arguments)
    check_installed("matplotlib", "pandas")

    from sb3_bruno.report.page import check_budgets, write_page
    from sb3_bruno.zoo.called import with_names

    with told_as_mistake():
        new = {options.out / folder: record for folder, record in _records_of(options.runs).items()}
        old = _recorded(options.out)
        for folder in new.keys() & old.keys():
            if new[folder].method != old[folder].method:
                raise Mistake(f"{folder} holds {old[folder].method}: give {new[folder].method} an --out of its own")
        check_budgets({**old, **new}.values())
        for folder, record in new.items():
            record.save(folder)
        records = list(_recorded(options.out).values())
        if not records:
            raise Mistake(f"{options.out} holds no record and no run was given: give folders of runs that were tested")
        print(write_page(list(map(with_names, records)), options.out))


def _recorded(out: Path) -> dict[Path, RunRecord]:
    """Load the records in a page's folder, by the folder of each."""
    from sb3_bruno.runs.record import RunRecord

    return {path.parent: RunRecord.load(path.parent) for path in sorted(out.glob("*/*/run.json"))}


def _records_of(runs: Sequence[Path]) -> dict[str, RunRecord]:
    """Make a record of each run, by the folder to keep it in.

    Raises:
        Mistake: if two runs have the same method and seed.
    """
    from sb3_bruno.evaluation.progress import progress
    from sb3_bruno.runs.record import RunRecord

    records: dict[str, RunRecord] = {}
    for run in progress(runs, shown=True, about="runs"):
        record = RunRecord.from_run(run)
        folder = f"{_folder_name(record.method)}/{_folder_name('seed' + str(record.about['config'].get('seed')))}"
        if folder in records:
            raise Mistake(f"{run} is a second run of {folder}, and a page takes one per method and seed: leave one out")
        records[folder] = record
    return records


def _folder_name(text: str) -> str:
    """Make one folder's name of what a record says, which may be a path, or longer than a file system takes."""
    name = re.sub(r"[^\w.=-]+", "_", text).strip("._")
    if 0 < len(name) <= LONGEST:
        return name
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    return f"{name[:LONGEST]}_{digest}".lstrip("_")

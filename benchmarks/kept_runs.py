"""Runs of a benchmark by name and seed, in a JSON file, so that a run that was made is not made again."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from made_by import about_this_run, made_by

Row = dict[str, float]


class KeptRuns:
    """Keeps what each run found, in ``<folder>/<name>.json``, from which the table beside it is written.

    Args:
        folder: where to keep them. None: nowhere.
        name: of both files.
        **settings: what all runs have in common, such as ``steps=20_000``.

    Raises:
        ValueError: if the file's runs were made with other settings.
    """

    def __init__(self, folder: Path | None, name: str, **settings: Any) -> None:
        self._path = None if folder is None else folder / f"{name}.json"
        self._settings = settings
        self._about = {**settings, **about_this_run()}
        self.rows: dict[str, dict[str, Row]] = {}
        self._commits: dict[str, dict[str, str]] = {}
        self._read()
        if self._path is not None:
            self._path.parent.mkdir(parents=True, exist_ok=True)

    def make(self, name: str, seed: int, run: Callable[[], Row]) -> None:
        """Make a run, unless it was made before, print what it found and keep it."""
        if str(seed) in self.rows.get(name, {}):
            return
        row = run()
        print(f"{name}, seed {seed}: {row}", flush=True)
        self._read()  # another process may have made some meanwhile
        self.rows.setdefault(name, {})[str(seed)] = row
        self._commits.setdefault(name, {})[str(seed)] = self._about["versions"].get("commit", "unknown")
        self._keep()

    def write_table(self, lines: list[str], note: str) -> None:
        """Print the lines of a table, and write them beside the JSON file, with a note on what they are."""
        print("\n".join(lines))
        self._keep()
        if self._path is not None:
            commits = sorted({commit for by_seed in self._commits.values() for commit in by_seed.values()})
            told = f"{note} {made_by(self._about)} Runs at commit {', '.join(commits)}."
            self._path.with_suffix(".md").write_text("\n".join(lines) + f"\n\n{told}\n")

    def _keep(self) -> None:
        if self._path is not None:
            kept = {**self._about, "runs": self.rows, "commits": self._commits}
            self._path.write_text(json.dumps(kept, indent=1) + "\n")

    def _read(self) -> None:
        if self._path is None or not self._path.is_file():
            return
        kept = json.loads(self._path.read_text())
        for name, value in self._settings.items():
            if kept[name] != value:
                raise ValueError(f"{self._path} has {name}={kept[name]}, not {value}: choose another `--out`.")
        self.rows, self._commits = kept["runs"], kept["commits"]

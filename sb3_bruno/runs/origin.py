"""Where a run came from: the command that started it, and the versions that trained each part of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sb3_bruno.evaluation.versions import library_versions

ORIGIN = "sb3_bruno_origin.json"


def save_origin(run: Path, command: list[str]) -> None:
    """Write the origin of a run; a resumed run keeps its first command and adds the versions of now."""
    before = _load(run)
    origin = {"command": command, **before, "versions": [*before.get("versions", []), library_versions()]}
    (run / ORIGIN).write_text(json.dumps(origin, indent=1) + "\n", encoding="utf-8")


def load_command(run: Path) -> list[str]:
    """Return the command that started a run, with its seed.

    Raises:
        FileNotFoundError: if the folder holds no origin.
    """
    command: list[str] = json.loads((run / ORIGIN).read_text(encoding="utf-8"))["command"]
    return command


def trained_at(run: Path) -> list[str]:
    """Return the commits that a run was trained at, in order; the package's version stands in for a missing commit."""
    parts = [part.get("commit", part.get("sb3_bruno", "?")) for part in _load(run).get("versions", [])]
    return list(dict.fromkeys(parts))


def _load(run: Path) -> dict[str, Any]:
    """Read the origin of a run, empty if there is none."""
    path = run / ORIGIN
    origin: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    return origin

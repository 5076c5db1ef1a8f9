"""Where a run came from: the command that started it, and the versions that each of its parts was trained with."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sb3_bruno.evaluation.versions import library_versions

ORIGIN = "sb3_bruno_origin.json"


def save_origin(run: Path, command: list[str]) -> None:
    """Write where a run comes from; one that goes on keeps its first command and adds its versions."""
    before = _load(run)
    origin = {"command": command, **before, "versions": [*before.get("versions", []), library_versions()]}
    (run / ORIGIN).write_text(json.dumps(origin, indent=1) + "\n", encoding="utf-8")


def load_command(run: Path) -> list[str]:
    """The command that started a run, its seed included.

    :raises FileNotFoundError: if the folder holds none
    """
    command: list[str] = json.loads((run / ORIGIN).read_text(encoding="utf-8"))["command"]
    return command


def trained_at(run: Path) -> list[str]:
    """The commits that a run was trained at, in order, or the package's versions where it was installed without one."""
    parts = [part.get("commit", part.get("sb3_bruno", "?")) for part in _load(run).get("versions", [])]
    return list(dict.fromkeys(parts))


def _load(run: Path) -> dict[str, Any]:
    path = run / ORIGIN
    origin: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    return origin

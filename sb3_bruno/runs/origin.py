"""Where a run came from: the command that started it, and the versions that trained each part of it."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

from sb3_bruno.evaluation.versions import library_versions
from sb3_bruno.files.whole import whole_file

ORIGIN = "sb3_bruno_origin.json"


def save_origin(run: Path, command: list[str]) -> None:
    """Write the origin of a run; a resumed run keeps its first command and adds the versions of now."""
    before = _load(run)
    origin = {"command": command, **before, "versions": [*_versions(before), library_versions()]}
    with whole_file(run / ORIGIN) as part:
        part.write_text(json.dumps(origin, indent=1) + "\n", encoding="utf-8")


def load_command(run: Path) -> list[str]:
    """Return the command that started a run, with its seed.

    Raises:
        ValueError: if the folder holds no origin that can be read.
    """
    command = _load(run).get("command")
    if not isinstance(command, list) or not all(isinstance(part, str) for part in command):
        raise ValueError(f"{run / ORIGIN} does not tell the command that started the run: copy it there from a backup")
    return command


def trained_at(run: Path) -> list[str]:
    """Return the commits that a run was trained at, in order; the package's version stands in for a missing commit."""
    parts = [part.get("commit", part.get("sb3_bruno", "?")) for part in _versions(_load(run))]
    return list(dict.fromkeys(parts))


def _versions(origin: dict[str, Any]) -> list[dict[str, str]]:
    """Return the versions that trained each part; a part that somebody wrote otherwise is left out."""
    versions = origin.get("versions")
    return [part for part in versions if _are_texts_by_name(part)] if isinstance(versions, list) else []


def _are_texts_by_name(part: Any) -> bool:
    return isinstance(part, dict) and all(isinstance(text, str) for text in part.values())


def _load(run: Path) -> dict[str, Any]:
    """Read the origin of a run, empty if there is none, or, with a warning, if it cannot be read."""
    path = run / ORIGIN
    if not path.is_file():
        return {}
    try:
        origin = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(origin, dict):
            raise ValueError("it holds no JSON object")
    except (OSError, ValueError, RecursionError) as error:  # the last if it is nested too deep
        warnings.warn(f"{path} cannot be read ({error}), so nobody knows at which commit the run trained", stacklevel=3)
        return {}
    return origin

"""Takes the places of one machine out of what tells how a run was made, before it goes to others."""

from __future__ import annotations

import json
from collections import OrderedDict
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import yaml

from sb3_bruno.runs.origin import load_command
from sb3_bruno.zoo.saved_yaml import read_saved


def copy_arguments(source: Path, target: Path) -> None:
    """Write the ``args.yml`` of a run with names for folders.

    Raises:
        ValueError: if it cannot be read.
    """
    arguments = OrderedDict((name, _named(value)) for name, value in read_saved(source).items())
    target.write_text(yaml.dump(arguments), encoding="utf-8")


def copy_origin(source: Path, target: Path) -> None:
    """Write the origin of a run with names for folders in its command.

    Raises:
        ValueError: if it cannot be read.
    """
    command = load_command(source.parent)
    origin = {**json.loads(source.read_text(encoding="utf-8")), "command": _named(command)}
    target.write_text(json.dumps(origin, indent=1) + "\n", encoding="utf-8")


def _named(value: Any) -> Any:
    """Return a value in which an absolute path is its last part: who made an agent may keep to himself where."""
    if isinstance(value, list):
        return [_named(part) for part in value]
    if not isinstance(value, str):
        return value
    before, mark, said = value.rpartition(":///" if ":///" in value else "=")
    kinds = (PurePosixPath, PureWindowsPath)
    if mark == ":///" or said.startswith("~") or any(kind(said).is_absolute() for kind in kinds):
        said = PureWindowsPath(said).name  # which knows both kinds of strokes
    return f"{before}{mark}{said}"

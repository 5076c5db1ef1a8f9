"""Takes the places of one machine out of what tells how a run was made, before it goes to others."""

from __future__ import annotations

import json
import re
from collections import OrderedDict
from pathlib import Path
from typing import Any

import yaml

from sb3_bruno.runs.origin import load_command
from sb3_bruno.zoo.saved_yaml import read_saved

_INSIDE = r"(?<![\w./\\~-])"  # not in a relative path or a word: behind a blank, a quote, `=`, `:` or nothing
_ABSOLUTE = re.compile(
    rf"""(?:(?<=:///)|(?<=file://)      # behind an address's scheme
      | {_INSIDE}[A-Z]:/                # a drive of Windows; a:/b is an entry called a
      | {_INSIDE}[A-Za-z]:\\
      | {_INSIDE}\\\\(?=\w)             # another computer
      | {_INSIDE}~[\w.-]*[/\\]          # a home
      | (?:{_INSIDE}|(?<=^-[A-Za-z]))   # -f/home is a short flag with its value
        (?!(?<=:)//)/+(?=[^\s/])        # but no https://
    )
    (?:(?!\s+[-/~])[^'"`,;<>|()\[\]{{}}\n])+  # blanks may be part of it, but no further flag or path
    """,
    re.VERBOSE,
)


def copy_settings(source: Path, target: Path) -> None:
    """Write the ``args.yml`` or ``config.yml`` of a run with names for files and folders.

    Raises:
        ValueError: if it cannot be read.
    """
    target.write_text(yaml.dump(OrderedDict(without_places(read_saved(source)))), encoding="utf-8")


def copy_origin(source: Path, target: Path) -> None:
    """Write the origin of a run with names for files and folders.

    Raises:
        ValueError: if it cannot be read.
    """
    load_command(source.parent)  # which refuses what has none
    origin = without_places(json.loads(source.read_text(encoding="utf-8")))
    target.write_text(json.dumps(origin, indent=1) + "\n", encoding="utf-8")


def without_places(value: Any) -> Any:
    """Return a value in which absolute paths are their last parts: who made an agent may keep to himself where.

    Args:
        value: a text, or what holds texts, however deep.
    """
    if isinstance(value, str):
        return _ABSOLUTE.sub(lambda found: re.split(r"[/\\]+", found[0].rstrip("/\\ "))[-1], value)
    if isinstance(value, dict):
        return type(value)((without_places(name), without_places(entry)) for name, entry in value.items())
    if isinstance(value, list | tuple | set):
        return type(value)(map(without_places, value))
    return value

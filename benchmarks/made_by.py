"""Tells how a benchmark's numbers were made: the command and the versions, for its JSON file and for its table."""

from __future__ import annotations

import shlex
import sys
from typing import Any

from sb3_bruno.evaluation import library_versions


def about_this_run() -> dict[str, Any]:
    """Return the command that runs, and the versions of what it runs on."""
    return {"command": shlex.join(["python", *sys.argv]), "versions": library_versions()}


def made_by(about: dict[str, Any]) -> str:
    """Say in a sentence what ``about_this_run`` returned."""
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
    return f"Made by `{about['command']}`, with {versions}."

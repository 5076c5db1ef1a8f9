"""The versions of the libraries that a result depends on, and the commit of this package."""

from __future__ import annotations

import platform
import subprocess
from importlib import metadata
from pathlib import Path


def library_versions() -> dict[str, str]:
    """Return the versions that a result depends on, and this package's git commit if it runs from a clone."""
    versions = {"python": platform.python_version()}
    for name in (
        "sb3_bruno",
        "stable_baselines3",
        "sb3_contrib",
        "torch",
        "zuko",
        "numpy",
        "gymnasium",
        "mujoco",
    ):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:  # not installed, as when the package runs from its source tree
            continue
    commit = _git_commit(Path(__file__))
    return versions | ({"commit": commit} if commit else {})


def _git_commit(file: Path) -> str | None:
    """Return the commit of the clone that tracks ``file``, with ``-dirty`` after a change; None without a clone."""
    git = ["git", "-C", str(file.parent)]
    try:
        subprocess.run([*git, "ls-files", "--error-unmatch", file.name], check=True, capture_output=True)
        describe = [*git, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
        return subprocess.run(describe, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return None

"""Writes a command that a user can run as it stands: quoted for a shell, and with the packages that it needs."""

import shlex
from collections.abc import Sequence
from pathlib import Path


def shown_command(name: str, *arguments: str | int | Path) -> str:
    """Write a command of ours, such as ``sb3-bruno sweep run --storage 'my sweep.log'``."""
    return shlex.join(["sb3-bruno", *name.split(), *map(str, arguments)])


def env_flags(env: str, packages: Sequence[str]) -> list[str]:
    """Return the flags that choose an environment: ``--env my_envs:Mine-v0`` for one of the package ``my_envs``.

    Args:
        env: id of the environment, without its package.
        packages: those to import, which register environments or hold what their configs name.
    """
    if len(packages) == 1:
        return ["--env", f"{packages[0]}:{env}"]
    return ["--env", env, *(["--gym-packages", *packages] if packages else [])]

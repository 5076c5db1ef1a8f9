"""The files of an agent that is shared: in a folder like a run's, and in a repository of the hub."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from sb3_bruno.export.card import PICTURE
from sb3_bruno.export.limits import LARGEST_TENSORS, LARGEST_TEXT
from sb3_bruno.files.shown import shown
from sb3_bruno.runs.folder import AGENT_FILE
from sb3_bruno.runs.origin import ORIGIN

CARD, DIAGNOSED = "README.md", "diagnostics.txt"
_FURTHER = (ORIGIN, PICTURE, DIAGNOSED)
_ENV = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")  # no path upwards, no flag, nothing that a shell reads


def needed_files(env: str) -> list[str]:
    """Name the files without which an agent is not shared.

    Args:
        env: the environment's name, as the folders of runs are named.
    """
    return [f"{env}{AGENT_FILE}", f"{env}/args.yml", f"{env}/config.yml", CARD]


def shared_files(folder: Path, env: str) -> list[str]:
    """Name the files of an agent in a folder that are shared.

    Raises:
        ValueError: if one is missing.
    """
    for name in needed_files(env):
        if not (folder / name).is_file():
            raise ValueError(f"{folder} has no {name}: make such a folder from a run by `sb3-bruno pack`")
    return [*needed_files(env), *(name for name in _FURTHER if (folder / name).is_file())]


def check_names(names: Iterable[str], place: str) -> str:
    """Refuse other files than those of one agent.

    Args:
        names: their paths.
        place: where they are, for the error.

    Returns:
        The name of the environment.

    Raises:
        ValueError: naming the file that is too much, or missing.
    """
    found = set(names)
    agents = [name.removesuffix(AGENT_FILE) for name in found if name.endswith(AGENT_FILE)]
    if len(agents) != 1:
        raise ValueError(f"{place} holds {len(agents)} agent files, not one: give another")
    if not _ENV.fullmatch(agents[0]):
        raise ValueError(
            f"{place} holds an agent of {shown(agents[0])}, which cannot be shared by that name: register the "
            "environment by one of letters, digits, dots, dashes and underscores"
        )
    needed = set(needed_files(agents[0]))
    for name in sorted(found - needed - set(_FURTHER)):
        raise ValueError(f"{place} holds {shown(name)}, which is no file of an agent: give another")
    for name in sorted(needed - found):
        raise ValueError(f"{place} lacks {name}: give another")
    return agents[0]


def check_sizes(sizes: Mapping[str, int | None], place: str) -> None:
    """Refuse files of an agent that are larger than any.

    Args:
        sizes: bytes by path; None where nobody knows.
        place: where they are, for the error.

    Raises:
        ValueError: naming the file.
    """
    for name, size in sizes.items():
        largest = LARGEST_TENSORS + 2 * LARGEST_TEXT if name.endswith(AGENT_FILE) else 4 * LARGEST_TEXT
        if size is None or size > largest:
            raise ValueError(f"{place}: {name} has {size} bytes, and {largest:,} are allowed")

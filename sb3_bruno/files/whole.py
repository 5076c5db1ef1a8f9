"""Writes files that are whole whenever the process dies: in a folder of their own first, then renamed."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


class NotWritten(OSError):
    """Raised with a path that cannot be written, why, and what to do."""


def not_written(path: str | Path, error: OSError, remedy: str) -> NotWritten:
    """Make the error that names a path which cannot be written, the system's reason and the remedy."""
    return NotWritten(f"{path} cannot be written ({error.strerror or error}): {remedy}.")


def is_full(error: OSError) -> bool:
    """Tell whether a disk, or the user's share of it, has no room for what was to be written."""
    return error.errno in _FULL


@contextmanager
def whole_files(folder: str | Path, name: str) -> Iterator[Path]:
    """Yield an empty folder to write files in; at the end of the block they replace those of their names in ``folder``.

    A file is on the disk before it gets its name. If the block raises or the process dies, the older files stay as they
    were. What a dead process left is removed by the next block of the same name.

    Args:
        folder: where the files belong; it is made if need be.
        name: tells this block from others that may write to ``folder`` at the same time.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    part = folder / f".unfinished-{name}"
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    try:
        yield part
        for file in sorted(part.iterdir()):
            with file.open("r+b") as written:
                os.fsync(written.fileno())
            os.replace(file, folder / file.name)
        _sync_names(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Yield a path to write; at the end of the block the file replaces that at ``path``, as in ``whole_files``."""
    path = Path(os.path.realpath(path))  # a link stays a link
    with whole_files(path.parent, path.name) as part:
        yield part / path.name


def check_writable(path: str | Path) -> None:
    """Check that ``whole_file`` can write to ``path``, whose folder is made; an older file there stays.

    Raises:
        ValueError: if it cannot.
    """
    path = Path(os.path.realpath(path))
    try:
        if path.is_dir():
            raise IsADirectoryError("it is a folder")
        with whole_files(path.parent, path.name):
            pass
    except OSError as error:
        raise ValueError(f"path={path} cannot be written ({error.strerror or error}): give another file.") from error


def _sync_names(folder: Path) -> None:
    """Wait until the names of the files in ``folder`` are on the disk."""
    with suppress(OSError):  # Windows opens no folder, and some network disks sync none
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)

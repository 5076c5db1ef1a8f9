"""A sealed file begins with its format and a checksum, so that damage is found before anything is read from it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from sb3_bruno.files.whole import whole_file

_DIGEST = "sha256"
_DIGITS = 2 * hashlib.new(_DIGEST).digest_size


class Damaged(Exception):
    """Raised with what is wrong with a sealed file."""


class _Hashed:
    """Writes to a file, and hashes what it writes."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.digest = hashlib.new(_DIGEST)

    def write(self, data: Any) -> int:
        self.digest.update(data)
        return self._file.write(data)


@contextmanager
def sealing(path: str | Path, format_line: str) -> Iterator[_Hashed]:
    """Yield an object to write to; at the end of the block the sealed file at ``path`` holds it, whole.

    Args:
        path: the file; an older one stays as it is until the new one replaces it.
        format_line: kind and version of the content, in one line. It is the first line of the file.
    """
    with whole_file(path) as part, part.open("wb") as file:
        file.write(f"{format_line}\n{'0' * _DIGITS}\n".encode())
        hashed = _Hashed(file)
        yield hashed
        file.seek(len(format_line) + 1)
        file.write(hashed.digest.hexdigest().encode())


@contextmanager
def unsealed(path: str | Path, format_line: str) -> Iterator[IO[bytes]]:
    """Yield a sealed file, open where its content begins. It is hashed piece by piece first, and never held in memory.

    Raises:
        FileNotFoundError: if there is no file at ``path``.
        Damaged: if it is not of this format, or not as it was written.
    """
    if Path(path).is_dir():
        raise Damaged("it is a folder")
    with open(path, "rb") as file:
        found = file.readline(len(format_line) + 1)
        if found != f"{format_line}\n".encode():
            raise Damaged(f"it does not begin with {format_line!r}")
        digest, start = file.read(_DIGITS + 1), file.tell()
        if hashlib.file_digest(file, _DIGEST).hexdigest().encode() + b"\n" != digest:
            raise Damaged("its checksum is not that of its content")
        file.seek(start)
        yield file

"""The journal file of a study: repaired when a worker died in mid-write, and refused when damaged elsewhere."""

from __future__ import annotations

import json
import os
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import BinaryIO

from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileSymlinkLock
from optuna.storages.journal._file import BaseJournalFileLock
from optuna.storages.journal._storage import JournalOperation

START = b'{"op_code":'  # of every entry; an entry is a line
OPERATIONS = frozenset(JournalOperation)  # those that this version of Optuna knows
GRACE = 10  # seconds, after which a lock of Optuna's that nobody releases is taken over


def open_journal(path: Path) -> JournalStorage:
    """Open a journal, or begin one.

    Raises:
        OSError: if the file cannot be read or made.
        ValueError: if it is no journal, or one of its entries is damaged.
    """
    path = path.absolute()  # Optuna's lock is a link to it
    if path.exists():
        check_journal(path)
    return JournalStorage(JournalFileBackend(str(path), JournalLock(path)))


def check_journal(path: Path) -> None:
    """Check every entry of a journal. The last one may be incomplete: its worker writes it, or died.

    Raises:
        OSError: if the file cannot be read.
        ValueError: if it is no journal, or one of its entries is damaged.
    """
    with path.open("rb") as lines:
        for number, line in enumerate(lines, 1):
            if _is_entry(line) or (not line.endswith(b"\n") and _is_torn_entry(line)):
                continue
            if number == 1:
                raise ValueError("it is no journal of a study, give another name")
            remedy = f"keep the lines before it by `head -n {number - 1} {path.name} > repaired.log`"
            raise ValueError(f"line {number} is damaged, {remedy}")


def mend_journal(path: Path) -> None:
    """Cut off what a worker that died in mid-write left at the end of a journal.

    Raises:
        OSError: if the file cannot be written.
        ValueError: if it ends in something else than an entry.
    """
    lock = JournalLock(path.absolute())
    lock.acquire()
    lock.release()


class JournalLock(BaseJournalFileLock):
    """Lock a journal for writing, and cut off what a worker that died in mid-write left at its end.

    It takes a lock of the kernel's, which a dead process does not keep, and then Optuna's, which other programs know.
    That is a link to the journal, which stays behind if its process is killed. Ours say ``folder/./x.log``, which tells
    them from others: who has the kernel's lock and finds one of ours knows that its process is dead.

    Args:
        path: the journal, absolute.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._target = f"{path.parent}/./{path.name}"
        self._optunas = JournalFileSymlinkLock(self._target, grace_period=GRACE)
        self._held = ExitStack()

    def acquire(self) -> bool:
        """Wait for both locks.

        Raises:
            ValueError: if the journal ends in something else than an entry.
        """
        with ExitStack() as held:
            file = held.enter_context(self._path.open("rb+"))
            with suppress(OSError, ImportError):  # a file system without the kernel's locks, or Windows
                import fcntl

                fcntl.flock(file, fcntl.LOCK_EX)
                self._remove_link_of_the_dead()
            self._optunas.acquire()
            held.callback(self._optunas.release)
            cut_torn_entry(file)
            self._held = held.pop_all()
        return True

    def _remove_link_of_the_dead(self) -> None:
        link = f"{self._target}.lock"
        if os.path.islink(link) and os.readlink(link) == self._target:
            os.unlink(link)

    def release(self) -> None:
        """Release both locks."""
        self._held.close()


def cut_torn_entry(file: BinaryIO) -> None:
    """Cut off the last line of a journal if it has no end. Its worker died in writing it, so nobody has read it.

    Raises:
        ValueError: if that line is no part of an entry.
    """
    if file.seek(0, os.SEEK_END) == 0:
        return
    file.seek(-1, os.SEEK_END)
    if file.read() == b"\n":
        return
    file.seek(0)
    content = file.read()
    end = content.rfind(b"\n") + 1
    if not _is_torn_entry(content[end:]):
        raise ValueError(f"{file.name} ends in what is no entry of a journal: remove its last line")
    file.truncate(end)


def _is_entry(line: bytes) -> bool:
    try:
        code = json.loads(line)["op_code"]
        return line.endswith(b"\n") and type(code) is int and code in OPERATIONS
    except (ValueError, TypeError, KeyError):
        return False


def _is_torn_entry(line: bytes) -> bool:
    """Tell whether a line is the start of an entry. After a power cut, zeros may stand where the rest was to be."""
    written = line.rstrip(b"\0")
    return written.startswith(START) or START.startswith(written)

"""Where a study is kept: a journal file on one machine, PostgreSQL beyond it."""

from __future__ import annotations

from pathlib import Path

from optuna.storages import JournalStorage
from sqlalchemy import make_url
from sqlalchemy.exc import ArgumentError

from sb3_bruno.zoo.database import Database
from sb3_bruno.zoo.journal import check_journal, mend_journal, open_journal
from sb3_bruno.zoo.one_line import in_one_line


def open_storage(storage: str, heartbeat: int = 60) -> JournalStorage | Database:
    """Open a journal file (``.log``) or a database; begin a journal if there is none.

    Args:
        storage: the file, or the address of a PostgreSQL database. SQLite is refused: two workers break it.
        heartbeat: seconds between the heartbeats of a database's workers. After twice as many without one, a trial is
            failed and queued again.

    Raises:
        ValueError: if it is neither, or cannot be opened.
    """
    try:
        if is_journal(storage):
            Path(storage).parent.mkdir(parents=True, exist_ok=True)
            return open_journal(Path(storage))
        if storage.startswith("postgresql"):
            return Database(storage, heartbeat)
    except Exception as error:  # a damaged journal or another program's database may raise anything
        raise ValueError(f"--storage {without_password(storage)} cannot be opened: {in_one_line(error)}") from error
    given = without_password(storage)
    raise ValueError(f"--storage {given}: give a journal file (sweep.log) or a database (postgresql://...)")


def check_storage(storage: str) -> None:
    """Check a storage that RL Zoo opens by itself, which takes any database. Mend it if it is a journal.

    Raises:
        ValueError: if it is neither a journal nor a database's address, or damaged.
    """
    if not is_journal(storage) and "://" not in storage:
        raise ValueError(f"--storage {storage}: give a journal file (search.log) or a database (postgresql://...)")
    if is_journal(storage) and not is_missing(storage):
        try:
            check_journal(Path(storage))
            mend_journal(Path(storage))
        except (OSError, ValueError) as error:
            raise ValueError(f"--storage {storage} cannot be opened: {in_one_line(error)}") from error


def is_journal(storage: str) -> bool:
    """Tell whether a storage is a journal file rather than a database."""
    return storage.endswith(".log") and "://" not in storage


def is_missing(storage: str) -> bool:
    """Tell whether a storage is a journal file that nobody has made yet."""
    try:
        return is_journal(storage) and not Path(storage).stat()
    except FileNotFoundError:
        return True
    except OSError:  # open_storage tells what is wrong with it
        return False


def without_password(storage: str) -> str:
    """Return a storage as it may be shown: a database's address with its password as ``***``."""
    try:
        return make_url(storage).render_as_string() if "://" in storage and "@" in storage else storage
    except (ArgumentError, ValueError):  # no address
        return storage.partition("://")[0] + "://..."

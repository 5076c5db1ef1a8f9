"""A run's folder: one process at a time trains in it, and a mark says that the run has not come to its end."""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import warnings
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from sb3_bruno.files.whole import whole_file

AGENT_FILE, SB3_FILE = ".agent", ".zip"
"""The ends of the names of an agent's files: the safe one, and that of Stable-Baselines3, which is a pickle."""
UNFINISHED = "unfinished.txt"
_LOCK = ".lock"  # stays there: only whoever holds it trains, and the system lets go of it when a process dies


class RunFolder:
    """The folder of a run, held by this process until ``release``.

    Args:
        path: an existing folder.

    Raises:
        ValueError: if another process holds it, with that process.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._made: list[Path] = []  # the folder and the parents made for it, innermost first
        self._lock = _locked(path)

    @classmethod
    def make(cls, path: Path) -> RunFolder:
        """Make the folder and hold it.

        Raises:
            FileExistsError: if there is one of this name, perhaps since a moment ago.
        """
        made = [path, *(parent for parent in path.parents if not parent.exists())]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir()
        folder = cls(path)
        folder._made = made
        return folder

    def begin(self) -> None:
        """Mark the run as unfinished, until ``finish``."""
        with whole_file(self.path / UNFINISHED) as part:
            part.write_text("This run has not come to its end: `sb3-bruno train --resume` goes on with it.\n")

    def finish(self) -> None:
        """Take the mark away."""
        (self.path / UNFINISHED).unlink(missing_ok=True)

    def discard(self) -> None:
        """Remove the folder, if this process made it, and the empty parents made for it; let go of it in any case."""
        if self._made:
            shutil.rmtree(self.path, ignore_errors=True)
        self.release()
        with suppress(OSError):  # at the first that others have put something into
            for parent in self._made[1:]:
                parent.rmdir()

    def release(self) -> None:
        """Let other processes train in the folder."""
        if self._lock is not None:
            self._lock.release()


def has_agent(run: Path, env: str) -> bool:
    """Tell whether a run's folder holds an agent, in whichever of its files."""
    return any((run / f"{env}{end}").is_file() for end in (AGENT_FILE, SB3_FILE))


def resuming_command(run: Path) -> str:
    """Write the command that goes on with a run, quoted for a shell."""
    return shlex.join(["sb3-bruno", "train", "--resume", str(run)])


def is_unfinished(run: Path) -> bool:
    """Tell whether a run was interrupted, or is still going on. Runs of older versions have no mark."""
    return (run / UNFINISHED).exists()


def latest_finished(runs: Path, env: str) -> int:
    """Return the number of the latest finished run of an environment, and warn of later ones; 0 if there is no run.

    Args:
        runs: the folder of an algorithm, whose runs are named like ``PointDir-v0_1``.
        env: the environment's name, as the folders are named.

    Raises:
        ValueError: if all runs are unfinished.
    """
    with_agent = (path for path in runs.glob("*") if has_agent(path, env))
    numbers = [path.name.removeprefix(f"{env}_") for path in with_agent]
    passed_over = None
    for number in sorted((int(number) for number in numbers if number.isdecimal()), reverse=True):
        run = runs / f"{env}_{number}"
        if not is_unfinished(run):
            if passed_over is not None:
                warnings.warn(f"{passed_over}. Taken instead: {run}.", stacklevel=3)
            return number
        passed_over = passed_over or (
            f"{run} is unfinished: go on with it by `{resuming_command(run)}`, or take it as it is by "
            f"`--exp-id {number}`"
        )
    if passed_over is not None:
        raise ValueError(passed_over)
    return 0


def _locked(path: Path) -> FileLock | None:
    """Lock a folder; return None, with a warning, where the file system has no locks."""
    lock = FileLock(path / _LOCK)
    try:
        lock.acquire(blocking=False)
    except Timeout as error:
        holder = "another process"
        with suppress(OSError):
            holder = (path / _LOCK).read_text(encoding="utf-8") or holder
        raise ValueError(f"{path} is in use: {holder} trains there. Wait until it ends, or stop it.") from error
    except OSError as error:
        warnings.warn(f"{path} cannot be locked ({error}): let no other process train there.", stacklevel=4)
        return None
    with suppress(OSError):  # Windows lets nobody write to a locked file
        (path / _LOCK).write_text(
            f"process {os.getpid()} on {platform.node()}, since {datetime.now():%Y-%m-%d %H:%M}", encoding="utf-8"
        )
    return lock

"""Tells whether a process of this machine is still there, though its number may have been given to another."""

from __future__ import annotations

import os
import platform
from pathlib import Path
from typing import Any

import psutil

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")  # Linux alone has it


def this_process() -> dict[str, Any]:
    """Identify this process among all others, later ones with the same number included."""
    return {"host": platform.node(), "pid": os.getpid(), "started": started(os.getpid())}


def is_gone(process: dict[str, Any]) -> bool:
    """Tell whether a process of this machine has ended. Those of other machines count as alive."""
    return bool(process["host"] == platform.node() and process["started"] != started(process["pid"]))


def started(pid: int) -> str | None:
    """Return when a process started, None if it has ended.

    Linux counts clock ticks since the machine was booted, which no step of the clock changes. Elsewhere the start is
    told by the time of day, which a step changes, so all processes have the same: a later one with the number of a
    worker that ended is taken for the worker, and its trial is not queued again.
    """
    if BOOT_ID.is_file():
        return _started_on_linux(pid)
    try:
        return None if psutil.Process(pid).status() == psutil.STATUS_ZOMBIE else "at some time"
    except psutil.NoSuchProcess:
        return None


def _started_on_linux(pid: int) -> str | None:
    """Read ``/proc``: "boot ticks". See man proc_pid_stat; the name before the fields read here may hold anything."""
    try:
        state, *fields = Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    return None if state in "ZX" else f"{BOOT_ID.read_text().strip()} {fields[18]}"

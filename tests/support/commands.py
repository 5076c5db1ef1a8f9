"""The command line in processes of its own, which fork from one that has imported it."""

import os
from multiprocessing import get_context

from sb3_bruno.cli.main import main


def start(*arguments, prepare=None):
    """Start ``sb3-bruno`` with these arguments in the current folder, after ``prepare`` has changed what it likes.

    Returns:
        The process. ``prepare`` is a function of a module, for it is sent there by its name.
    """
    process = get_context("forkserver").Process(target=_run, args=(os.getcwd(), list(map(str, arguments)), prepare))
    process.start()
    return process


def ended(process):
    """Wait for a process; return its exit code."""
    process.join()
    return process.exitcode


def _run(folder, arguments, prepare):
    os.chdir(folder)
    if prepare is not None:
        prepare()
    main(arguments)

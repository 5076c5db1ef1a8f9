"""The parser of a command, described by the command's own docstring, and a type of its arguments."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any


def command_parser(name: str, command: Callable[[list[str]], None], **kwargs: Any) -> argparse.ArgumentParser:
    """A parser for ``sb3-bruno NAME``.

    :param name: the command's name
    :param command: its docstring is the description, lines and all
    :param kwargs: further arguments of ``argparse.ArgumentParser``
    """
    about = "\n".join(line.strip() for line in (command.__doc__ or "").splitlines())
    formatter = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(f"sb3-bruno {name}", description=about, formatter_class=formatter, **kwargs)


def at_least_one(text: str) -> int:
    """The type of arguments that count something.

    :raises argparse.ArgumentTypeError: if it is not a whole number of 1 or more
    """
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 1 or more")
    return int(text)

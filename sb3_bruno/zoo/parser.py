"""The parser of a command, described by the command's own docstring."""

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

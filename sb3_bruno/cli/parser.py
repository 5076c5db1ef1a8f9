"""Parsers: described by their command's docstring, with the flags that several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import rl_zoo3
from huggingface_sb3 import EnvironmentName


def command_parser(name: str, command: Callable[[list[str]], None], **kwargs: Any) -> argparse.ArgumentParser:
    """Make a parser for ``sb3-bruno NAME``.

    Args:
        name: the command's name.
        command: its docstring becomes the description, with its line breaks.
        kwargs: further arguments of ``argparse.ArgumentParser``.
    """
    about = "\n".join(line.strip() for line in (command.__doc__ or "").splitlines())
    formatter = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(f"sb3-bruno {name}", description=about, formatter_class=formatter, **kwargs)


def at_least_one(text: str) -> int:
    """Convert an argument that counts something.

    Raises:
        argparse.ArgumentTypeError: if it is not a whole number of 1 or more.
    """
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 1 or more")
    return int(text)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the flags that choose an agent and its test."""
    parser.add_argument("--algo", default="bruno_sac", choices=sorted(rl_zoo3.ALGOS), help="(default: bruno_sac)")
    parser.add_argument("--env", type=EnvironmentName, default="CheetahDir-v0", help="(default: CheetahDir-v0)")
    parser.add_argument("-f", "--folder", default="logs", help="log folder (default: logs)")
    parser.add_argument("--exp-id", type=int, default=0, help="run number, 0: the latest finished (default)")
    parser.add_argument("--load-best", action="store_true", help="the best model instead of the last")
    parser.add_argument("--episodes", type=at_least_one, default=10, help="per task (default: 10)")
    parser.add_argument("--steps", type=at_least_one, help="of each episode (default: the environment's own)")
    parser.add_argument("--split", choices=["train", "test"], default="test", help="which tasks (default: test)")
    parser.add_argument("--seed", type=int, default=0, help="of the environments (default: 0)")


def add_gym_packages(parser: argparse.ArgumentParser) -> None:
    """Add ``--gym-packages``, as rl_zoo3's ``train`` has it."""
    parser.add_argument("--gym-packages", nargs="+", default=[], help="packages to import, which register environments")

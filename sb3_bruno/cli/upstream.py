"""Calls rl_zoo3's commands: they get our flags' rest, our parser and a one-line error."""

from __future__ import annotations

import argparse
import runpy
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from types import ModuleType
from typing import Any, NamedTuple

from sb3_bruno.cli.mistake import told_as_mistake
from sb3_bruno.cli.parser import Parser, UpstreamParser, add_gym_packages, command_parser

DEFAULTS = {"--algo": "bruno_sac", "--env": "CheetahDir-v0"}
Arguments = list[str]


class Chosen(NamedTuple):
    """What an rl_zoo3 command is called with.

    Attributes:
        env: id of the environment, without its package.
        packages: those to import, which register environments.
        rest: all other flags.
    """

    env: str
    packages: list[str]
    rest: Arguments

    @property
    def command(self) -> Arguments:
        """All flags, of which a repeated one counts where it is last."""
        return [*self.rest, "--env", self.env, *(["--gym-packages", *self.packages] if self.packages else [])]


def own_parser(name: str, command: Callable[[Arguments], None]) -> Parser:
    """Make a parser of our flags alone; ``--help`` is left to ``exit_with_help``."""
    return command_parser(name, command, add_help=False, allow_abbrev=False)


def choose_env(arguments: Sequence[str], defaults: dict[str, str]) -> Chosen:
    """Take the environment and its packages out of the flags: ``my_envs:Mine-v0`` is ``Mine-v0`` of ``my_envs``.

    Args:
        arguments: rl_zoo3's flags.
        defaults: flags that come first: if one is given twice, the last one counts.
    """
    parser = Parser("sb3-bruno", add_help=False, allow_abbrev=False)
    parser.add_argument("--env", default=DEFAULTS["--env"])
    add_gym_packages(parser)
    chosen, rest = parser.parse_known_args([*(part for flag in defaults.items() for part in flag), *arguments])
    package, _, env = chosen.env.rpartition(":")
    return Chosen(env, list(dict.fromkeys([*chosen.gym_packages, *([package] if package else [])])), rest)


def call(
    upstream: Callable[[], None],
    name: str,
    arguments: Arguments,
    has_started: Callable[[], bool] = lambda: False,
    ours: Sequence[str] = (),
) -> None:
    """Call a function of rl_zoo3 that reads ``sys.argv``, and let it read what a run saved as data.

    Args:
        upstream: the function.
        name: our command's name.
        arguments: the flags of rl_zoo3.
        has_started: whether the work has started.
        ours: the flags of our command, which a misspelt one may be meant for.

    Raises:
        Mistake: if it raises before the work has started; later errors stay as they are.
    """
    import yaml

    from sb3_bruno.zoo.saved_yaml import SavedLoader

    with (
        told_as_mistake(Exception, has_started),
        replaced(vars(yaml), "UnsafeLoader", SavedLoader),
        replaced(vars(sys.modules[upstream.__module__]), "argparse", _argparse(ours)),
        replaced(vars(sys), "argv", [f"sb3-bruno {name}", *arguments]),
    ):
        upstream()


def run_script(module: str) -> None:
    """Run a script of rl_zoo3, with our parser."""
    with replaced(sys.modules, "argparse", _argparse()):
        runpy.run_module(module, run_name="__main__")


@contextmanager
def replaced(names: dict[str, Any], name: str, value: Any) -> Iterator[None]:
    """Put ``value`` in the place of ``names[name]`` for the block. ``vars(module)`` are a module's names."""
    before = names.get(name)
    names[name] = value
    try:
        yield
    finally:
        names[name] = before


def _argparse(ours: Sequence[str] = ()) -> ModuleType:
    """Copy the module argparse, with our parser in the place of its own."""
    module = ModuleType("argparse")
    vars(module).update(vars(argparse), ArgumentParser=partial(UpstreamParser, ours=ours))
    return module

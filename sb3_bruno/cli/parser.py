"""Parsers: described by their command's docstring, with the flags that several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from typing import Any, NoReturn

from sb3_bruno.cli.params import StoreParams
from sb3_bruno.cli.values import (
    LARGEST_SEED,
    agent_file,
    at_least_one,
    device,
    seed,
    tensorboard_folder,
    whole_number,
    writable_folder,
)


class Parser(argparse.ArgumentParser):
    """Tells a mistake in one line, without the usage above it, and the nearest flag for an unknown one."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.flags: list[str] = []
        super().__init__(*args, **kwargs)

    def add_argument(self, *names: Any, **kwargs: Any) -> argparse.Action:
        """Add a flag as argparse does."""
        self.flags += names
        return super().add_argument(*names, **kwargs)

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse as argparse does, and refuse what is left."""
        found, unknown = self.parse_known_args(args, namespace)
        self.refuse(unknown)
        return found

    def refuse(self, unknown: list[str]) -> None:
        """Exit with the nearest flag of the first word, if there is one."""
        if unknown:
            nearest = get_close_matches(unknown[0].partition("=")[0], self.flags, n=1)
            self.error(f"{unknown[0]} is unknown: " + (f"did you mean {nearest[0]}?" if nearest else "leave it out"))

    def error(self, message: str) -> NoReturn:
        """Print the message and exit with status 2."""
        self.exit(2, f"{self.prog}: {message}\n")


class UpstreamParser(Parser):
    """Stands in for argparse's while rl_zoo3 builds its parser, and converts the values of its flags as ours.

    Args:
        ours: the flags that our command has besides rl_zoo3's, for the nearest of a misspelt one.
    """

    def __init__(self, *args: Any, ours: Sequence[str] = (), **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.flags += ours

    def add_argument(self, *names: Any, **kwargs: Any) -> argparse.Action:
        """Add a flag of rl_zoo3, with our converter where there is one."""
        for name in names:
            if name in CONVERTERS:
                kwargs["type"] = CONVERTERS[name]
            if name in ("-params", "--env-kwargs", "--eval-env-kwargs"):
                kwargs["action"] = StoreParams
        return super().add_argument(*names, **kwargs)


CONVERTERS: dict[str, Callable[[str], Any]] = {
    **dict.fromkeys(("--eval-episodes", "--n-eval-envs", "--n-trials", "--max-total-trials"), at_least_one),
    **dict.fromkeys(("--n-timesteps", "--n-evaluations", "--n-envs", "--load-checkpoint"), at_least_one),
    **dict.fromkeys(("--num-threads", "--n-jobs"), whole_number(1, also=(-1,))),
    **dict.fromkeys(("--eval-freq", "--save-freq"), whole_number()),
    **dict.fromkeys(("--n-startup-trials", "--trial-id", "--verbose"), whole_number(0)),
    "--log-interval": whole_number(1, also=(-1, -2)),
    "--exp-id": whole_number(0, also=(-1,)),
    "--seed": whole_number(0, LARGEST_SEED, also=(-1,)),
    "--device": device,
    "--log-folder": lambda text: str(writable_folder(text)),
    "--output-folder": lambda text: str(writable_folder(text)),
    "--trained-agent": agent_file,
    "--tensorboard-log": tensorboard_folder,
}
"""What the values of rl_zoo3's flags are converted by, where its own converter takes too much or too little."""


def command_parser(name: str, command: Callable[[list[str]], None], **kwargs: Any) -> Parser:
    """Make a parser for ``sb3-bruno NAME``.

    Args:
        name: the command's name.
        command: its docstring becomes the description, with its line breaks.
        kwargs: further arguments of ``argparse.ArgumentParser``.
    """
    about = "\n".join(line.strip() for line in (command.__doc__ or "").splitlines())
    formatter = argparse.RawDescriptionHelpFormatter
    return Parser(f"sb3-bruno {name}", description=about, formatter_class=formatter, **kwargs)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the flags that choose an agent and its test."""
    add_agent(parser)
    parser.add_argument("--episodes", type=at_least_one, default=10, help="per task (default: 10)")
    parser.add_argument("--steps", type=at_least_one, help="of each episode (default: the environment's own)")
    parser.add_argument("--split", choices=["train", "test"], default="test", help="which tasks (default: test)")
    parser.add_argument("--tasks", metavar="NAME", help="a set of tasks that the family names, such as beyond")
    parser.add_argument("--seed", type=seed, default=0, help="of the environments (default: 0)")


def add_agent(parser: argparse.ArgumentParser) -> None:
    """Add the flags that choose an agent."""
    add_run(parser, folder="logs")
    add_gym_packages(parser)
    parser.add_argument("--load-best", action="store_true", help="the best model instead of the last")
    add_trust(parser)


def add_run(parser: argparse.ArgumentParser, folder: str) -> None:
    """Add the flags that choose a run.

    Args:
        parser: the parser.
        folder: the default of the folder that runs are in.
    """
    parser.add_argument("--algo", default="bruno_sac", help="(default: bruno_sac)")
    parser.add_argument("--env", default="CheetahDir-v0", help="(default: CheetahDir-v0)")
    parser.add_argument("-f", "--folder", default=folder, help=f"folder of the runs (default: {folder})")
    parser.add_argument(
        "--exp-id", type=whole_number(0, also=(-1,)), default=0, help="run number, 0: the latest (default)"
    )


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Add ``--trust``, without which nothing is run that somebody else may have written."""
    parser.add_argument(
        "--trust", action="store_true", help="load pickles from any folder: they may run code of whoever made them"
    )


def add_gym_packages(parser: argparse.ArgumentParser) -> None:
    """Add ``--gym-packages``, as rl_zoo3's ``train`` has it. A run remembers what it was trained with."""
    parser.add_argument(
        "--gym-packages", nargs="+", default=[], help="packages to import, which register environments or hold wrappers"
    )

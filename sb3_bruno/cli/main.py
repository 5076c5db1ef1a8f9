"""The command line: rl_zoo3's flags and folders with our algorithms, environments, configs and commands.

No module here imports torch before a command has parsed its flags, for that takes seconds: ``--help`` answers at once.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from difflib import get_close_matches

import sb3_bruno
from sb3_bruno.cli.evaluate import diagnose, evaluate, plot
from sb3_bruno.cli.export import export
from sb3_bruno.cli.live import live
from sb3_bruno.cli.mistake import Mistake
from sb3_bruno.cli.report import report
from sb3_bruno.cli.share import pack, pull, push
from sb3_bruno.cli.sweep import sweep
from sb3_bruno.cli.train import train
from sb3_bruno.cli.watch import enjoy, record_video

INTERRUPTED = 130  # the exit code that shells give a command that Ctrl-C ended
Arguments = list[str]
COMMANDS: dict[str, Callable[[Arguments], None]] = {
    "train": train,
    "enjoy": enjoy,
    "record-video": record_video,
    "live": live,
    "sweep": sweep,
    "evaluate": evaluate,
    "diagnose": diagnose,
    "plot": plot,
    "report": report,
    "export": export,
    "pack": pack,
    "push": push,
    "pull": pull,
}
USAGE = "usage: sb3-bruno COMMAND ...\n\ncommands (each with its own --help):\n" + "\n".join(
    f"  {name:<14}{(command.__doc__ or '').splitlines()[0]}" for name, command in COMMANDS.items()
)


def main(arguments: Arguments | None = None) -> None:
    """Run the command that the first argument names."""
    arguments = sys.argv[1:] if arguments is None else arguments
    name, rest = (arguments[0], arguments[1:]) if arguments else ("--help", [])
    if name in ("-h", "--help"):
        print(USAGE)
        sys.exit(0)
    if name == "--version":
        print(f"sb3-bruno {sb3_bruno.__version__}")
        sys.exit(0)
    if name not in COMMANDS:
        nearest = get_close_matches(name, COMMANDS, n=1)
        remedy = f"did you mean {nearest[0]}?" if nearest else f"there are {', '.join(COMMANDS)}"
        sys.exit(f"sb3-bruno: unknown command {name!r}: {remedy}")
    try:
        COMMANDS[name](rest)
    except Mistake as mistake:
        sys.exit(f"sb3-bruno {name}: {mistake}")
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)

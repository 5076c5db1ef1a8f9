"""``sb3-bruno sweep init | run | status | best | export``: reads the flags, and hands them to ``sweep_commands.py``."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from sb3_bruno.cli.mistake import Mistake, check_installed
from sb3_bruno.cli.params import StoreParams
from sb3_bruno.cli.parser import Parser, add_gym_packages, command_parser
from sb3_bruno.cli.values import at_least_one, whole_number

COMMANDS = {
    "init": "Create the study: once, before the workers start.",
    "run": "Work on the study until it has --max-total-trials, or for --n-trials. Start any number of workers.",
    "status": "Count the trials by state; show who works on which, and the best so far.",
    "best": "Write the best hyperparameters as a config that sb3-bruno train takes as it is.",
    "export": "Write every trial as CSV: its state, return, duration and drawn values.",
}
"""What each command does. Functions of these names in ``sweep_commands.py`` do it."""
ELSEWHERE = {  # flags of other searches, and what a sweep has in their place
    "--n-jobs": "each `sweep run` is one worker, and you may start as many as you like",
    "--sampler": "a sweep draws by TPE, after --n-startup-trials of sweep init at random",
    "--pruner": "a sweep prunes below the median, after --n-startup-trials of sweep init",
}
LARGEST_SEED = 2**31 - 1  # numpy takes twice that, and each trial adds its number


def sweep(arguments: list[str]) -> None:
    """Search hyperparameters with Optuna, by any number of workers on one machine or many.

    example: sb3-bruno sweep init --storage sweep.log --study-name point --env PointDir-v0 -n 6000
             sb3-bruno sweep run --storage sweep.log --study-name point --max-total-trials 40   # as often as you like
             sb3-bruno sweep status --storage sweep.log --study-name point
             sb3-bruno sweep best --storage sweep.log --study-name point --out best.yml
             sb3-bruno train --env PointDir-v0 -conf best.yml
    """
    for flag, value in pairwise([*arguments, ""]):
        name = flag.partition("=")[0]
        if name in ELSEWHERE:
            raise Mistake(f"{flag if '=' in flag else f'{flag} {value}'.strip()}: {ELSEWHERE[name]}, so leave it out")
    options, unknown = _parser().parse_known_args(arguments)
    options.parser.refuse(unknown)
    check_installed("optuna", "rl_zoo3", "sqlalchemy")

    import sb3_bruno.cli.sweep_commands as commands
    from sb3_bruno.zoo.registry import register

    register()
    getattr(commands, options.command)(options)


def _parser() -> Parser:
    parser = command_parser("sweep", sweep)
    subparsers = parser.add_subparsers(required=True, metavar=" | ".join(COMMANDS))
    parsers: dict[str, Parser] = {}
    for name, about in COMMANDS.items():
        parsers[name] = subparsers.add_parser(name, help=about, description=about)
        parsers[name].set_defaults(command=name, parser=parsers[name])
        parsers[name].add_argument("--storage", required=True, help="a journal file (sweep.log) or postgresql://...")
        parsers[name].add_argument("--study-name", required=True)
    _add_settings(parsers["init"])
    parsers["run"].add_argument("--n-trials", type=at_least_one, help="trials of this worker (default: without end)")
    parsers["run"].add_argument("--max-total-trials", type=at_least_one, help="trials of all workers together")
    for name, out in (("best", "best.yml"), ("export", "trials.csv")):
        parsers[name].add_argument("--out", type=Path, default=Path(out), help=f"(default: {out})")
    return parser


def _add_settings(parser: Parser) -> None:
    """Add the flags of ``init``, which say what every trial is made of."""
    parser.add_argument("--algo", default="bruno_sac", help="(default: bruno_sac)")
    parser.add_argument("--env", default="CheetahDir-v0", help="(default: CheetahDir-v0)")
    add_gym_packages(parser)
    parser.add_argument("-conf", "--conf-file", dest="conf", help="what is not drawn (default: ours)")
    parser.add_argument("-n", "--n-timesteps", type=at_least_one, required=True, help="env steps of a trial")
    parser.add_argument("--n-evaluations", type=at_least_one, default=5, help="of a trial, for pruning (default: 5)")
    parser.add_argument("--n-startup-trials", type=at_least_one, default=10, help="drawn at random first (default: 10)")
    parser.add_argument(
        "--seed",
        type=whole_number(0, LARGEST_SEED),
        default=0,
        help="of the first trial; each has its own (default: 0)",
    )
    parser.add_argument("-params", "--hyperparams", nargs="+", action=StoreParams, help="as in train")

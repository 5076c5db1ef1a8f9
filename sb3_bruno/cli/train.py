"""``sb3-bruno train``: rl_zoo3's training, with our algorithms, environments and configs, and exact resume."""

from __future__ import annotations

import importlib.util
import threading
from functools import partial
from pathlib import Path

from sb3_bruno.cli.mistake import Mistake, told_as_mistake
from sb3_bruno.cli.parser import Parser, add_trust
from sb3_bruno.cli.upstream import DEFAULTS, Arguments, call, choose_env, own_parser, replaced
from sb3_bruno.cli.upstream_help import exit_with_help
from sb3_bruno.cli.values import agent_file, whole_number

CHECKPOINT_FREQ = 25_000  # env steps


def train(arguments: Arguments) -> None:
    """Train an agent as rl_zoo3 does, or go on with a run exactly from its last checkpoint.

    One torch thread unless --num-threads says otherwise. -conf takes a file, or a folder of ours such as oracle.
    Ten tables of the log are printed, or as many as --log-interval says.

    example: sb3-bruno train --algo bruno_sac --env CheetahDir-v0 --seed 1 -P
             sb3-bruno train --resume logs/bruno_sac/CheetahDir-v0_1
    """
    parser = own_parser("train", train)
    parser.add_argument("--resume", type=Path, metavar="DIR", help="go on with the run in DIR; other flags are its own")
    parser.add_argument(
        "--checkpoint-freq",
        type=whole_number(0),
        metavar="N",
        help=f"env steps between checkpoints, 0: none (default: {CHECKPOINT_FREQ})",
    )
    add_trust(parser)
    own, rest = parser.parse_known_args(arguments)
    exit_with_help(parser, rest, "train")

    import rl_zoo3.train

    from sb3_bruno.files.whole import NotWritten
    from sb3_bruno.runs.denormals import flushed_denormals
    from sb3_bruno.zoo.experiment import TaskExperiment
    from sb3_bruno.zoo.kept_run import RunOptions
    from sb3_bruno.zoo.registry import check_registered, import_packages, register

    register()
    resume_from = own.resume
    if resume_from is not None:
        given = [*rest, *([] if own.checkpoint_freq is None else [f"--checkpoint-freq {own.checkpoint_freq}"])]
        if given:
            raise Mistake(f"--resume goes on with the run's own flags: leave out {' '.join(given)}")
        own, rest = parser.parse_known_args(_command_of(resume_from))
    for needed in ("wandb", "tensorboard") if "--track" in rest else ():
        if importlib.util.find_spec(needed) is None:
            raise Mistake(f"--track needs {needed}, which is not installed: pip install 'sb3_bruno[wandb]'")
    chosen = choose_env(rest, {**DEFAULTS, "--num-threads": "1"})
    with told_as_mistake():
        _check_trained_agent(chosen.rest, trust=own.trust or resume_from is not None)
        import_packages(chosen.packages)
        check_registered(chosen.env)
    has_started = threading.Event()  # until it is set, an error is a mistake in the command
    checkpoint_freq = CHECKPOINT_FREQ if own.checkpoint_freq is None else own.checkpoint_freq
    options = RunOptions(checkpoint_freq, resume_from, chosen.command, has_started.set)
    experiment = partial(TaskExperiment, options=options)
    ours = replaced(vars(rl_zoo3.train), "ExperimentManager", experiment)
    with flushed_denormals(), ours, told_as_mistake(NotWritten):
        call(rl_zoo3.train.train, "train", chosen.command, has_started.is_set, parser.flags)


def _check_trained_agent(rest: Arguments, *, trust: bool) -> None:
    """Refuse to train on an agent from a folder that is not trusted, for its zip is a pickle.

    Raises:
        ValueError: naming the file and the flag.
    """
    from sb3_bruno.zoo.trust import check_pickle

    parser = Parser("sb3-bruno train", add_help=False, allow_abbrev=False)
    parser.add_argument("-i", "--trained-agent", type=agent_file, default="")
    given, _ = parser.parse_known_args(rest)
    if given.trained_agent:
        check_pickle(Path(given.trained_agent), trust=trust)


def _command_of(folder: Path) -> Arguments:
    """Read the command that started the run in ``folder``, with its seed and checkpoint frequency.

    Raises:
        Mistake: if the folder has no checkpoint, or its origin cannot be read.
    """
    from sb3_bruno.runs.origin import ORIGIN, load_command
    from sb3_bruno.zoo.kept_run import CHECKPOINT

    missing = [name for name in (CHECKPOINT, ORIGIN) if not (folder / name).is_file()]
    if missing:
        raise Mistake(f"--resume {folder}: no {missing[0]} there, so there is nothing to go on from: train anew")
    with told_as_mistake():
        return load_command(folder)

"""The command line: rl_zoo3's flags and folders with our algorithms, environments, configs and commands."""

from __future__ import annotations

import argparse
import importlib.util
import runpy
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import rl_zoo3.enjoy
import rl_zoo3.train
import rl_zoo3.utils
import yaml
from huggingface_sb3 import EnvironmentName
from stable_baselines3.common.vec_env import VecEnv

from sb3_bruno.cli.evaluate import diagnose, evaluate, plot
from sb3_bruno.cli.mistake import Mistake, told_as_mistake
from sb3_bruno.cli.parser import add_gym_packages, command_parser
from sb3_bruno.cli.report import report
from sb3_bruno.cli.sweep import sweep
from sb3_bruno.runs.denormals import flushed_denormals
from sb3_bruno.runs.folder import latest_finished
from sb3_bruno.runs.origin import ORIGIN, load_command
from sb3_bruno.zoo.experiment import TaskExperiment
from sb3_bruno.zoo.kept_run import CHECKPOINT, RunOptions
from sb3_bruno.zoo.registry import check_registered, import_packages, register
from sb3_bruno.zoo.saved_yaml import SavedLoader

DEFAULTS = {"--algo": "bruno_sac", "--env": "CheetahDir-v0"}
INTERRUPTED = 130  # the exit code that shells give a command that Ctrl-C ended
Arguments = list[str]


def main(arguments: Arguments | None = None) -> None:
    """Run the command that the first argument names."""
    arguments = sys.argv[1:] if arguments is None else arguments
    name, rest = (arguments[0], arguments[1:]) if arguments else ("--help", [])
    if name not in COMMANDS:
        print(USAGE, file=sys.stdout if name in ("-h", "--help") else sys.stderr)
        sys.exit(0 if name in ("-h", "--help") else f"sb3-bruno: unknown command {name!r}")
    register()
    try:
        COMMANDS[name](rest)
    except Mistake as mistake:
        sys.exit(f"sb3-bruno {name}: {mistake}")
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


def train(arguments: Arguments) -> None:
    """Train an agent as rl_zoo3 does, or go on with a run exactly from its last checkpoint.

    One torch thread unless --num-threads says otherwise. -conf takes a file, or a folder of ours such as oracle.

    example: sb3-bruno train --algo bruno_sac --env CheetahDir-v0 --seed 1 -P
             sb3-bruno train --resume logs/bruno_sac/CheetahDir-v0_1
    """
    parser = _own_parser("train", train)
    parser.add_argument("--resume", type=Path, metavar="DIR", help="go on with the run in DIR; other flags are its own")
    freq = RunOptions().checkpoint_freq
    parser.add_argument(
        "--checkpoint-freq", type=int, default=freq, metavar="N", help="env steps between checkpoints, 0: none"
    )
    own, rest = _parse(parser, arguments, rl_zoo3.train.train)
    resume_from = own.resume
    if resume_from is not None:
        if rest:
            raise Mistake(f"--resume goes on with the run's own flags: leave out {' '.join(rest)}")
        own, rest = parser.parse_known_args(_command_of(resume_from))
    for needed in ("wandb", "tensorboard") if "--track" in rest else ():
        if importlib.util.find_spec(needed) is None:
            raise Mistake(f"--track needs {needed}, which is not installed: pip install 'sb3_bruno[wandb]'")
    command = _with_defaults(rest, {**DEFAULTS, "--num-threads": "1"})
    _check_env(command)
    has_started = threading.Event()  # until it is set, an error is a mistake in the command
    options = RunOptions(own.checkpoint_freq, resume_from, command, has_started.set)
    experiment = partial(TaskExperiment, options=options)
    with flushed_denormals(), _replaced(rl_zoo3.train, "ExperimentManager", experiment):
        _call(rl_zoo3.train.train, "train", command, has_started.is_set)


def enjoy(arguments: Arguments) -> None:
    """Watch a trained agent, as rl_zoo3 does.

    example: sb3-bruno enjoy --algo bruno_sac --env CheetahDir-v0 -f logs -n 400
    """
    _, rest = _parse(_own_parser("enjoy", enjoy), arguments, rl_zoo3.enjoy.enjoy)
    command = _of_finished_run(_with_defaults(rest, {**DEFAULTS, "-f": "logs"}))
    _check_env(command)
    _call(rl_zoo3.enjoy.enjoy, "enjoy", command)


def record_video(arguments: Arguments) -> None:
    """Record a video of a trained agent, as rl_zoo3 does. On a machine without a display set MUJOCO_GL=egl.

    example: sb3-bruno record-video --algo bruno_sac --env CheetahDir-v0 -f logs -n 400
    """
    parser = _own_parser("record-video", record_video)
    add_gym_packages(parser)
    own, rest = _parse(parser, arguments, _rl_zoo3_record_video)
    command = _of_finished_run(_with_defaults(rest, {**DEFAULTS, "-f": "logs"}))
    _check_env(command, own.gym_packages)
    _call(_rl_zoo3_record_video, "record-video", command)


COMMANDS: dict[str, Callable[[Arguments], None]] = {
    "train": train,
    "enjoy": enjoy,
    "record-video": record_video,
    "sweep": sweep,
    "evaluate": evaluate,
    "diagnose": diagnose,
    "plot": plot,
    "report": report,
}
USAGE = "usage: sb3-bruno COMMAND ...\n\ncommands (each with its own --help):\n" + "\n".join(
    f"  {name:<14}{(command.__doc__ or '').splitlines()[0]}" for name, command in COMMANDS.items()
)


def _rl_zoo3_record_video() -> None:
    """Run rl_zoo3's script. It ignores the ``env_kwargs`` of the run's config: put them in."""
    make = rl_zoo3.utils.create_test_env

    def make_as_trained(env_id: str, hyperparams: dict[str, Any], env_kwargs: dict[str, Any], **kwargs: Any) -> VecEnv:
        env_kwargs = {**hyperparams.get("env_kwargs", {}), **env_kwargs}
        return make(env_id, hyperparams=hyperparams, env_kwargs=env_kwargs, **kwargs)

    with _replaced(rl_zoo3.utils, "create_test_env", make_as_trained):
        runpy.run_module("rl_zoo3.record_video", run_name="__main__")


@contextmanager
def _replaced(module: ModuleType, name: str, value: Any) -> Iterator[None]:
    """Put ``value`` in the place of ``module.name`` for the block."""
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


def _own_parser(name: str, command: Callable[[Arguments], None]) -> argparse.ArgumentParser:
    """Make a parser of our flags alone; ``--help`` is left to ``_parse``."""
    return command_parser(name, command, add_help=False, allow_abbrev=False)


def _parse(
    parser: argparse.ArgumentParser, arguments: Arguments, upstream: Callable[[], None]
) -> tuple[argparse.Namespace, Arguments]:
    """Parse our flags and return the rest, which are rl_zoo3's. ``--help`` shows both."""
    own, rest = parser.parse_known_args(arguments)
    if {"-h", "--help"} & set(rest):
        parser.print_help()
        print(f"\nand the flags of rl_zoo3 (with our defaults: {DEFAULTS}):\n")
        _call(upstream, parser.prog.split()[-1], ["--help"])
    return own, rest


def _with_defaults(arguments: Arguments, defaults: dict[str, str]) -> Arguments:
    """Put the defaults first: if a flag is given twice, the last one counts."""
    return [part for flag in defaults.items() for part in flag] + arguments


def _of_finished_run(command: Arguments) -> Arguments:
    """Choose the latest run that has come to its end, unless the command of enjoy or record-video chooses one.

    Raises:
        Mistake: if all runs are unfinished.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--algo")
    parser.add_argument("--env", type=EnvironmentName)
    parser.add_argument("-f", "--folder", type=Path)
    parser.add_argument("--exp-id", default="0")
    chosen, _ = parser.parse_known_args(command)
    if chosen.exp_id != "0":
        return command
    with told_as_mistake():
        return [*command, "--exp-id", str(latest_finished(chosen.folder / chosen.algo, chosen.env))]


def _check_env(command: Arguments, packages: Sequence[str] = ()) -> None:
    """Import the packages that register environments, and refuse an environment that is not registered then.

    Args:
        command: rl_zoo3's flags.
        packages: those to import, besides the command's own ``--gym-packages``.

    Raises:
        Mistake: if a package cannot be imported, or the environment is unknown.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--env")
    add_gym_packages(parser)
    chosen, _ = parser.parse_known_args(command)
    with told_as_mistake():
        import_packages([*packages, *chosen.gym_packages])
        check_registered(chosen.env)


def _call(
    upstream: Callable[[], None], name: str, arguments: Arguments, has_started: Callable[[], bool] = lambda: False
) -> None:
    """Call a function of rl_zoo3 that reads ``sys.argv``, and let it read what a run saved as data.

    Raises:
        Mistake: if it raises before the work has started; later errors stay as they are.
    """
    with (
        told_as_mistake(Exception, has_started),
        _replaced(sys, "argv", [f"sb3-bruno {name}", *arguments]),
        _replaced(yaml, "UnsafeLoader", SavedLoader),
    ):
        upstream()


def _command_of(folder: Path) -> Arguments:
    """Read the command that started the run in ``folder``, with its seed and checkpoint frequency.

    Raises:
        Mistake: if the folder has no checkpoint, or its origin cannot be read.
    """
    missing = [name for name in (CHECKPOINT, ORIGIN) if not (folder / name).is_file()]
    if missing:
        raise Mistake(f"--resume {folder}: no {missing[0]} there, so there is nothing to go on from: train anew")
    with told_as_mistake():
        return load_command(folder)

"""``sb3-bruno enjoy`` and ``record-video``: rl_zoo3's, of our agents in the environments they were trained in."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from sb3_bruno.cli.mistake import Mistake, told_as_mistake
from sb3_bruno.cli.parser import Parser, add_trust
from sb3_bruno.cli.upstream import (
    DEFAULTS,
    Arguments,
    Chosen,
    call,
    choose_env,
    own_parser,
    replaced,
    run_script,
)
from sb3_bruno.cli.upstream_help import exit_with_help
from sb3_bruno.cli.values import whole_number

if TYPE_CHECKING:
    from sb3_bruno.zoo.stored_agent import StoredAgent


class _Watched(NamedTuple):
    """Flags of rl_zoo3's that are read here too.

    Attributes:
        n_steps: how many are taken.
        load_best: whether the best model is watched.
        renders: whether it is shown.
        checkpoint: steps of the checkpoint that is watched; None for none.
        last_checkpoint: whether the last checkpoint is watched.
    """

    n_steps: int
    load_best: bool
    renders: bool
    checkpoint: str | None
    last_checkpoint: bool

    @classmethod
    def of(cls, command: str, chosen: Chosen) -> _Watched:
        parser = Parser(f"sb3-bruno {command}", add_help=False, allow_abbrev=False)
        parser.add_argument("-n", "--n-timesteps", type=whole_number(1), default=1000)
        parser.add_argument("--load-best", action="store_true")
        parser.add_argument("--no-render", action="store_true")
        parser.add_argument("--load-checkpoint")
        parser.add_argument("--load-last-checkpoint", action="store_true")
        flags, _ = parser.parse_known_args(chosen.rest)
        checkpoints = flags.load_checkpoint, flags.load_last_checkpoint
        return cls(flags.n_timesteps, flags.load_best, not flags.no_render, *checkpoints)


class _Run(NamedTuple):
    """A run as rl_zoo3's script will look for it.

    Attributes:
        algo: rl_zoo3's name of the algorithm.
        env: id of the environment.
        folder: the log folder.
        exp_id: its number.
        exists: whether there is one.
    """

    algo: str
    env: str
    folder: Path
    exp_id: int
    exists: bool


def enjoy(arguments: Arguments) -> None:
    """Watch a trained agent, as rl_zoo3 does. It tells what it takes the task for as it acts.

    example: sb3-bruno enjoy --algo bruno_sac --env CheetahDir-v0 -f logs -n 400
    """
    parser = own_parser("enjoy", enjoy)
    add_trust(parser)
    own, rest = parser.parse_known_args(arguments)
    exit_with_help(parser, rest, "enjoy")

    import rl_zoo3.enjoy

    from sb3_bruno.zoo.registry import register
    from sb3_bruno.zoo.telling import telling

    register()
    chosen, run = _as_trained("enjoy", choose_env(rest, {**DEFAULTS, "-f": "logs"}), trust=own.trust)
    watched = _Watched.of("enjoy", chosen)
    if run.exists and watched.renders and not _has_display():
        raise Mistake("there is no display here: give --no-render, or make a video by `sb3-bruno record-video`")
    names = vars(rl_zoo3.enjoy)
    algorithms = {name: telling(algorithm) for name, algorithm in names["ALGOS"].items()}
    with replaced(names, "ALGOS", algorithms), _kept_agent(names, run, watched, trust=own.trust):
        call(rl_zoo3.enjoy.enjoy, "enjoy", chosen.command)


def record_video(arguments: Arguments) -> None:
    """Record a video of a trained agent, as rl_zoo3 does. On a machine without a display set MUJOCO_GL=egl.

    example: sb3-bruno record-video --algo bruno_sac --env CheetahDir-v0 -f logs -n 400
    """
    parser = own_parser("record-video", record_video)
    add_trust(parser)
    own, rest = parser.parse_known_args(arguments)
    exit_with_help(parser, rest, "record_video")

    import rl_zoo3.utils

    from sb3_bruno.zoo.registry import register

    register()
    chosen, run = _as_trained("record-video", choose_env(rest, {**DEFAULTS, "-f": "logs"}), trust=own.trust)
    watched = _Watched.of("record-video", chosen)

    def record() -> None:
        _rl_zoo3_record_video(watched)

    with _kept_agent(vars(rl_zoo3.utils), run, watched, trust=own.trust):
        call(record, "record-video", [*chosen.rest, "--env", chosen.env])


def _as_trained(command: str, chosen: Chosen, *, trust: bool) -> tuple[Chosen, _Run]:
    """Choose the latest finished run unless one is chosen, and import the packages that it was trained with.

    Returns:
        What is chosen, and the run.

    Raises:
        Mistake: if all runs are unfinished, a package cannot be imported or is not trusted, or the environment is
            unknown.
    """
    from huggingface_sb3 import EnvironmentName

    from sb3_bruno.runs.folder import latest_finished
    from sb3_bruno.zoo.registry import check_registered, import_packages
    from sb3_bruno.zoo.trained import packages_of_run

    parser = Parser(f"sb3-bruno {command}", add_help=False, allow_abbrev=False)
    parser.add_argument("--algo")
    parser.add_argument("-f", "--folder")
    parser.add_argument("--exp-id", type=whole_number(0, also=(-1,)), default=0)
    run, _ = parser.parse_known_args(chosen.rest)
    with told_as_mistake():
        exp_id = run.exp_id or latest_finished(Path(run.folder) / run.algo, EnvironmentName(chosen.env))
        saved = packages_of_run(run.algo, chosen.env, run.folder, exp_id, chosen.packages, trust=trust)
        packages = list(dict.fromkeys([*chosen.packages, *(saved or [])]))
        import_packages(packages)
        check_registered(chosen.env)
    rest = [*chosen.rest, "--exp-id", str(exp_id)]
    found = _Run(run.algo, chosen.env, Path(run.folder), exp_id, saved is not None)
    return chosen._replace(packages=packages, rest=rest), found


def _has_display() -> bool:
    """Say whether a window can open. Without a display, the library that MuJoCo opens one with ends the process."""
    displays = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
    return sys.platform != "linux" or any(os.environ.get(name) for name in displays)


@contextmanager
def _kept_agent(names: dict[str, Any], run: _Run, watched: _Watched, *, trust: bool) -> Iterator[None]:
    """Have rl_zoo3's script take the agent file where there is one, with the statistics of VecNormalize in it.

    Args:
        names: those of the script.
        run: what it will look for.
        watched: its flags.
        trust: whether pickles are loaded from any folder.

    Raises:
        Mistake: if the agent is a pickle that is not trusted.
    """
    import rl_zoo3.utils
    from huggingface_sb3 import EnvironmentName

    from sb3_bruno.zoo.trust import check_pickle
    from sb3_bruno.zoo.watching import AgentFileLoader, path_of, with_statistics

    stored = _agent_file(run, watched)
    is_downloaded = "rl-trained-agents" in str(run.folder)  # by rl_zoo3, from others
    if stored is None and (run.exists or is_downloaded):
        with told_as_mistake():
            check_pickle(_zip_file(run, watched), trust=trust)
    make = with_statistics(rl_zoo3.utils.create_test_env, stored, load_best=watched.load_best)
    with ExitStack() as stack:
        stack.enter_context(replaced(names, "create_test_env", make))
        if stored is not None:
            found = path_of(stored, run.algo, EnvironmentName(run.env))
            stack.enter_context(replaced(names, "get_model_path", found))
            algorithms = names["ALGOS"]
            stack.enter_context(replaced(algorithms, run.algo, AgentFileLoader(algorithms[run.algo])))
        yield


def _agent_file(run: _Run, watched: _Watched) -> StoredAgent | None:
    """Find the agent file of a run; None if it has only a zip, or nothing, which rl_zoo3 tells."""
    from huggingface_sb3 import EnvironmentName

    from sb3_bruno.zoo.stored_agent import StoredAgent

    if not run.exists or watched.checkpoint is not None or watched.last_checkpoint:
        return None
    name = EnvironmentName(run.env)
    try:
        stored = StoredAgent.find(run.algo, name, run.folder, run.exp_id, load_best=watched.load_best)
    except (AssertionError, ValueError):
        return None
    return stored if stored.is_safe else None


def _zip_file(run: _Run, watched: _Watched) -> Path:
    """Find the zip that rl_zoo3 will load; where there is none, which it tells, the log folder."""
    from huggingface_sb3 import EnvironmentName
    from rl_zoo3.utils import get_model_path

    which = watched.load_best, watched.checkpoint, watched.last_checkpoint
    try:
        return Path(get_model_path(run.exp_id, str(run.folder), run.algo, EnvironmentName(run.env), *which)[1])
    except (AssertionError, ValueError):
        return run.folder


def _rl_zoo3_record_video(watched: _Watched) -> None:
    """Run rl_zoo3's script, with a progress bar. It ignores the ``env_kwargs`` of the run's config: put them in."""
    import rl_zoo3.utils

    from sb3_bruno.zoo.shown_steps import ShownSteps

    make = rl_zoo3.utils.create_test_env

    def make_as_trained(env_id: str, hyperparams: dict[str, Any], env_kwargs: dict[str, Any], **kwargs: Any) -> Any:
        env_kwargs = {**hyperparams.get("env_kwargs", {}), **env_kwargs}
        return ShownSteps(make(env_id, hyperparams=hyperparams, env_kwargs=env_kwargs, **kwargs), watched.n_steps)

    with replaced(vars(rl_zoo3.utils), "create_test_env", make_as_trained):
        run_script("rl_zoo3.record_video")

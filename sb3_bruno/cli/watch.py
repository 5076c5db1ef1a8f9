"""``sb3-bruno enjoy`` and ``record-video``: rl_zoo3's, of our agents in the environments they were trained in."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from sb3_bruno.cli.mistake import Mistake, told_as_mistake
from sb3_bruno.cli.parser import Parser
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


class _Watched(NamedTuple):
    """Flags of rl_zoo3's that are read here too.

    Attributes:
        n_steps: how many are taken.
        load_best: whether the best model is watched.
        renders: whether it is shown.
    """

    n_steps: int
    load_best: bool
    renders: bool

    @classmethod
    def of(cls, command: str, chosen: Chosen) -> _Watched:
        parser = Parser(f"sb3-bruno {command}", add_help=False, allow_abbrev=False)
        parser.add_argument("-n", "--n-timesteps", type=whole_number(1), default=1000)
        parser.add_argument("--load-best", action="store_true")
        parser.add_argument("--no-render", action="store_true")
        flags, _ = parser.parse_known_args(chosen.rest)
        return cls(flags.n_timesteps, flags.load_best, not flags.no_render)


def enjoy(arguments: Arguments) -> None:
    """Watch a trained agent, as rl_zoo3 does. It tells what it takes the task for as it acts.

    example: sb3-bruno enjoy --algo bruno_sac --env CheetahDir-v0 -f logs -n 400
    """
    exit_with_help(own_parser("enjoy", enjoy), arguments, "enjoy")

    import rl_zoo3.enjoy
    import rl_zoo3.utils

    from sb3_bruno.zoo.registry import register
    from sb3_bruno.zoo.telling import telling

    register()
    chosen, exists = _as_trained("enjoy", choose_env(arguments, {**DEFAULTS, "-f": "logs"}))
    watched = _Watched.of("enjoy", chosen)
    if exists and watched.renders and not _has_display():
        raise Mistake("there is no display here: give --no-render, or make a video by `sb3-bruno record-video`")
    make_env = _kept_env(rl_zoo3.utils.create_test_env, load_best=watched.load_best)
    names = vars(rl_zoo3.enjoy)
    algorithms = {name: telling(algorithm) for name, algorithm in names["ALGOS"].items()}
    with replaced(names, "create_test_env", make_env), replaced(names, "ALGOS", algorithms):
        call(rl_zoo3.enjoy.enjoy, "enjoy", chosen.command)


def record_video(arguments: Arguments) -> None:
    """Record a video of a trained agent, as rl_zoo3 does. On a machine without a display set MUJOCO_GL=egl.

    example: sb3-bruno record-video --algo bruno_sac --env CheetahDir-v0 -f logs -n 400
    """
    exit_with_help(own_parser("record-video", record_video), arguments, "record_video")

    from sb3_bruno.zoo.registry import register

    register()
    chosen, _ = _as_trained("record-video", choose_env(arguments, {**DEFAULTS, "-f": "logs"}))
    watched = _Watched.of("record-video", chosen)

    def record() -> None:
        _rl_zoo3_record_video(watched)

    call(record, "record-video", [*chosen.rest, "--env", chosen.env])


def _as_trained(command: str, chosen: Chosen) -> tuple[Chosen, bool]:
    """Choose the latest finished run unless one is chosen, and import the packages that it was trained with.

    Returns:
        What is chosen, and whether there is such a run.

    Raises:
        Mistake: if all runs are unfinished, a package cannot be imported, or the environment is unknown.
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
        saved = packages_of_run(run.algo, chosen.env, run.folder, exp_id)
        packages = list(dict.fromkeys([*chosen.packages, *(saved or [])]))
        import_packages(packages)
        check_registered(chosen.env)
    rest = [*chosen.rest, "--exp-id", str(exp_id)]
    return chosen._replace(packages=packages, rest=rest), saved is not None


def _has_display() -> bool:
    """Say whether a window can open. Without a display, the library that MuJoCo opens one with ends the process."""
    displays = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
    return sys.platform != "linux" or any(os.environ.get(name) for name in displays)


def _kept_env(make: Callable[..., Any], *, load_best: bool) -> Callable[..., Any]:
    """Have rl_zoo3's function that makes environments take the statistics of the best model with that model."""
    from sb3_bruno.zoo.trained import statistics_of

    def make_env(env_id: str, *, stats_path: str | None, **kwargs: Any) -> Any:
        if stats_path is not None:
            stats_path = str(statistics_of(Path(stats_path).parent, Path(stats_path), load_best=load_best).parent)
        return make(env_id, stats_path=stats_path, **kwargs)

    return make_env


def _rl_zoo3_record_video(watched: _Watched) -> None:
    """Run rl_zoo3's script, with a progress bar. It ignores the ``env_kwargs`` of the run's config: put them in."""
    import rl_zoo3.utils

    from sb3_bruno.zoo.shown_steps import ShownSteps

    make = _kept_env(rl_zoo3.utils.create_test_env, load_best=watched.load_best)

    def make_as_trained(env_id: str, hyperparams: dict[str, Any], env_kwargs: dict[str, Any], **kwargs: Any) -> Any:
        env_kwargs = {**hyperparams.get("env_kwargs", {}), **env_kwargs}
        return ShownSteps(make(env_id, hyperparams=hyperparams, env_kwargs=env_kwargs, **kwargs), watched.n_steps)

    with replaced(vars(rl_zoo3.utils), "create_test_env", make_as_trained):
        run_script("rl_zoo3.record_video")

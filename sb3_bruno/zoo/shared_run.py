"""Makes folders of agents to share from runs, and takes in those that were shared."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from huggingface_sb3 import EnvironmentName
from rl_zoo3.utils import get_latest_run_id

from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.export import load_agent, save_agent
from sb3_bruno.export.card import PICTURE, write_card
from sb3_bruno.export.shared import CARD, DIAGNOSED, check_names, check_sizes, needed_files, shared_files
from sb3_bruno.files.shown import shown
from sb3_bruno.files.whole import whole_file
from sb3_bruno.runs.folder import AGENT_FILE
from sb3_bruno.runs.origin import ORIGIN, load_command
from sb3_bruno.runs.record import RunRecord
from sb3_bruno.zoo.called import with_names
from sb3_bruno.zoo.portable import copy_origin, copy_settings, without_places
from sb3_bruno.zoo.registry import ALGORITHMS
from sb3_bruno.zoo.saved_run import SavedRun
from sb3_bruno.zoo.trained import TrainedAgent
from sb3_bruno.zoo.trust import check_settings


def pack(agent: TrainedAgent, out: Path, record: Path | None) -> Path:
    """Make a folder of an agent that can be shared.

    Args:
        agent: the agent, of a run that was tested.
        out: the folder of agents to put it in.
        record: the folder of its record, as ``sb3-bruno report`` makes it; None for the tests in its run.

    Raises:
        ValueError: if the agent infers no task, is no plain data, or was not tested, or its environment has a name by
            which nothing is shared.
    """
    model, env = agent.model, EnvironmentName(agent.config["env"])
    if not isinstance(model, TaskInference):
        raise ValueError(f"--algo {agent.config['algo']} infers no task, so there is no agent file of it")
    check_names(needed_files(env), str(agent.folder))
    known = with_names(RunRecord.load(record) if record is not None else RunRecord.from_run(agent.folder))
    for name in ("algo", "env", "env_steps", "seed"):
        if known.about["config"].get(name) != agent.config[name]:
            told = f"{name} {known.about['config'].get(name)}, and the agent of {agent.config[name]}"
            raise ValueError(f"the record is of {told}: give the record of this agent, by --record")
    picture = agent.folder / PICTURE if record is None else record.parents[1] / PICTURE
    folder = _next(out, agent.config["algo"], env)
    (folder / env).mkdir(parents=True)
    try:
        model._vec_normalize_env = agent.vec_normalize
        save_agent(model, folder / f"{env}{AGENT_FILE}")
        for name in ("args.yml", "config.yml"):
            copy_settings(agent.folder / env / name, folder / env / name)
        has_origin = (agent.folder / ORIGIN).is_file()
        if has_origin:
            copy_origin(agent.folder / ORIGIN, folder / ORIGIN)
        for source, name in ((agent.folder / DIAGNOSED, DIAGNOSED), (picture, PICTURE)):
            if source.is_file():
                shutil.copyfile(source, folder / name)
        card = write_card(
            known._replace(about=without_places(known.about)),
            load_command(folder) if has_origin else (),
            class_name=type(model).__name__,
            has_picture=picture.is_file(),
            diagnosed=_read(folder / DIAGNOSED),
        )
        with whole_file(folder / CARD) as part:
            part.write_text(card, encoding="utf-8")
    except BaseException:
        shutil.rmtree(folder)
        raise
    return folder


def files_to_share(logs: Path, algo: str, env: str, exp_id: int, packages: Sequence[str]) -> tuple[Path, list[str]]:
    """Find the folder of an agent that was packed, and name its files, which ``take_in`` would take elsewhere.

    Args:
        logs: the folder of agents.
        algo: rl_zoo3's name of the algorithm.
        env: id of the environment.
        exp_id: the run's number, 0 for the latest.
        packages: packages that its settings may name, besides ours and those that it imports; who takes it in has to
            name them all.

    Raises:
        ValueError: if one of them is missing, or not as ``pack`` makes it.
    """
    name = EnvironmentName(env)
    number = exp_id or get_latest_run_id(str(logs / algo), name)
    folder = logs / algo / f"{name}_{number}"
    names = shared_files(folder, name)
    check_names(names, str(folder))
    check_sizes({name: (folder / name).stat().st_size for name in names}, str(folder))
    _check_files(folder, name, [*packages, *SavedRun.load(folder / name).gym_packages])
    return folder, names


def take_in(fetched: Path, out: Path, place: str, packages: Sequence[str]) -> Path:
    """Put an agent that was fetched among others, after looking at all of its files.

    Args:
        fetched: the folder with its files, and no others.
        out: the folder of agents to put it in.
        place: where it is from, for errors.
        packages: packages that its settings may name, besides ours.

    Raises:
        ValueError: if a file is not as ``pack`` makes it, or the settings would have other code run.
    """
    names = [str(path.relative_to(fetched).as_posix()) for path in fetched.rglob("*") if not path.is_dir()]
    env = check_names(names, place)
    try:
        algo = _check_files(fetched, env, packages)
    except ValueError as error:  # which names a folder that nobody keeps
        raise ValueError(f"{place}: {str(error).replace(f'{fetched}/', '')}") from error
    folder = _next(out, algo, env)
    folder.parent.mkdir(parents=True, exist_ok=True)
    shutil.copytree(fetched, folder)
    return folder


def _read(path: Path) -> str:
    """Read a text; "" if there is none."""
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _check_files(folder: Path, env: str, packages: Sequence[str]) -> str:
    """Look at the files of an agent that is shared.

    Args:
        folder: where they are.
        env: the environment's name, as the folders of runs are named.
        packages: packages that its settings may name, besides ours.

    Returns:
        rl_zoo3's name of its algorithm.

    Raises:
        ValueError: if a file is not as ``pack`` makes it, or the settings would have other code run.
    """
    saved = SavedRun.load(folder / env)
    check_settings(saved, folder / env, packages, remedy="share an agent without it")
    if (folder / ORIGIN).is_file():
        load_command(folder)
    model = load_agent(folder / f"{env}{AGENT_FILE}", device="cpu")
    algo = str(saved.arguments.get("algo"))
    if type(model) is not ALGORITHMS.get(algo):
        told = f"holds a {type(model).__name__}, and {env}/args.yml says algo {shown(algo)}"
        raise ValueError(f"{folder / f'{env}{AGENT_FILE}'} {told}: give another")
    return algo


def _next(out: Path, algo: str, env: str) -> Path:
    """Name the folder of the next agent of an algorithm in an environment."""
    return out / algo / f"{env}_{get_latest_run_id(str(out / algo), env) + 1}"

"""``sb3-bruno pack``, ``push`` and ``pull``: share trained agents as files that run no code when they are loaded."""

from __future__ import annotations

import argparse
import importlib.util
from pathlib import Path
from tempfile import TemporaryDirectory

from sb3_bruno.cli.mistake import Mistake, check_installed, told_as_mistake
from sb3_bruno.cli.parser import add_gym_packages, add_run, add_trust, command_parser
from sb3_bruno.cli.shown_command import env_flags, shown_command
from sb3_bruno.cli.values import writable_folder

AGENTS = Path("agents")


def pack(arguments: list[str]) -> None:
    """Make a folder of a trained agent to share: its agent file, its settings, and a card with its returns.

    The run has to be tested by ``evaluate``. What ``diagnose`` found goes into the card too.

    example: sb3-bruno pack --algo bruno_sac --env CheetahDir-v0 -f logs --out agents
    """
    parser = command_parser("pack", pack)
    add_run(parser, folder="logs")
    add_gym_packages(parser)
    add_trust(parser)
    parser.add_argument("--record", type=Path, metavar="DIR", help="a record of `report` instead of the run's tests")
    parser.add_argument("--out", type=writable_folder, default=AGENTS, help="folder of agents (default: agents)")
    options = parser.parse_args(arguments)
    check_installed("rl_zoo3", "pandas")

    from sb3_bruno.zoo.registry import register
    from sb3_bruno.zoo.shared_run import pack as pack_agent
    from sb3_bruno.zoo.trained import load_trained

    register()
    with told_as_mistake():
        agent = load_trained(
            options.algo,
            options.env,
            options.folder,
            exp_id=options.exp_id,
            gym_packages=options.gym_packages,
            trust=options.trust,
        )
        folder = pack_agent(agent, options.out, options.record)
    print(f"Saved {folder}")


def push(arguments: list[str]) -> None:
    """Send an agent that ``pack`` packed to the Hugging Face hub. Log in before: hf auth login.

    example: sb3-bruno push --repo-id me/cheetah-dir --algo bruno_sac --env CheetahDir-v0 -f agents
    """
    parser = command_parser("push", push)
    add_run(parser, folder="agents")
    add_gym_packages(parser)
    _add_repo(parser)
    parser.add_argument("--private", action="store_true", help="a new repository is for its owner alone")
    options = parser.parse_args(arguments)
    _check_hub()

    from sb3_bruno.export.hub import push as push_files
    from sb3_bruno.zoo.shared_run import files_to_share

    with told_as_mistake():
        folder, names = files_to_share(
            Path(options.folder), options.algo, options.env, options.exp_id, options.gym_packages
        )
        url = push_files(folder, names, options.repo_id, private=options.private)
    print(f"Sent {folder} to {url}")


def pull(arguments: list[str]) -> None:
    """Fetch an agent from the Hugging Face hub, and look at its files before it is put among other agents.

    example: sb3-bruno pull --repo-id me/cheetah-dir
    """
    parser = command_parser("pull", pull)
    _add_repo(parser)
    add_gym_packages(parser)
    parser.add_argument("--out", type=writable_folder, default=AGENTS, help="folder of agents (default: agents)")
    options = parser.parse_args(arguments)
    _check_hub()

    from sb3_bruno.export.hub import fetch
    from sb3_bruno.zoo.saved_run import SavedRun
    from sb3_bruno.zoo.shared_run import take_in

    with told_as_mistake(), TemporaryDirectory() as temporary:
        fetched, place = Path(temporary), f"--repo-id {options.repo_id}"
        fetch(options.repo_id, fetched)
        folder = take_in(fetched, options.out, place, options.gym_packages)
    algo, name = folder.parent.name, folder.name.rpartition("_")[0]
    env = str(SavedRun.load(folder / name).arguments.get("env"))  # with slashes, of which a folder's name has none
    known = env if env.replace("/", "-") == name else name
    flags = ["-f", options.out, "--algo", algo, *env_flags(known, options.gym_packages)]
    print(f"Saved {folder}. Watch it: {shown_command('enjoy', *flags)}")


def _add_repo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--repo-id", required=True, metavar="NAME/REPOSITORY", help="the repository on the hub")


def _check_hub() -> None:
    """Refuse to begin where the hub's library is missing.

    Raises:
        Mistake: naming it.
    """
    check_installed("rl_zoo3")
    if importlib.util.find_spec("huggingface_hub") is None:
        raise Mistake("huggingface_hub is not installed: pip install 'sb3_bruno[hub]'")

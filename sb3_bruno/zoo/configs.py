"""Config files in RL Zoo's form: find one, name it, read it, and merge other hyperparameters into it."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml

import sb3_bruno
from sb3_bruno.zoo.one_line import in_one_line

DEFAULT = "default"
"""The section of a config file that serves environments without a section of their own, as in RL Zoo."""


def configs_folder() -> Path:
    """Find our configs: inside the installed package, or at the top of a clone."""
    package = Path(sb3_bruno.__file__).parent
    installed, clone = package / "zoo_configs", package.parent / "zoo_configs"
    return installed if installed.is_dir() else clone


def config_file(algo: str, conf: str | None = None) -> str | None:
    """Find the config file of an algorithm.

    Args:
        algo: rl_zoo3's name of it.
        conf: None for our default, the name of a folder of ours ("oracle"), or what rl_zoo3 takes: a YAML or Python
            file, or a Python package.

    Returns:
        What rl_zoo3's ``-conf`` takes; None for rl_zoo3's own config of the algorithm.

    Raises:
        ValueError: if there is no such file.
    """
    folder = configs_folder()
    if conf is None:
        ours = folder / f"{algo}.yml"
        return str(ours) if ours.is_file() else None
    folders = sorted(path.name for path in folder.iterdir() if path.is_dir() and any(path.glob("*.yml")))
    if conf in folders:
        ours = folder / conf / f"{algo}.yml"
        if not ours.is_file():
            algos = ", ".join(sorted(path.stem for path in ours.parent.glob("*.yml")))
            raise ValueError(f"-conf {conf} has no config of --algo {algo}: it has {algos}")
        return str(ours)
    exists = Path(conf).is_file() if conf.endswith((".yml", ".yaml", ".py")) else _is_package(conf)
    if not exists:
        nearest = get_close_matches(conf, folders, n=1)
        remedy = f": did you mean {nearest[0]}?" if nearest else ""
        raise ValueError(f"-conf {conf} is neither a file nor one of our folders ({', '.join(folders)}){remedy}")
    return conf


def _is_package(name: str) -> bool:
    """Say whether Python can import something of this name."""
    try:
        return importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):  # of its parent, or no name at all
        return False


def config_name(algo: str, conf: str | None) -> str | None:
    """Name a config alike on every machine: by the file's folder and name, or by the folder alone for oracle/sac.yml.

    Args:
        algo: rl_zoo3's name of the algorithm.
        conf: what ``-conf`` was given.
    """
    if conf is None or not conf.endswith((".yml", ".yaml", ".py")):
        return conf
    *folder, name = Path(conf).with_suffix("").parts[-2:]
    return folder[0] if folder and name == algo else "/".join([*folder, name])


def read_configs(path: str | None) -> dict[str, Any]:
    """Read a YAML config, by environment. RL Zoo's other kinds of config are programs, and read as empty.

    Raises:
        ValueError: if the file cannot be read, or does not hold hyperparameters by environment.
    """
    if path is None or not path.endswith((".yml", ".yaml")):
        return {}
    try:
        configs: Any = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (yaml.YAMLError, OSError, UnicodeError) as error:
        raise ValueError(f"-conf {path} cannot be read as YAML: {in_one_line(error)}") from error
    form = "write the environment's id, and below it `policy: MlpPolicy` and the other hyperparameters"
    if not isinstance(configs, dict) or not configs:
        raise ValueError(f"-conf {path} holds no environments: {form}")
    for env_id, config in configs.items():
        if not isinstance(config, dict) or not all(isinstance(name, str) for name in config):
            raise ValueError(f"-conf {path} holds no hyperparameters of {env_id}: {form}")
    return configs


def find_config(configs: Mapping[str, Any], env_id: str) -> dict[str, Any] | None:
    """Find an environment's hyperparameters, or the file's ``default`` ones; None if it has neither."""
    found: dict[str, Any] | None = configs.get(env_id, configs.get(DEFAULT))
    return found


def merged(config: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Merge given hyperparameters into those of a config; dicts among them are merged too, not replaced."""
    both = {**config, **given}
    for key in config.keys() & given.keys():
        if isinstance(config[key], dict) and isinstance(given[key], dict):
            both[key] = {**config[key], **given[key]}
    return both


def flat(settings: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Flatten nested dicts: {"a": {"b": 1}} becomes {"a.b": 1}."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        found |= flat(value, f"{path}{name}.") if isinstance(value, Mapping) else {f"{path}{name}": value}
    return found

"""Config files in RL Zoo's form: find one, name it, read it, and merge other hyperparameters into it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

import sb3_bruno


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
    if (folder / conf).is_dir():
        ours = folder / conf / f"{algo}.yml"
        if not ours.is_file():
            algos = ", ".join(sorted(path.stem for path in ours.parent.glob("*.yml")))
            raise ValueError(f"-conf {conf} has no config of --algo {algo}: it has {algos}")
        return str(ours)
    if conf.endswith((".yml", ".yaml", ".py")) and not Path(conf).is_file():
        folders = ", ".join(sorted(path.name for path in folder.iterdir() if path.is_dir()))
        raise ValueError(f"-conf {conf} is neither a file nor one of our folders ({folders})")
    return conf


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
    """Read a YAML config, by environment. RL Zoo's other kinds of config are programs, and read as empty."""
    if path is None or not path.endswith((".yml", ".yaml")):
        return {}
    configs: dict[str, Any] = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    return configs


def merged(config: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Merge given hyperparameters into those of a config; dicts among them are merged too, not replaced."""
    both = {**config, **given}
    for key in config.keys() & given.keys():
        if isinstance(config[key], dict) and isinstance(given[key], dict):
            both[key] = {**config[key], **given[key]}
    return both

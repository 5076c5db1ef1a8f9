"""Config files in RL Zoo's form: where ours are, what one says, and what is given over it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

import sb3_bruno


def configs_folder() -> Path:
    """The folder of our configs: inside the installed package, or at the top of a clone."""
    package = Path(sb3_bruno.__file__).parent
    installed, clone = package / "zoo_configs", package.parent / "zoo_configs"
    return installed if installed.is_dir() else clone


def config_file(algo: str, conf: str | None = None) -> str | None:
    """The config file of an algorithm.

    :param algo: rl_zoo3's name of it
    :param conf: None for our default, the name of a folder of ours ("oracle"), or what rl_zoo3 takes: a YAML or
        Python file, or a Python package
    :return: what rl_zoo3's ``-conf`` takes, or None for rl_zoo3's own config of the algorithm
    :raises ValueError: if there is no such file
    """
    folder = configs_folder()
    if conf is None:
        ours = folder / f"{algo}.yml"
        return str(ours) if ours.is_file() else None
    if (folder / conf).is_dir():
        ours = folder / conf / f"{algo}.yml"
        if not ours.is_file():
            there = ", ".join(sorted(one.stem for one in ours.parent.glob("*.yml")))
            raise ValueError(f"-conf {conf} has no config of --algo {algo}: it has {there}")
        return str(ours)
    if conf.endswith((".yml", ".yaml", ".py")) and not Path(conf).is_file():
        folders = ", ".join(sorted(one.name for one in folder.iterdir() if one.is_dir()))
        raise ValueError(f"-conf {conf} is neither a file nor one of our folders ({folders})")
    return conf


def config_name(algo: str, conf: str | None) -> str | None:
    """What a config is called on every machine: a file by its folder and name, oracle/sac.yml by its folder alone."""
    if conf is None or not conf.endswith((".yml", ".yaml", ".py")):
        return conf
    *folder, name = Path(conf).with_suffix("").parts[-2:]
    return folder[0] if folder and name == algo else "/".join([*folder, name])


def read_configs(path: str | None) -> dict[str, Any]:
    """What a YAML config says, by environment; nothing of RL Zoo's other kinds of config, which are programs."""
    if path is None or not path.endswith((".yml", ".yaml")):
        return {}
    configs: dict[str, Any] = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    return configs


def merged(config: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Hyperparameters with given ones over them; dicts within are merged, not replaced."""
    both = {**config, **given}
    for key in config.keys() & given.keys():
        if isinstance(config[key], dict) and isinstance(given[key], dict):
            both[key] = {**config[key], **given[key]}
    return both

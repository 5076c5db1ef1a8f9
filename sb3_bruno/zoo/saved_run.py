"""What ``sb3-bruno train`` saved about a run, and how the run differs from the config as it is now."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

from sb3_bruno.zoo.configs import config_file, config_name, find_config, flat, read_configs
from sb3_bruno.zoo.saved_yaml import read_saved
from sb3_bruno.zoo.setting_kinds import check_settings_kinds

NEEDED = {"conf_file", "env_kwargs", "hyperparams"}
"""Arguments of the command line that tell one run from another."""


class SavedRun(NamedTuple):
    """The settings of a training run.

    Attributes:
        arguments: the command line's, by rl_zoo3's names.
        hyperparams: what the agent was trained with, ``env_kwargs`` of the config included.
    """

    arguments: dict[str, Any]
    hyperparams: dict[str, Any]

    @classmethod
    def load(cls, params: Path) -> SavedRun:
        """Read ``args.yml`` and ``config.yml``.

        Args:
            params: the folder that holds them, which is named after the environment, in the run's folder.

        Raises:
            ValueError: if one of them is missing or cannot be read, or a setting is of a wrong kind.
        """
        arguments = read_saved(params / "args.yml")
        hyperparams = {"normalize": False} | read_saved(params / "config.yml")
        for name, saved, needed in (("args.yml", arguments, NEEDED), ("config.yml", hyperparams, {"n_timesteps"})):
            if not saved.keys() >= needed:
                missing = ", ".join(sorted(needed - saved.keys()))
                raise ValueError(f"{params / name} cannot be read: it has no {missing}: train again")
            check_settings_kinds(saved, params / name)
        policy_kwargs = hyperparams.get("policy_kwargs")
        if isinstance(policy_kwargs, dict) and policy_kwargs.get("use_sde") is False:
            del policy_kwargs["use_sde"]  # SB3 writes this default into the dict that it is given
        return cls(arguments, hyperparams)

    @property
    def gym_packages(self) -> list[str]:
        """Packages to import, which register the environment."""
        packages: list[str] = self.arguments.get("gym_packages", [])
        return packages

    @property
    def env_kwargs(self) -> dict[str, Any]:
        """The keywords that the environment was made with: the config's, then the command line's."""
        return {**(self.hyperparams.get("env_kwargs") or {}), **(self.arguments["env_kwargs"] or {})}

    def choices(self, algo: str, env_id: str) -> dict[str, Any]:
        """Tell this run from others: which config it chose, where it differs from that, and all hyperparameters.

        The config is read as it is now. So a setting that the run tried and the config has since adopted is no
        difference, and a setting that the config has since changed is one. Entries of a dict are compared one by one
        and named like ``encoder_kwargs.belief``. A setting that only the config has is None.

        Returns:
            ``conf``, ``params`` (the differences by name) and ``hyperparameters``, all values that JSON can hold.
        """
        used = dict(self.hyperparams)
        if self.env_kwargs:
            used["env_kwargs"] = self.env_kwargs
        conf = self.arguments["conf_file"]
        config = find_config(_read_config(algo, conf), env_id)
        if config is None:
            differing = dict(self.arguments["hyperparams"] or {})
        else:
            expected = flat({"normalize": False, **config, "n_timesteps": used["n_timesteps"]})
            found = flat(used)
            names = {**found, **expected}
            differing = {name: found.get(name) for name in names if found.get(name) != expected.get(name)}
        chosen = {"conf": config_name(algo, conf), "params": differing, "hyperparameters": used}
        as_json: dict[str, Any] = _as_json(chosen)
        return as_json


def _as_json(value: Any) -> Any:
    """Turn a setting into values that JSON can hold: what it has no value for, such as infinity, becomes text."""
    if isinstance(value, Mapping):
        return {str(name): _as_json(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_as_json(entry) for entry in value]
    is_known = value is None or isinstance(value, bool | int | str) or (isinstance(value, float) and isfinite(value))
    return value if is_known else str(value)


def _read_config(algo: str, conf: str | None) -> dict[str, Any]:
    """Read the config that a run chose, by environment. Return nothing if it is gone or not in YAML.

    No package is looked for, since to look for ``a.b`` imports a, and the run may be a stranger's.
    """
    if conf is not None and "." in conf and not conf.endswith((".yml", ".yaml")):
        return {}
    try:
        return read_configs(config_file(algo, conf))
    except ValueError:
        return {}

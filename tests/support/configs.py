"""The zoo's configs, as constructors take them."""

from pathlib import Path

import yaml

CONFIGS = Path(__file__).parents[2] / "zoo_configs"


def zoo_config(algo, env):
    """What the config of an algorithm says of an environment."""
    return yaml.safe_load((CONFIGS / f"{algo}.yml").read_text())[env]


def settings_of(config):
    """The constructor's arguments in a zoo config."""
    return {key: value for key, value in config.items() if key not in ("n_timesteps", "n_envs", "policy")}

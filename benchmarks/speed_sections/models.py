"""The agents whose speed is measured, with random transitions to learn from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno import BrunoSAC

ENV_ID = "sb3_bruno_envs:CheetahDir-v0"
OBSERVATION_DIM, ACTION_DIM = 17, 6
ZOO = Path(__file__).parents[2] / "zoo_configs"
CONFIG = yaml.safe_load((ZOO / "bruno_sac.yml").read_text(encoding="utf-8"))["CheetahDir-v0"]
PAPERS = yaml.safe_load((ZOO / "paper" / "bruno_sac.yml").read_text(encoding="utf-8"))["CheetahDir-v0"]
_TRAINED = ("policy_kwargs", "replay_buffer_kwargs", "encoder_kwargs", "encoder_batch_size", "encoder_update_ratio")
CHEETAH: dict[str, Any] = {key: CONFIG[key] for key in _TRAINED}
"""CheetahDir's config, as far as it says what an update costs."""
KERNEL: dict[str, Any] = {**CHEETAH, "encoder_kwargs": {"modelled": "rewards"}}
"""The same with the library's default encoder, of rewards."""


def trained(n_envs: int = 10, **kwargs: Any) -> BrunoSAC:
    """Make a BrunoSAC with 4,000 random transitions to learn from."""
    env = make_vec_env(ENV_ID, n_envs, seed=0)
    return BrunoSAC("MlpPolicy", env, seed=0, learning_starts=10**9, device="cpu", **kwargs).learn(4_000)


def plain(n_envs: int = 10, **kwargs: Any) -> SAC:
    """Make SB3's SAC with as many."""
    env = make_vec_env(ENV_ID, n_envs, seed=0, env_kwargs={"observe": "plain"})
    return SAC("MlpPolicy", env, seed=0, learning_starts=10**9, device="cpu", **kwargs).learn(4_000)

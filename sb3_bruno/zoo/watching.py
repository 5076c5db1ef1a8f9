"""Has rl_zoo3's scripts act with an agent file, where they would load a zip and the pickle of VecNormalize."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import torch as th
from huggingface_sb3 import EnvironmentName, ModelName
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecEnv

from sb3_bruno.export import load_agent
from sb3_bruno.export.normalization import normalized, write_normalization
from sb3_bruno.zoo.stored_agent import StoredAgent, statistics_of

MakeVecEnv = Callable[..., VecEnv]


class AgentFileLoader(NamedTuple):
    """Stands in for an algorithm in rl_zoo3's list of them, and loads an agent file.

    Attributes:
        algorithm: what it stands in for: the agent's own class, or one made from it that acts the same.
    """

    algorithm: type[BaseAlgorithm]

    def load(self, path: str, device: th.device | str = "auto", seed: int | None = None, **_: Any) -> BaseAlgorithm:
        """Load an agent file. Further arguments tell SB3 how to load a zip."""
        model = load_agent(path, device=device)
        if not issubclass(self.algorithm, type(model)):
            raise ValueError(f"{path} is an agent of {type(model).__name__}, not of {self.algorithm.__name__}")
        model.__class__ = self.algorithm
        if seed is not None:  # as SB3 does
            set_random_seed(seed)
        return model


def path_of(stored: StoredAgent, algo: str, env: EnvironmentName) -> Callable[..., tuple[str, str, str]]:
    """Stand in for rl_zoo3's ``get_model_path``, which finds zips alone."""
    kind = "best" if stored.is_best else "final"
    found = (f"{kind}-model-{ModelName(algo, env)}", str(stored.path), str(stored.run))
    return lambda *args, **kwargs: found


def with_statistics(make: MakeVecEnv, stored: StoredAgent | None, *, load_best: bool) -> MakeVecEnv:
    """Have rl_zoo3's function that makes environments normalise their observations as the agent needs them.

    Args:
        make: the function.
        stored: the agent, if it is an agent file, which brings its own statistics; None if it is not.
        load_best: whether it is the best model, of whose statistics there may be a pickle.
    """

    def make_env(env_id: str, *, stats_path: str | None, **kwargs: Any) -> VecEnv:
        if stored is not None:
            return _normalized_as(make(env_id, stats_path=None, **kwargs), stored.path)
        if stats_path is not None:
            stats_path = str(statistics_of(Path(stats_path).parent, Path(stats_path), load_best=load_best).parent)
        return make(env_id, stats_path=stats_path, **kwargs)

    return make_env


def _normalized_as(env: VecEnv, path: Path) -> VecEnv:
    """Normalise observations as in the training of the agent in an agent file, and rewards not at all."""
    known = load_agent(path, device="cpu").get_vec_normalize_env()
    if known is None:
        return env
    wrapped = normalized(env, *write_normalization(known))
    wrapped.norm_reward = False
    return wrapped

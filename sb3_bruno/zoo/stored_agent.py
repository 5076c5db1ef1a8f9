"""The files that an agent is kept in: its agent file, which is preferred, or the zip and the pickle of SB3."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import rl_zoo3
from huggingface_sb3 import EnvironmentName
from rl_zoo3.utils import get_latest_run_id, get_model_path
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.export import load_agent, save_agent
from sb3_bruno.runs.folder import AGENT_FILE
from sb3_bruno.zoo.one_line import in_one_line
from sb3_bruno.zoo.trust import check_pickle

OF_BEST = "best_model"
"""The name of the best model's files, and of the folder with the statistics of VecNormalize that it was judged with."""
STATISTICS = "vecnormalize.pkl"
"""Where rl_zoo3 looks for VecNormalize's statistics in a folder."""

MakeEnv = Callable[..., gym.Env[Any, Any]]


class StoredAgent(NamedTuple):
    """Where an agent is.

    Attributes:
        path: its file.
        run: the folder of its run.
        params: the folder with the run's settings.
        is_best: whether it is the best model, and not the last.
    """

    path: Path
    run: Path
    params: Path
    is_best: bool

    @classmethod
    def find(cls, algo: str, env: EnvironmentName, logs: str | Path, exp_id: int, *, load_best: bool) -> StoredAgent:
        """Find an agent in rl_zoo3's log folder.

        Args:
            algo: rl_zoo3's name of the algorithm.
            env: the environment.
            logs: the log folder.
            exp_id: the run's number, 0 for the latest, -1 for the agent in the log folder itself.
            load_best: find the best model of the run instead of the last.

        Raises:
            AssertionError: if there is no such run.
            ValueError: if it holds no such agent.
        """
        folder = Path(logs, algo)
        number = exp_id or get_latest_run_id(str(folder), env)
        run = folder / f"{env}_{number}" if number > 0 else folder
        path = run / f"{OF_BEST if load_best else env}{AGENT_FILE}"
        if not path.is_file():
            _, zip_path, _ = get_model_path(number or exp_id, str(logs), algo, env, load_best)
            path = Path(zip_path)
        return cls(path, run, run / env, load_best)

    @property
    def is_safe(self) -> bool:
        """Whether it is an agent file, which runs no code."""
        return self.path.suffix == AGENT_FILE

    def load(self, algo: str, *, trust: bool = False) -> BaseAlgorithm:
        """Load the agent on the CPU.

        Args:
            algo: rl_zoo3's name of the algorithm.
            trust: load a pickle from any folder.

        Raises:
            ValueError: if the file is damaged, or another algorithm's; the weights are not finite; or it is a pickle
                that is not trusted.
        """
        if self.is_safe:
            model: BaseAlgorithm = load_agent(self.path, device="cpu")
            if type(model) is not rl_zoo3.ALGOS[algo]:
                raise ValueError(f"{self.path} is an agent of {type(model).__name__}: give another --algo than {algo}")
            return model
        check_pickle(self.path, trust=trust)
        try:
            model = rl_zoo3.ALGOS[algo].load(self.path, device="cpu")
        except Exception as error:  # a damaged file may raise anything
            raise ValueError(f"{self.path} cannot be loaded as {algo}: {in_one_line(error)}: train it again") from error
        if not all(weights.isfinite().all() for weights in model.policy.parameters()):
            problem = "is an agent whose weights are not finite, for its training diverged"
            raise ValueError(f"{self.path} {problem}: train it again, with a lower learning_rate")
        return model

    def vec_normalize(self, model: BaseAlgorithm, make_env: MakeEnv, *, is_needed: bool) -> VecNormalize | None:
        """Load the statistics of the training's observations; None if these were not normalised.

        Args:
            model: the agent as ``load`` loaded it.
            make_env: makes an environment like that of the training.
            is_needed: whether the run's settings say that they were.

        Raises:
            ValueError: if they are missing or damaged: the agent would see other observations than in training.
        """
        if self.is_safe:
            return model.get_vec_normalize_env()
        path = statistics_of(self.run, self.params, load_best=self.is_best)
        if not path.exists() and not is_needed:
            return None
        try:
            return VecNormalize.load(str(path), DummyVecEnv([make_env]))
        except Exception as error:  # a damaged file may raise anything
            remedy = "copy it there from a backup, or train again"
            raise ValueError(
                f"{path}, which normalises observations, cannot be read: {in_one_line(error)}: {remedy}"
            ) from error


def statistics_of(run: Path, params: Path, *, load_best: bool) -> Path:
    """Find the file of VecNormalize's statistics that belong to a run's last model, or to its best one.

    A run of an earlier version kept none with the best model: then those of the last are taken, with a warning.
    """
    last, best = params / STATISTICS, run / OF_BEST / STATISTICS
    if load_best and last.exists() and not best.exists():
        warnings.warn(
            f"{run} kept no statistics of VecNormalize with its best model: those of the end are taken, which may "
            "differ.",
            stacklevel=3,
        )
    return best if load_best and best.exists() else last


def write_beside(model: BaseAlgorithm, path: Path, final: Path) -> None:
    """Write the agent file of a model, if it infers a task and is plain data. A training does not end for that.

    Args:
        model: the model.
        path: where to write it.
        final: where it will be: an older file there goes, if there will be none of this model.
    """
    if not isinstance(model, TaskInference):
        return
    try:
        save_agent(model, path)
    except ValueError as error:
        final.unlink(missing_ok=True)
        warnings.warn(f"{final} is not written, so there is the zip alone. {error}", stacklevel=2)

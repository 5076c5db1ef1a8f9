"""Finds a trained agent in rl_zoo3's log folder, with the environment and the tasks to test it on."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import rl_zoo3
from huggingface_sb3 import EnvironmentName
from numpy.typing import NDArray
from rl_zoo3.utils import get_model_path
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno.runs.clock import TrainingClock
from sb3_bruno.runs.folder import is_unfinished, latest_finished
from sb3_bruno.runs.origin import trained_at
from sb3_bruno.zoo.one_line import in_one_line
from sb3_bruno.zoo.registry import import_packages
from sb3_bruno.zoo.saved_run import SavedRun

MakeEnv = Callable[..., gym.Env[Any, Any]]


class TestTasks(NamedTuple):
    """The tasks that an agent is tested on.

    Attributes:
        tasks: all tasks of a split, ``(n_tasks, task_dim)``.
        inside: which of them lie between training tasks, ``(n_tasks,)``.
        n_inner: episodes in a trial; 1 if the environment has no trials.
    """

    tasks: NDArray[np.float32]
    inside: NDArray[np.bool_]
    n_inner: int


class TrainedAgent(NamedTuple):
    """An agent and its test.

    Attributes:
        model: the agent, on the CPU.
        make_env: makes a test environment.
        test: the tasks to test it on.
        vec_normalize: the training environment's, if it had one.
        folder: the run's.
        config: what tells this run from others, in values that JSON can hold.
    """

    model: BaseAlgorithm
    make_env: MakeEnv
    test: TestTasks
    vec_normalize: VecNormalize | None
    folder: Path
    config: dict[str, Any]


def load_trained(
    algo: str,
    env: str,
    logs: str | Path = "logs",
    *,
    exp_id: int = 0,
    load_best: bool = False,
    split: str = "test",
    steps: int | None = None,
) -> TrainedAgent:
    """Load the agent of a run, and what it is to be tested on.

    Args:
        algo: rl_zoo3's name of the algorithm.
        env: id of the environment.
        logs: the log folder.
        exp_id: the run's number, 0 for the latest that has come to its end.
        load_best: load the best model of the run instead of the last.
        split: the tasks to test on, "train" or "test".
        steps: length of a test episode; None for the environment's own.

    Raises:
        ValueError: if no agent can be loaded, all runs are unfinished and ``exp_id`` chooses none, its environment has
            no list of tasks, or ``steps`` would cut a trial.
    """
    env_name = EnvironmentName(env)
    exp_id = exp_id or latest_finished(Path(logs) / algo, env_name)
    try:
        _, model_path, folder = get_model_path(exp_id, str(logs), algo, env_name, load_best)
    except AssertionError as error:
        raise ValueError(str(error)) from error
    run, params = Path(folder), Path(folder) / env_name
    if is_unfinished(run):
        warnings.warn(f"{run} is unfinished: this is the agent as it was when it was last saved.", stacklevel=2)
    saved = SavedRun.load(params)
    import_packages(saved.gym_packages)
    env_kwargs = saved.env_kwargs | {"split": split}
    if steps is not None:
        env_kwargs["max_episode_steps"] = steps
    make_env = partial(gym.make, env_name.gym_id, **env_kwargs)
    test = _test_tasks(make_env, split)
    if steps is not None and test.n_inner > 1:
        raise ValueError(f"--steps {steps}: a trial is as long as its {test.n_inner} episodes, so leave it out")
    model = _load(algo, model_path)
    clock = TrainingClock.of_run(run)
    config = {
        "algo": algo,
        **saved.choices(algo, env_name.gym_id),
        "env": env_name.gym_id,
        "split": split,
        "env_steps": model.num_timesteps,
        "seed": model.seed,
        "wall_seconds": None if clock is None else float(clock.seconds[-1]),
        "trained_at": trained_at(run),
        "inside_train_box": test.inside.tolist(),
        "n_inner_episodes": test.n_inner,
    }
    return TrainedAgent(model, make_env, test, _vec_normalize(params, make_env), run, config)


def _test_tasks(make_env: MakeEnv, split: str) -> TestTasks:
    """List the tasks of a split.

    Raises:
        ValueError: if the environment has no such list.
    """
    try:
        env = make_env()
        distribution = env.get_wrapper_attr("task_distribution")
        tasks: NDArray[np.float32] = distribution.tasks(split)
    except (TypeError, AttributeError) as error:
        raise ValueError(f"the environment has no list of {split} tasks to test on: {error}") from error
    n_inner = env.get_wrapper_attr("n_episodes") if env.has_wrapper_attr("n_episodes") else 1
    env.close()
    return TestTasks(tasks, distribution.inside_train_box(tasks), n_inner)


def _load(algo: str, path: str) -> BaseAlgorithm:
    """Load a model on the CPU.

    Raises:
        ValueError: if the file is damaged, or another algorithm's.
    """
    try:
        model: BaseAlgorithm = rl_zoo3.ALGOS[algo].load(path, device="cpu")
    except Exception as error:  # a damaged file may raise anything
        raise ValueError(f"{path} cannot be loaded as {algo}: {in_one_line(error)}: train it again") from error
    return model


def _vec_normalize(params: Path, make_env: MakeEnv) -> VecNormalize | None:
    path = params / "vecnormalize.pkl"
    return VecNormalize.load(str(path), DummyVecEnv([make_env])) if path.is_file() else None

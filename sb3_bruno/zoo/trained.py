"""Finds a trained agent in rl_zoo3's log folder, with the environment and the tasks to test it on."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from huggingface_sb3 import EnvironmentName
from numpy.typing import NDArray
from rl_zoo3.utils import get_latest_run_id, get_wrapper_class
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.runs.clock import TrainingClock
from sb3_bruno.runs.folder import has_agent, is_unfinished, latest_finished
from sb3_bruno.runs.origin import trained_at
from sb3_bruno.zoo.environments import make_env, takes, tasks_of
from sb3_bruno.zoo.one_line import in_one_line
from sb3_bruno.zoo.registry import check_algorithm, check_registered, import_packages
from sb3_bruno.zoo.saved_run import SavedRun
from sb3_bruno.zoo.stored_agent import MakeEnv, StoredAgent
from sb3_bruno.zoo.trust import check_settings, is_trusted


class TestTasks(NamedTuple):
    """The tasks that an agent is tested on.

    Attributes:
        tasks: all tasks of a split, ``(n_tasks, task_dim)``.
        train: all training tasks, ``(n_train, task_dim)``.
        inside: which of them lie between training tasks, ``(n_tasks,)``.
        n_inner: episodes in a trial; 1 if the environment has no trials.
    """

    tasks: NDArray[np.float32]
    train: NDArray[np.float32]
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
    tasks: str | None = None,
    steps: int | None = None,
    gym_packages: Sequence[str] = (),
    needs_tasks: bool = True,
    trust: bool = False,
) -> TrainedAgent:
    """Load the agent of a run, and what it is to be tested on.

    Args:
        algo: rl_zoo3's name of the algorithm.
        env: id of the environment.
        logs: the log folder.
        exp_id: the run's number, 0 for the latest that has come to its end.
        load_best: load the best model of the run instead of the last.
        split: the tasks to test on, "train" or "test".
        tasks: a set of tasks that the family names, such as "beyond"; None for those that the run was trained with.
        steps: length of a test episode; None for the environment's own.
        gym_packages: packages to import, besides those that the run remembers.
        needs_tasks: whether the environment must have a list of tasks; False for who tests nothing.
        trust: load pickles, and what the run's settings name, from any folder.

    Raises:
        ValueError: if no agent can be loaded, or not with the statistics that it was trained with; if all runs are
            unfinished and ``exp_id`` chooses none; if its environment has no list of tasks, and ``needs_tasks``, or no
            set of the name ``tasks``; if ``steps`` would cut a trial; or if what would be run is not trusted.
    """
    package, _, env = env.rpartition(":")
    packages = [*gym_packages, *([package] if package else [])]
    check_algorithm(algo)
    env_name = EnvironmentName(env)
    exp_id = exp_id or latest_finished(Path(logs) / algo, env_name)
    try:
        stored = StoredAgent.find(algo, env_name, logs, exp_id, load_best=load_best)
    except (AssertionError, ValueError) as error:
        import_packages(packages)
        check_registered(env)  # a wrong name is the likely reason
        raise ValueError(f"{error}: train there, or give another -f, --algo, --env or --exp-id") from error
    run = stored.run
    if is_unfinished(run):
        warnings.warn(f"{run} is unfinished: this is the agent as it was when it was last saved.", stacklevel=2)
    saved = SavedRun.load(stored.params)
    if not trust and not is_trusted(run):
        check_settings(saved, stored.params, packages)
    import_packages([*packages, *saved.gym_packages])
    check_registered(env)
    env_kwargs = saved.env_kwargs
    if takes(env, "split"):
        env_kwargs["split"] = split
    trained_on = dict(env_kwargs)
    if tasks is not None:
        if not takes(env, "tasks"):
            raise ValueError(f"--tasks {tasks}: {env} has one set of tasks: leave it out")
        env_kwargs["tasks"] = tasks
    if steps is not None:
        env_kwargs["max_episode_steps"] = steps
    with _told_of_settings(stored.params):
        wrap = get_wrapper_class(saved.hyperparams)

    def make_test_env(**more: Any) -> gym.Env[Any, Any]:
        return make_env(env, {**env_kwargs, **more}, wrap)

    with _told_of_settings(stored.params):
        test = _test_tasks(make_test_env, env, split, is_needed=needs_tasks)
    if tasks is not None:
        test = _beside_training(test, make_env(env, trained_on, wrap))
    if steps is not None and test.n_inner > 1:
        raise ValueError(f"--steps {steps}: a trial is as long as its {test.n_inner} episodes, so leave it out")
    model = stored.load(algo, trust=trust)
    clock = TrainingClock.of_run(run)
    config = {
        "algo": algo,
        **saved.choices(algo, env),
        "env": env,
        "split": split,
        **({} if tasks is None else {"tasks": tasks}),
        "env_steps": model.num_timesteps,
        "seed": model.seed,
        "wall_seconds": None if clock is None else float(clock.seconds[-1]),
        "trained_at": trained_at(run),
        "inside_train_box": test.inside.tolist(),
        "n_inner_episodes": test.n_inner,
    }
    normalization = stored.vec_normalize(model, make_test_env, is_needed=bool(saved.hyperparams["normalize"]))
    return TrainedAgent(model, make_test_env, test, normalization, run, config)


def packages_of_run(
    algo: str, env: str, logs: str | Path, exp_id: int = 0, given: Sequence[str] = (), *, trust: bool = False
) -> list[str] | None:
    """Return the packages that a run's training imported; None if there is no such run.

    rl_zoo3 takes a run whose settings are missing for one of an environment without arguments, wrappers and
    normalisation.

    Args:
        algo: rl_zoo3's name of the algorithm.
        env: id of the environment.
        logs: the log folder.
        exp_id: the run's number, 0 for the latest, -1 for the agent in the log folder itself.
        given: the packages that the user has named.
        trust: take what the run's settings name from any folder.

    Raises:
        ValueError: if the run's settings are missing, cannot be read, or name what is not trusted.
    """
    name, folder = EnvironmentName(env), Path(logs, algo)
    number = exp_id or get_latest_run_id(str(folder), name)
    run = folder / f"{name}_{number}" if number > 0 else folder
    if not (run / name).is_dir() and not has_agent(run, name):
        return None
    saved = SavedRun.load(run / name)
    if not trust and not is_trusted(run):
        check_settings(saved, run / name, given)
    return saved.gym_packages


@contextmanager
def _told_of_settings(params: Path) -> Iterator[None]:
    """Tell, of whatever kind the error is, that no environment can be made as a run's settings say."""
    try:
        yield
    except ValueError:
        raise
    except Exception as error:  # of Gymnasium, of a wrapper, or of the environment
        raise ValueError(
            f"{params} has settings that its environment cannot be made with: {in_one_line(error)}: correct env_kwargs "
            "in args.yml and config.yml, and the wrappers"
        ) from error


def _test_tasks(make_env: MakeEnv, env_id: str, split: str, *, is_needed: bool) -> TestTasks:
    """List the tasks of a split.

    Raises:
        ValueError: if the environment has no such list, and ``is_needed``.
    """
    env = make_env()
    try:
        tasks = tasks_of(env, split)
        if len(tasks) == 0 and is_needed:
            remedy = "give its MetaTask a TaskSet, or an array of tasks"
            raise ValueError(f"--env {env_id}: the environment has no list of {split} tasks to test on: {remedy}")
        n_inner = env.get_wrapper_attr("n_episodes") if env.has_wrapper_attr("n_episodes") else 1
        return TestTasks(tasks, tasks_of(env, "train"), _inside(env, tasks), n_inner)
    finally:
        env.close()


def _beside_training(test: TestTasks, trained: gym.Env[Any, Any]) -> TestTasks:
    """Compare the tasks of a named set with those of the training, in whose environment they are told apart."""
    try:
        return test._replace(train=tasks_of(trained, "train"), inside=_inside(trained, test.tasks))
    finally:
        trained.close()


def _inside(env: gym.Env[Any, Any], tasks: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Tell which tasks lie between the training tasks of an environment; all, where it cannot tell."""
    if len(tasks) == 0:
        return np.ones(0, dtype=bool)
    is_inside = getattr(env.get_wrapper_attr("task_distribution"), "inside_train_box", None)
    inside: NDArray[np.bool_] = np.ones(len(tasks), dtype=bool) if is_inside is None else is_inside(tasks)
    return inside

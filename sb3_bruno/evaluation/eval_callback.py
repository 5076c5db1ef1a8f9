"""SB3's EvalCallback, which also logs the return of each hidden task and keeps it for learning curves.

Knows environments that name their hidden task in ``info["task"]``. Knows no algorithm.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from sb3_bruno.evaluation.resumable_eval import ResumableEvalCallback, Rows, has_ended
from sb3_bruno.evaluation.told import task_name
from sb3_bruno.files.whole import whole_file
from sb3_bruno.task_names import log_key, task_label

_TASKS_FILE = "evaluation_tasks.npz"  # beside SB3's evaluations.npz
_MAX_LOGGED_TASKS = 50
_MAX_CONSOLE_KEY = 30  # SB3's console table cuts longer keys, and refuses two that then look the same


class LearningCurve(NamedTuple):
    """The evaluations of one training run.

    Attributes:
        timesteps: environment steps of training before each evaluation, ``(n_evals,)``.
        tasks: the hidden task of each episode, ``(n_evals, n_episodes, task_dim)``.
        returns: the return of each episode, ``(n_evals, n_episodes)``.
        names: what the environment calls the task of each episode, ``(n_evals, n_episodes)``; ``""`` for nothing.
            None: nobody named any.
    """

    timesteps: NDArray[np.int64]
    tasks: NDArray[np.float32]
    returns: NDArray[np.float64]
    names: NDArray[np.str_] | None = None

    def called(self) -> NDArray[np.str_]:
        """Return the names of the tasks, ``""`` where a task has none, ``(n_evals, n_episodes)``."""
        return np.full(self.returns.shape, "") if self.names is None else self.names


class TaskEvalCallback(ResumableEvalCallback):
    """Evaluates as EvalCallback does, and tells the tasks apart. Kills and resumes: as in ``ResumableEvalCallback``.

    Logs the mean return of each task as ``eval/return_task_<label>``, for the first 50 tasks that it meets, and
    ``eval/success_task_<label>`` where ``info["is_success"]`` ends an episode. The label is ``info["task_name"]``, or
    made of the task's numbers. Given
    ``log_path``, writes the task of each episode to ``evaluation_tasks.npz`` beside SB3's ``evaluations.npz``;
    ``load_learning_curve`` reads both.

    Let each evaluation environment cycle through its tasks (``draw="cycle"``), and evaluate as many episodes as there
    are tasks, or a multiple of that. Then every task has the same weight in every evaluation.

    Args:
        eval_env: the environment to evaluate in.
        **kwargs: EvalCallback's other arguments.

    Raises:
        ValueError: if an episode of the evaluation environment ends without ``info["task"]``.
    """

    files: ClassVar[dict[str, set[str]]] = {**ResumableEvalCallback.files, _TASKS_FILE: {"tasks"}}

    def __init__(self, eval_env: gym.Env[Any, Any] | VecEnv, **kwargs: Any) -> None:
        super().__init__(eval_env, **kwargs)
        self.evaluations_tasks: list[NDArray[np.float32]] = []  # (n_episodes, task_dim) each
        self.evaluations_names: list[NDArray[np.str_]] = []  # (n_episodes,) each
        self._episode_tasks: list[NDArray[np.float32]] = []  # of the current evaluation
        self._episode_names: list[str] = []
        self._logged_tasks: dict[bytes, str] = {}  # the ends of their log keys

    def _continue(self, rows: Rows) -> None:
        super()._continue(rows)
        self.evaluations_tasks = list(rows["tasks"].astype(np.float32))
        self.evaluations_names = list(rows.get("names", np.full(rows["tasks"].shape[:2], "")))

    def _on_step(self) -> bool:
        self._episode_tasks, self._episode_names = [], []
        continue_training = super()._on_step()
        if len(self.evaluations_tasks) < len(self.evaluations_results):
            assert self.log_path is not None  # for mypy: with none, no results are kept
            self.evaluations_tasks.append(np.stack(self._episode_tasks))
            self.evaluations_names.append(np.array(self._episode_names))
            with self._full_disk_told(), whole_file(Path(self.log_path).with_name(_TASKS_FILE)) as part:
                np.savez(part, tasks=np.stack(self.evaluations_tasks), names=np.stack(self.evaluations_names))
        return continue_training

    def _log_success_callback(self, locals_: dict[str, Any], globals_: dict[str, Any]) -> None:
        """Note task and return of an episode that ends; ``evaluate_policy`` calls this after every step."""
        super()._log_success_callback(locals_, globals_)
        info = locals_["info"]
        if not has_ended(locals_):
            return
        if "task" not in info:
            raise ValueError("eval_env ended an episode without info['task']: wrap the eval environment in MetaTask.")
        self._episode_tasks.append(np.array(info["task"], dtype=np.float32))
        episode_return = info["episode"]["r"] if locals_["is_monitor_wrapped"] else _running_return(locals_)
        self._episode_names.append(task_name(info))
        measured = {"return": float(episode_return)}
        if not np.isnan(self._told[-1]):
            measured["success"] = self._told[-1]
        self._log(info, measured)

    def _log(self, info: dict[str, Any], measured: Mapping[str, float]) -> None:
        """Average numbers into the log entries of the task; EvalCallback writes the log at the end."""
        task = self._episode_tasks[-1].tobytes()
        if task not in self._logged_tasks:
            if len(self._logged_tasks) >= _MAX_LOGGED_TASKS:
                return
            self._logged_tasks[task] = self._new_label(task_label(info["task"], info.get("task_index")))
        label = self._logged_tasks[task]
        for name, value in measured.items():
            key = f"{name}_task_{label}"
            exclude = ("stdout", "log") if len(key) > _MAX_CONSOLE_KEY else None
            self.logger.record_mean(f"eval/{key}", value, exclude=exclude)

    def _new_label(self, numbers: str) -> str:
        """Return the end of the log keys of the task that was met last, which no other task has."""
        label, taken = log_key(self._episode_names[-1]) or numbers, self._logged_tasks.values()
        for more in (numbers, str(len(taken))):  # where tasks share a name, or look the same in numbers too
            label = f"{label}_{more}" if label in taken else label
        return label


def load_learning_curve(path: str | Path) -> LearningCurve:
    """Read what TaskEvalCallback wrote.

    Args:
        path: the callback's ``log_path``.

    Raises:
        ValueError: if the folder lacks one of the two files, or a file is damaged.
    """
    try:
        rows = TaskEvalCallback.read(Path(path))
    except ValueError as error:
        raise ValueError(
            f"path={str(path)!r} holds no evaluations with tasks: give a log_path of TaskEvalCallback. {error}."
        ) from error
    return LearningCurve(
        rows["timesteps"].astype(np.int64),
        rows["tasks"].astype(np.float32),
        rows["results"].astype(np.float64),
        rows.get("names"),
    )


def _running_return(locals_: dict[str, Any]) -> float:
    """Return what the current environment has earned so far, from the local variables of ``evaluate_policy``."""
    return float(locals_["current_rewards"][locals_["i"]])

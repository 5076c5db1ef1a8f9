"""A callback that diagnoses the belief while training; logs numbers and figure, and writes both and the arrays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
from numpy.typing import ArrayLike
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import Figure

from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.diagnostics.diagnose import check_diagnosable, diagnose
from sb3_bruno.diagnostics.figure import draw_diagnostics


class DiagnosticsCallback(BaseCallback):
    """Logs the numbers of ``diagnose`` as ``diagnostics/...``, and the figure for TensorBoard.

    Needs the ``plots`` extra.

    Args:
        make_env: makes one environment with a time limit, as for ``diagnose``.
        tasks: the tasks to give at reset, ``(n_tasks, task_dim)``.
        freq: calls of the callback between two diagnoses; in each call, all training environments take a step.
        n_episodes: episodes of each task.
        outside_tasks: tasks that should raise the alarm, ``(n_outside, task_dim)``.
        seed: of the episodes, the same every time.
        log_path: the folder for ``diagnostics_<env steps>.npz`` and ``.png``; None writes no files.
        verbose: 1 prints each summary.

    Raises:
        ValueError: if ``freq`` is not positive, or the trained model has no belief.
    """

    model: TaskInference

    def __init__(
        self,
        make_env: Callable[[], gym.Env[Any, Any]],
        tasks: ArrayLike,
        freq: int,
        *,
        n_episodes: int = 5,
        outside_tasks: ArrayLike | None = None,
        seed: int = 0,
        log_path: str | Path | None = None,
        verbose: int = 0,
    ) -> None:
        super().__init__(verbose)
        if freq < 1:
            raise ValueError(f"freq={freq} is not positive: give the number of calls between two diagnoses.")
        self.make_env = make_env
        self.tasks = tasks
        self.freq = freq
        self.n_episodes = n_episodes
        self.outside_tasks = outside_tasks
        self.seed = seed
        self.log_path = None if log_path is None else Path(log_path)

    def _init_callback(self) -> None:
        """Refuse a model that cannot be diagnosed before it is trained."""
        if not isinstance(self.model, TaskInference):
            raise ValueError(
                f"model is of class {type(self.model).__name__}, which has no belief: use BrunoSAC or a sibling."
            )
        check_diagnosable(self.model.policy.encoder)
        if self.log_path is not None:
            self.log_path.mkdir(parents=True, exist_ok=True)

    def _on_step(self) -> bool:
        if self.n_calls % self.freq == 0:
            self._diagnose()
        return True

    def _diagnose(self) -> None:
        found = diagnose(
            self.model,
            self.make_env,
            self.tasks,
            n_episodes=self.n_episodes,
            seed=self.seed,
            vec_normalize=self.model.get_vec_normalize_env(),
            outside_tasks=self.outside_tasks,
        )
        figure = draw_diagnostics(found)
        if self.log_path is not None:
            stem = self.log_path / f"diagnostics_{self.num_timesteps}"
            found.save(stem.with_suffix(".npz"))
            figure.savefig(stem.with_suffix(".png"), dpi=150)
        if self.verbose >= 1:
            print(found.summary())
        for name, value in found.numbers().items():
            self.logger.record(f"diagnostics/{name}", value)
        only_tensorboard = ("stdout", "log", "json", "csv")
        self.logger.record("diagnostics/figure", Figure(figure, close=True), exclude=only_tensorboard)
        self.logger.record("time/total_timesteps", self.num_timesteps, exclude="tensorboard")
        self.logger.dump(self.num_timesteps)

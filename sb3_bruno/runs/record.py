"""The record of a finished run: its settings, its learning curve and its final test, as JSON and CSV.

It takes a few kilobytes per run. Every table and figure of a results page is made from it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.evaluation.eval_callback import LearningCurve, load_learning_curve
from sb3_bruno.evaluation.floats import mean_of_known
from sb3_bruno.files.whole import whole_files
from sb3_bruno.runs.clock import TrainingClock
from sb3_bruno.runs.kept_test import check_config, check_record, find_test
from sb3_bruno.task_names import ALL_TASKS, FEW_TASKS, task_label

HORIZONS = (200, 1_000)
"""Steps after which the final test's returns are kept too: the paper's, for its curves and for its test."""

_ABOUT, _CURVE, _EPISODES, _REWARDS = "run.json", "learning_curve.csv", "episodes.csv", "rewards.csv"


class RunRecord(NamedTuple):
    """What is kept of one run.

    Attributes:
        about: config (algo, env, env_steps, seed, ...), versions, and the steps to 90 % of each task's steady reward.
        learning: every test episode while training: timesteps, seconds of training (NaN without monitor files), task,
            return.
        episodes: every episode of the final test: task, episode, and the ``measures``.
        rewards: every step of the final test: task (or "all"), step, and the mean, lowest and highest reward over the
            episodes.
    """

    about: dict[str, Any]
    learning: pd.DataFrame
    episodes: pd.DataFrame
    rewards: pd.DataFrame

    @property
    def method(self) -> str:
        """The name of the run in tables and figures: its algorithm, and every choice that differs from its config.

        A final test with sampled actions is such a choice: "stochastic".
        """
        config = self.about["config"]
        chosen = [config["conf"]] if config.get("conf") else []
        chosen += [f"{name}={value}" for name, value in config.get("params", {}).items()]
        chosen += [] if config.get("deterministic", True) else ["stochastic"]
        return f"{config['algo']} ({', '.join(chosen)})" if chosen else str(config["algo"])

    def save(self, folder: str | Path) -> None:
        """Write the four files of the record."""
        with whole_files(folder, _ABOUT) as part:
            (part / _ABOUT).write_text(json.dumps(self.about, indent=1) + "\n", encoding="utf-8")
            for name, table in ((_CURVE, self.learning), (_EPISODES, self.episodes), (_REWARDS, self.rewards)):
                table.to_csv(part / name, index=False, float_format="%.7g", lineterminator="\n")

    @classmethod
    def load(cls, folder: str | Path) -> RunRecord:
        """Read what ``save`` wrote.

        Raises:
            ValueError: if the folder holds no such record.
        """
        folder = Path(folder)
        read: Any = {"converters": {"task": str}}  # as it is: with a dtype, a task called "None" would be none
        try:
            about = json.loads((folder / _ABOUT).read_text(encoding="utf-8"))
            tables = [pd.read_csv(folder / name, **read) for name in (_CURVE, _EPISODES, _REWARDS)]
        except (OSError, ValueError) as error:  # pandas' errors are ValueErrors
            raise ValueError(f"{folder} holds no record of a run: record it again, or delete it ({error})") from error
        check_record(about, tables, folder)
        return cls(about, *tables)

    @classmethod
    def from_run(cls, folder: str | Path) -> RunRecord:
        """Make the record of a run from its folder, which holds TaskEvalCallback's curve and tests.

        Args:
            folder: the run's, of whose tests ``find_test`` chooses one; or the file of a test in it.

        Raises:
            ValueError: if the folder lacks one of them.
        """
        folder, result = find_test(Path(folder))
        check_config(result.config, folder, len(result.tasks))
        steps = dict(zip(result.labels, result.steps_to_steady().tolist(), strict=True))
        about = {"config": result.config, "versions": result.versions, "test_seed": result.seed, "steps_to_90": steps}
        return cls(
            about,
            _learning(load_learning_curve(folder), TrainingClock.of_run(folder), result),
            _episodes(result),
            _rewards(result),
        )

    @property
    def measures(self) -> list[str]:
        """Names of what was measured: return_200 is the return after 200 steps, episode_1 that of a trial's first.

        Where the environment tells successes, success_percent comes first, 100 or 0 of an episode.
        """
        return [str(name) for name in self.episodes.columns.drop(["task", "episode"])]

    def scores(self, measure: str) -> pd.Series[float]:
        """Average a measure over the episodes of each task in the final test, by task."""
        means: pd.Series[float] = self.episodes.groupby("task", sort=False)[measure].mean()
        return means

    def parts(self) -> dict[str, list[str]]:
        """Group the tasks that a table shows apart, by name.

        A few tasks are shown one by one; many as those inside and those outside the training tasks' box. The result is
        empty if there are many and none is outside.
        """
        labels: list[str] = self.episodes["task"].unique().tolist()
        if len(labels) <= FEW_TASKS:
            return {label: [label] for label in labels}
        inside = self.about["config"].get("inside_train_box", [True])
        if all(inside):
            return {}
        pairs = list(zip(labels, inside, strict=True))
        return {
            "inside": [label for label, is_inside in pairs if is_inside],
            "outside": [label for label, is_inside in pairs if not is_inside],
        }


def _learning(curve: LearningCurve, clock: TrainingClock | None, result: AdaptationResult) -> pd.DataFrame:
    """Tabulate a learning curve, a row per episode: ``RunRecord.learning``. Tasks are called as in the test."""
    tested = {np.float32(task).tobytes(): label for task, label in zip(result.tasks, result.labels, strict=True)}
    timesteps = np.repeat(curve.timesteps, curve.returns.shape[1])
    return pd.DataFrame(
        {
            "timesteps": timesteps,
            "seconds": np.nan if clock is None else clock.at(timesteps),
            "task": [
                tested.get(task.tobytes(), name or task_label(task))
                for task, name in zip(
                    curve.tasks.reshape(-1, curve.tasks.shape[-1]), curve.called().ravel(), strict=True
                )
            ],
            "return": curve.returns.ravel(),
        }
    )


def _episodes(result: AdaptationResult) -> pd.DataFrame:
    """Tabulate the final test, a row per episode: ``RunRecord.episodes``."""
    n_tasks, n_episodes, _ = result.rewards.shape
    columns: dict[str, Any] = {
        "task": np.repeat(result.labels, n_episodes),
        "episode": np.tile(np.arange(n_episodes), n_tasks),
    }
    if result.successes is not None:
        columns["success_percent"] = 100 * result.successes.ravel()
    n_inner = result.config.get("n_inner_episodes", 1)
    if n_inner > 1:
        inner = result.returns_per_episode(n_inner).reshape(-1, n_inner)
        columns |= {f"episode_{number + 1}": inner[:, number] for number in range(n_inner)}
    for horizon in (*(steps for steps in HORIZONS if steps < result.horizon), result.horizon):
        columns[f"return_{horizon}"] = result.returns(horizon).ravel()
    return pd.DataFrame(columns)


def _rewards(result: AdaptationResult) -> pd.DataFrame:
    """Tabulate the final test, a row per step of each task, or of all if there are many: ``RunRecord.rewards``."""
    n_tasks, _, horizon = result.rewards.shape
    if n_tasks > FEW_TASKS:
        groups = {ALL_TASKS: result.rewards.reshape(-1, horizon)}
    else:
        groups = dict(zip(result.labels, result.rewards, strict=True))
    steps = np.arange(1, horizon + 1)
    tables = [
        pd.DataFrame(
            {
                "task": name,
                "step": steps,
                "mean": mean_of_known(rewards),
                "low": np.fmin.reduce(rewards.astype(np.float64), axis=0),
                "high": np.fmax.reduce(rewards.astype(np.float64), axis=0),
            }
        )
        for name, rewards in groups.items()
    ]
    return pd.concat(tables)

"""What is kept of a finished run: its settings, its learning curve and its final test, as JSON and CSV.

A few kilobytes per run, from which every table and figure of a results page is made.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sb3_bruno.evaluation.adaptation_result import FEW_TASKS, AdaptationResult, task_label
from sb3_bruno.evaluation.eval_callback import LearningCurve, load_learning_curve
from sb3_bruno.runs.clock import TrainingClock

HORIZONS = (200, 1_000)
"""Steps after which the returns of the final test are kept, beside its own: the paper's for curves and for the test."""

_ABOUT, _CURVE, _EPISODES, _REWARDS = "run.json", "learning_curve.csv", "episodes.csv", "rewards.csv"


class RunRecord(NamedTuple):
    """One run.

    Attributes:
        about: config (algo, env, env_steps, seed, ...), versions, and the steps to 90 % of each task's steady reward.
        learning: the test return of every episode while training: timesteps, seconds of training (NaN where no monitor
            file tells), task, return.
        episodes: the final test: task, episode, the ``measures``.
        rewards: the final test: task (or "all"), step, and mean, lowest and highest reward over the episodes.
    """

    about: dict[str, Any]
    learning: pd.DataFrame
    episodes: pd.DataFrame
    rewards: pd.DataFrame

    @property
    def method(self) -> str:
        """What the run is called in tables and figures: its algorithm, and what was chosen against its config.

        A test with actions drawn counts as such a choice.
        """
        config = self.about["config"]
        chosen = [config["conf"]] if config.get("conf") else []
        chosen += [f"{name}={value}" for name, value in config.get("params", {}).items()]
        chosen += [] if config.get("deterministic", True) else ["stochastic"]
        return f"{config['algo']} ({', '.join(chosen)})" if chosen else str(config["algo"])

    def save(self, folder: str | Path) -> None:
        """Write the four files."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / _ABOUT).write_text(json.dumps(self.about, indent=1) + "\n", encoding="utf-8")
        for name, table in ((_CURVE, self.learning), (_EPISODES, self.episodes), (_REWARDS, self.rewards)):
            table.to_csv(folder / name, index=False, float_format="%.7g", lineterminator="\n")

    @classmethod
    def load(cls, folder: str | Path) -> RunRecord:
        """Read what ``save`` wrote."""
        folder = Path(folder)
        about = json.loads((folder / _ABOUT).read_text(encoding="utf-8"))
        read = {"dtype": {"task": str}}
        return cls(about, *(pd.read_csv(folder / name, **read) for name in (_CURVE, _EPISODES, _REWARDS)))

    @classmethod
    def from_run(cls, folder: str | Path) -> RunRecord:
        """What to keep of a run's folder, which holds the curve of TaskEvalCallback and ``adaptation.json``.

        Raises:
            ValueError: if the folder does not hold them.
        """
        folder = Path(folder)
        result = AdaptationResult.load(folder / "adaptation.json")
        steps = dict(zip(map(task_label, result.tasks), result.steps_to_steady().tolist(), strict=True))
        about = {"config": result.config, "versions": result.versions, "test_seed": result.seed, "steps_to_90": steps}
        return cls(
            about,
            _learning(load_learning_curve(folder), TrainingClock.of_run(folder)),
            _episodes(result),
            _rewards(result),
        )

    @property
    def measures(self) -> list[str]:
        """What was measured: return_200 and the like, after as many steps; of trials, episode_1 and so on too."""
        return [str(name) for name in self.episodes.columns.drop(["task", "episode"])]

    def scores(self, measure: str) -> pd.Series[float]:
        """The mean of each task over its episodes of the final test, by task."""
        means: pd.Series[float] = self.episodes.groupby("task", sort=False)[measure].mean()
        return means

    def parts(self) -> dict[str, list[str]]:
        """Tasks to tell apart, by name: each of a few; of many, those inside and outside the training tasks' box."""
        labels: list[str] = self.episodes["task"].unique().tolist()
        if len(labels) <= FEW_TASKS:
            return {label: [label] for label in labels}
        inside = self.about["config"].get("inside_train_box", [True])
        if all(inside):
            return {}
        pairs = list(zip(labels, inside, strict=True))
        return {"inside": [one for one, is_in in pairs if is_in], "outside": [one for one, is_in in pairs if not is_in]}


def _learning(curve: LearningCurve, clock: TrainingClock | None) -> pd.DataFrame:
    timesteps = np.repeat(curve.timesteps, curve.returns.shape[1])
    return pd.DataFrame(
        {
            "timesteps": timesteps,
            "seconds": np.nan if clock is None else clock.at(timesteps),
            "task": [task_label(task) for row in curve.tasks for task in row],
            "return": curve.returns.ravel(),
        }
    )


def _episodes(result: AdaptationResult) -> pd.DataFrame:
    n_tasks, n_episodes, _ = result.rewards.shape
    columns: dict[str, Any] = {
        "task": np.repeat([task_label(task) for task in result.tasks], n_episodes),
        "episode": np.tile(np.arange(n_episodes), n_tasks),
    }
    n_inner = result.config.get("n_inner_episodes", 1)
    if n_inner > 1:
        inner = result.returns_per_episode(n_inner).reshape(-1, n_inner)
        columns |= {f"episode_{number + 1}": inner[:, number] for number in range(n_inner)}
    for horizon in (*(one for one in HORIZONS if one < result.horizon), result.horizon):
        columns[f"return_{horizon}"] = result.returns(horizon).ravel()
    return pd.DataFrame(columns)


def _rewards(result: AdaptationResult) -> pd.DataFrame:
    n_tasks, _, horizon = result.rewards.shape
    if n_tasks > FEW_TASKS:
        groups = {"all": result.rewards.reshape(-1, horizon)}
    else:
        groups = {task_label(task): rows for task, rows in zip(result.tasks, result.rewards, strict=True)}
    return pd.concat([_band(name, rows) for name, rows in groups.items()])


def _band(name: str, rewards: NDArray[np.float32]) -> pd.DataFrame:
    """rewards: (n_episodes, horizon), NaN after an episode."""
    table = pd.DataFrame(rewards.astype(np.float64))
    return pd.DataFrame(
        {
            "task": name,
            "step": np.arange(1, rewards.shape[1] + 1),
            "mean": table.mean(),
            "low": table.min(),
            "high": table.max(),
        }
    )

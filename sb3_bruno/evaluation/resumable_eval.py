"""SB3's EvalCallback for runs that may be killed and resumed: its files stay whole, and are continued."""

from __future__ import annotations

import os
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import EvalCallback

from sb3_bruno.evaluation.told import success
from sb3_bruno.files.whole import is_full, whole_files

Rows = dict[str, NDArray[Any]]
"""Arrays by name, each with a row per evaluation."""

_FILE = "evaluations.npz"  # SB3's name


class ResumableEvalCallback(EvalCallback):
    """Evaluates as EvalCallback does. A kill at any moment leaves its files whole.

    If the model has steps behind it and ``log_path`` an ``evaluations.npz``, its rows up to the model's steps stay, and
    later ones are dropped: the run was resumed from an earlier checkpoint, and makes those evaluations again. If the
    model has a seed, each evaluation seeds its environments with that seed plus the number of calls so far. So a
    resumed run is evaluated as if it had never been interrupted.

    ``successes`` in ``evaluations.npz`` has a number for each episode, NaN for one that does not tell. SB3 leaves such
    episodes out, and cannot save rows of different lengths.

    If the disk is full, a warning says so, and training goes on: the files stay as they were, and the next evaluation
    writes the rows of this one too.

    While an evaluation goes on, ``log_path`` and ``best_model_save_path`` name the places where its files are made.

    Raises:
        ValueError: at the start of training, if ``log_path`` holds evaluations of another number of episodes.
    """

    files: ClassVar[dict[str, set[str]]] = {_FILE: {"timesteps", "results", "ep_lengths"}}
    """The files in the folder ``log_path``, and what each must hold."""

    def restore(self, model: BaseAlgorithm) -> None:
        """Continue the evaluations in ``log_path``, at the same steps as before the run was interrupted.

        Files that cannot be read are set aside, with a warning, and the evaluations begin anew.

        Raises:
            ValueError: if ``log_path`` is None.
        """
        if self.log_path is None:
            raise ValueError("log_path=None holds no learning curve to continue: give that of the first run.")
        self.n_calls = model.num_timesteps // model.n_envs
        folder = Path(self.log_path).parent
        if not (folder / _FILE).exists():
            return  # the run died before its first evaluation, or the disk had no room for it
        try:
            rows = self.read(folder)
        except ValueError as error:
            self._set_aside(folder, error)
            return
        known = rows["timesteps"] <= model.num_timesteps
        self._continue({name: values[known] for name, values in rows.items()})

    @classmethod
    def read(cls, folder: Path) -> Rows:
        """Read the evaluations in a folder.

        Raises:
            ValueError: if one of the files is missing or damaged.
        """
        stored: Rows = {}
        for name, needed in cls.files.items():
            try:
                with np.load(folder / name) as arrays:
                    stored |= {key: arrays[key] for key in needed.union(arrays.files)}
            except (OSError, EOFError, ValueError, LookupError, TypeError, zipfile.BadZipFile, zlib.error) as error:
                raise ValueError(f"{folder / name} cannot be read ({error})") from error
        if stored["results"].ndim != 2:
            raise ValueError(f"{folder / _FILE} holds no evaluations")
        n = min(len(stored[name]) for needed in cls.files.values() for name in needed)  # a kill may fall between two
        return {name: values[:n] for name, values in stored.items() if len(values) >= n}

    def _continue(self, rows: Rows) -> None:
        """Take over the rows of earlier evaluations."""
        self.evaluations_timesteps = rows["timesteps"].tolist()
        self.evaluations_results = rows["results"].tolist()
        self.evaluations_length = rows["ep_lengths"].tolist()
        self.evaluations_successes = rows.get("successes", np.full(rows["results"].shape, np.nan)).tolist()
        self.best_mean_reward = max(map(float, np.mean(rows["results"], axis=1)), default=-np.inf)

    def _set_aside(self, folder: Path, error: ValueError) -> None:
        """Rename the files, which would be overwritten; say so."""
        for name in self.files:
            if (folder / name).exists():
                os.replace(folder / name, folder / f"{name}.damaged")
        warnings.warn(f"{error}: it is kept as *.damaged, and a new learning curve begins.", stacklevel=3)

    def _init_callback(self) -> None:
        super()._init_callback()
        begins = self.log_path is not None and not self.evaluations_timesteps
        if begins and self.model.num_timesteps > 0 and Path(f"{self.log_path}.npz").exists():
            self.restore(self.model)
        n_episodes = {len(row) for row in self.evaluations_results} - {self.n_eval_episodes}
        if n_episodes:
            raise ValueError(
                f"n_eval_episodes={self.n_eval_episodes}, but the evaluations in log_path={str(self.log_path)!r} are "
                f"of {n_episodes.pop()} episodes: give as many, or another log_path."
            )

    def _on_step(self) -> bool:
        if self.eval_freq <= 0 or self.n_calls % self.eval_freq != 0:
            return True
        if self.model.seed is not None:
            self.eval_env.seed(self.model.seed + self.n_calls)
        log_path, best_path = self.log_path, self.best_model_save_path
        self._told: list[float] = []  # the success of each episode of this evaluation
        successes: list[Any] = self.evaluations_successes
        continue_training = True  # also if the disk is full
        with self._full_disk_told(), ExitStack() as whole:
            try:
                if log_path is not None:
                    self.log_path = str(whole.enter_context(whole_files(Path(log_path).parent, _FILE)) / "evaluations")
                if best_path is not None:
                    self.best_model_save_path = str(whole.enter_context(whole_files(best_path, "best_model.zip")))
                self.evaluations_successes = []
                continue_training = super()._on_step()
                if self.log_path is not None:
                    self._save_successes([*successes, self._told])
            finally:
                if len(self.evaluations_results) > len(successes):
                    successes.append(self._told)
                self.evaluations_successes = successes
                self.log_path, self.best_model_save_path = log_path, best_path
        return continue_training

    @contextmanager
    def _full_disk_told(self) -> Iterator[None]:
        """Warn if the disk is full, where the block writes."""
        try:
            yield
        except OSError as error:
            if not is_full(error):  # such as a pipe to an environment that died
                raise
            problem = f"The evaluation at {self.num_timesteps} env steps cannot be written to {self.log_path!r}"
            remedy = "free some space. Training goes on, and the next evaluation is written with this one."
            warnings.warn(f"{problem} ({error.strerror}): {remedy}", stacklevel=3)

    def _save_successes(self, successes: list[list[float]]) -> None:
        """Add them to the file that SB3 has just written, if any episode told of one."""
        file = f"{self.log_path}.npz"
        with np.load(file) as arrays:
            rows = {name: arrays[name] for name in arrays.files}
        told = {} if np.isnan(successes).all() else {"successes": successes}
        np.savez(file, **{**rows, **told})

    def _log_success_callback(self, locals_: dict[str, Any], globals_: dict[str, Any]) -> None:
        """Note whether an episode that ends was a success; ``evaluate_policy`` calls this after every step."""
        if not has_ended(locals_):
            return
        self._told.append(success(locals_["info"]))
        if not np.isnan(self._told[-1]):
            self._is_success_buffer.append(self._told[-1])  # type: ignore[arg-type]  # of which SB3 takes the mean


def has_ended(locals_: Mapping[str, Any]) -> bool:
    """Return whether an episode ended, from the local variables of ``evaluate_policy``.

    A Monitor knows better than ``done``, as ``evaluate_policy`` has it.
    """
    return bool(locals_["done"]) and not (locals_["is_monitor_wrapped"] and "episode" not in locals_["info"])

"""Saves checkpoints while a model learns, always at the start of a rollout; a full disk does not end the training."""

from __future__ import annotations

import os
import pathlib
import warnings

from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from sb3_bruno.algorithms.values import is_number
from sb3_bruno.files.whole import check_writable, not_written
from sb3_bruno.resume.checkpoint import save_checkpoint


class ResumeCallback(BaseCallback):
    """Saves a checkpoint now and then, from which ``resume`` continues as if nothing had happened.

    A checkpoint is saved at the start of a rollout, because then no transition is half stored. It is written under
    another name first, and then replaces the last checkpoint. So the file at ``path`` is whole whenever the process
    dies.

    If a checkpoint cannot be written in mid-training, as on a full disk, a warning says so, the older one stays, and
    training goes on until the next.

    As the child of an event callback, such as EveryNTimesteps or EvalCallback, it saves at the start of the rollout
    after each event, whatever ``save_freq`` is.

    Args:
        path: the checkpoint file; each checkpoint replaces the last.
        save_freq: environment steps between two checkpoints.
        verbose: 1 prints a line for each checkpoint.
        how_to_resume: what to do to go on from a checkpoint, for errors.

    Raises:
        ValueError: if ``path`` is none or cannot be written, ``save_freq`` is not positive, the model is not
            off-policy, or a callback that is none of SB3's calls this one and does not tell it of rollouts.
    """

    def __init__(
        self,
        path: str | pathlib.Path,
        save_freq: int = 10_000,
        verbose: int = 0,
        *,
        how_to_resume: str = "resume from the older checkpoint there",
    ) -> None:
        super().__init__(verbose)
        if not isinstance(path, str | os.PathLike):
            raise ValueError(f"path={path!r} is no path: give the name of the checkpoint file.")
        if not (is_number(save_freq) and save_freq >= 1):  # NaN is not
            raise ValueError(f"save_freq={save_freq!r} is not positive: give the env steps between two checkpoints.")
        self.path = pathlib.Path(path)
        self.save_freq = save_freq
        self.how_to_resume = how_to_resume
        self._saved_at = 0
        self._is_told_of_rollouts = False
        self._is_due = False

    def save(self) -> None:
        """Save a checkpoint, at the start of a rollout.

        Raises:
            NotWritten: if it cannot be written; the older one stays.
        """
        try:
            self._write()
        except OSError as error:
            remedy = self.how_to_resume if self.path.is_file() else "train anew, for there is no older checkpoint"
            raise not_written(f"path={self.path}", error, f"free some space, then {remedy}") from error

    def _save_if_possible(self) -> None:
        """Save a checkpoint, at the start of a rollout; warn if it cannot be written."""
        try:
            self._write()
        except OSError as error:
            told = f"There is no checkpoint at {self._saved_at} env steps, for path={self.path} cannot be written"
            remedy = "free some space. Training goes on, and tries again at the next checkpoint; the older one stays."
            warnings.warn(f"{told} ({error.strerror or error}): {remedy}", stacklevel=2)

    def _write(self) -> None:
        assert isinstance(self.model, OffPolicyAlgorithm)  # for mypy: _init_callback checked it
        self._saved_at = self.model.num_timesteps
        self._is_due = False
        save_checkpoint(self.model, self.path)
        if self.verbose > 0:
            print(f"Checkpoint at {self._saved_at} env steps: {self.path}")

    def _init_callback(self) -> None:
        if not isinstance(self.model, OffPolicyAlgorithm):
            raise ValueError(
                f"model is of class {type(self.model).__name__}, and only off-policy ones can be resumed exactly: use "
                "SB3's CheckpointCallback."
            )
        check_writable(self.path)
        self._saved_at = self.model.num_timesteps
        self._is_told_of_rollouts = self._is_due = False

    def _on_rollout_start(self) -> None:
        self._is_told_of_rollouts = True
        if self.model.num_timesteps - self._saved_at >= self.save_freq:
            self._save_if_possible()

    def _on_step(self) -> bool:
        if not self._is_told_of_rollouts and not self._is_due:
            self._save_at_next_rollout()
        return True

    def _save_at_next_rollout(self) -> None:
        """Have the outermost callback, which alone is told of rollouts, save before the next: an event is now."""
        outermost = _outermost(self)
        on_rollout_start = outermost.on_rollout_start

        def save_first() -> None:
            outermost.on_rollout_start = on_rollout_start  # type: ignore[method-assign]  # once only
            self._save_if_possible()
            on_rollout_start()

        outermost.on_rollout_start = save_first  # type: ignore[method-assign]
        self._is_due = True


def _outermost(callback: BaseCallback) -> BaseCallback:
    """Find the callback that ``learn`` calls, among its local variables, which it shows to callbacks and their parents.

    Raises:
        ValueError: if neither ``callback`` nor a parent of it was shown them.
    """
    shown: BaseCallback | None = callback
    while shown is not None and "callback" not in shown.locals:
        shown = shown.parent
    if shown is None:
        raise ValueError(
            "ResumeCallback is called by a callback that does not tell it of rollouts, so it cannot know when nothing "
            "is half stored: give it to learn() beside that callback, or call its on_rollout_start() there too."
        )
    outermost: BaseCallback = shown.locals["callback"]
    return outermost

"""rl_zoo3's ExperimentManager in a folder of its own, from which an interrupted run can be resumed exactly."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

from rl_zoo3.exp_manager import ExperimentManager
from rl_zoo3.utils import get_latest_run_id
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import SubprocVecEnv, VecEnv

from sb3_bruno.evaluation.resumable_eval import ResumableEvalCallback
from sb3_bruno.files.whole import is_full, not_written, whole_file, whole_files
from sb3_bruno.resume.checkpoint import resume
from sb3_bruno.resume.interrupt import InterruptibleResumeCallback, deaf_children
from sb3_bruno.runs.folder import AGENT_FILE, SB3_FILE, RunFolder, resuming_command
from sb3_bruno.runs.origin import save_origin
from sb3_bruno.zoo.stored_agent import OF_BEST, STATISTICS, write_beside

CHECKPOINT = "checkpoint.pkl"


class RunOptions(NamedTuple):
    """What ExperimentManager does not know of a run.

    Attributes:
        checkpoint_freq: environment steps between checkpoints, 0 for none.
        resume_from: the folder of the run to go on with; None starts a new run.
        command: the arguments that start the run. They are saved in its folder, for resuming.
        on_start: called when the agent starts to learn.
    """

    checkpoint_freq: int = 25_000
    resume_from: Path | None = None
    command: Sequence[str] = ()
    on_start: Callable[[], None] = lambda: None


class KeptRun(ExperimentManager):
    """Train an agent as rl_zoo3 does, in a folder that no other process trains in, and that outlives kills.

    Args:
        *args: arguments of ExperimentManager.
        options: what ExperimentManager does not know of the run.
        **kwargs: further arguments of ExperimentManager.
    """

    def __init__(self, *args: Any, options: RunOptions, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._options = options
        self._resume_from = options.resume_from
        self._folder: RunFolder | None = None  # until it is made; a sweep's trials have none
        self._saver: InterruptibleResumeCallback | None = None
        self._is_interrupted = False
        if self._resume_from is not None:
            self.save_path = str(self._resume_from)
            self.params_path = f"{self.save_path}/{self.env_name}"

    def setup_experiment(self) -> tuple[BaseAlgorithm, dict[str, Any]] | None:
        """Build the model, or load it from the checkpoint of a resumed run.

        If that fails, a new run leaves no folder behind.
        """
        try:
            return self._set_up()
        except BaseException:
            if self._folder is not None:
                self._folder.discard()
            raise

    def _set_up(self) -> tuple[BaseAlgorithm, dict[str, Any]] | None:
        results = super().setup_experiment()
        if results is None:  # a search
            return None
        model, saved_hyperparams = results
        if self._resume_from is not None:
            model = self._resumed(model, self._resume_from)
        chosen = ["--seed", str(self.seed), "--checkpoint-freq", str(self._options.checkpoint_freq)]
        command = [*self._options.command, *chosen]  # if a flag is given twice, the last one counts
        save_origin(Path(self.save_path), command)
        return model, saved_hyperparams

    def _resumed(self, model: BaseAlgorithm, folder: Path) -> BaseAlgorithm:
        """Load the checkpoint in ``folder`` into the environments of ``model``."""
        assert model.env is not None  # for mypy
        model = resume(folder / CHECKPOINT, model.env, self.device)
        print(f"Going on at {model.num_timesteps:,} of {self.n_timesteps:,} env steps")
        for callback in self.callbacks:
            if isinstance(callback, ResumableEvalCallback):
                callback.restore(model)
        return model

    def create_log_folder(self) -> None:
        """Make the run's folder, which no other process has, or take that of a resumed run.

        Raises:
            ValueError: if another process trains in the folder to resume.
        """
        if self._resume_from is not None:
            self._folder = RunFolder(self._resume_from)
        while self._folder is None:
            try:
                self._folder = RunFolder.make(Path(self.save_path))
            except FileExistsError:  # another process was faster
                number = get_latest_run_id(self.log_path, self.env_name) + 1
                self.save_path = os.path.join(self.log_path, f"{self.env_name}_{number}")
                self.params_path = f"{self.save_path}/{self.env_name}"
        super().create_log_folder()  # type: ignore[no-untyped-call]

    def _save_config(self, saved_hyperparams: dict[str, Any]) -> None:
        """Save the config of a new run. A resumed run has saved it already."""
        if self._resume_from is None:
            super()._save_config(saved_hyperparams)

    def create_checkpoints(self, algorithm: type[BaseAlgorithm]) -> None:
        """Add the callback that saves checkpoints, for an algorithm that can be resumed."""
        freq = self._options.checkpoint_freq
        if freq > 0 and issubclass(algorithm, OffPolicyAlgorithm):
            path = Path(self.save_path)
            self._saver = InterruptibleResumeCallback(path / CHECKPOINT, freq, how_to_resume=_how_to_go_on(path))
            self.callbacks.append(self._saver)

    def create_envs(self, n_envs: int, eval_env: bool = False, no_log: bool = False) -> VecEnv:
        """Create the environments. A resumed run appends to its monitor files."""
        if self._resume_from is not None:
            self.monitor_kwargs["override_existing"] = False
        with deaf_children() if self.vec_env_class is SubprocVecEnv else nullcontext():
            return super().create_envs(n_envs, eval_env, no_log)

    def learn(self, model: BaseAlgorithm) -> None:
        """Train the model; a resumed run for the environment steps that are left.

        The run is marked as unfinished meanwhile. An interrupt ends the training with a checkpoint.

        Raises:
            NotWritten: if the disk is full, with how to go on.
        """
        assert self._folder is not None  # for mypy: setup_experiment has made it
        self._options.on_start()
        stoppable = _StoppableModel(model, is_resumed=self._resume_from is not None)
        try:
            with self._full_disk_told(), nullcontext() if self._saver is None else self._saver.listening():
                self._folder.begin()
                super().learn(stoppable)  # type: ignore[arg-type]
        except BaseException:
            self._folder.release()
            raise
        self._is_interrupted = stoppable.is_interrupted

    def save_trained_model(self, model: BaseAlgorithm) -> None:
        """Save the model, and take the mark of an unfinished run away.

        Raises:
            KeyboardInterrupt: if the training was interrupted. The model is saved, the mark stays, and how to go on is
                told.
            NotWritten: if the disk is full. The mark stays.
        """
        assert self._folder is not None  # for mypy: setup_experiment has made it
        print(f"Saving to {self.save_path}")
        try:
            with self._full_disk_told():
                self._save_agent(model)
            if self._is_interrupted:
                steps = f"{model.num_timesteps:,} of {self.n_timesteps:,} env steps"
                print(f"Interrupted at {steps}: {self._remedy()}")
                raise KeyboardInterrupt
            self._folder.finish()
        finally:
            self._folder.release()

    @contextmanager
    def _full_disk_told(self) -> Iterator[None]:
        """Tell where the disk was full, and how to go on, instead of the bare error of the block."""
        try:
            yield
        except OSError as error:
            if not is_full(error):
                raise
            raise not_written(self.save_path, error, f"free some space, then {self._remedy()}") from error

    def _remedy(self) -> str:
        """Say how to go on with this run."""
        run = Path(self.save_path)
        return _how_to_go_on(run) if (run / CHECKPOINT).is_file() else "train anew, for it saved no checkpoint"

    def _save_agent(self, model: BaseAlgorithm) -> None:
        """Save what rl_zoo3 saves, and the agent file, as whole files."""
        path = Path(self.save_path, f"{self.env_name}{AGENT_FILE}")
        with whole_files(self.save_path, "model") as part:
            model.save(part / f"{self.env_name}{SB3_FILE}")
            write_beside(model, part / path.name, path)
            if self.save_replay_buffer and isinstance(model, OffPolicyAlgorithm):
                model.save_replay_buffer(part / "replay_buffer.pkl")
        statistics = model.get_vec_normalize_env()
        if statistics is not None:
            with whole_file(Path(self.params_path, STATISTICS)) as file:
                statistics.save(str(file))


class BestBeside(BaseCallback):
    """Saves the agent file of the best model beside it, and VecNormalize's statistics, which will be others at the end.

    Args:
        run: the run's folder; a kill leaves the last files whole.
    """

    def __init__(self, run: Path) -> None:
        super().__init__()
        self.run = run

    def _on_step(self) -> bool:
        path = self.run / f"{OF_BEST}{AGENT_FILE}"
        write_beside(self.model, path, path)
        statistics = self.model.get_vec_normalize_env()
        if statistics is not None:
            with whole_file(self.run / OF_BEST / STATISTICS) as file:
                statistics.save(str(file))
        return True


class _StoppableModel:
    """A model as ``ExperimentManager.learn`` sees it. It notices an interrupt, of which rl_zoo3 tells nobody."""

    def __init__(self, model: BaseAlgorithm, is_resumed: bool) -> None:
        self.policy, self.env = model.policy, model.env
        self.is_interrupted = False
        self._model, self._is_resumed = model, is_resumed

    def learn(self, total_timesteps: int, **kwargs: Any) -> None:
        if self._is_resumed:
            total_timesteps = max(total_timesteps - self._model.num_timesteps, 0)
        try:
            self._model.learn(total_timesteps, reset_num_timesteps=not self._is_resumed, **kwargs)
        except KeyboardInterrupt:
            self.is_interrupted = True
            raise


def _how_to_go_on(run: Path) -> str:
    """Say how to go on with a run that has a checkpoint."""
    return f"go on by `{resuming_command(run)}`"

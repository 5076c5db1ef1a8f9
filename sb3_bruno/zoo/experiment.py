"""rl_zoo3's ExperimentManager, with each task's return evaluated and an exact resume."""

from __future__ import annotations

import math
import shutil
import sys
from pathlib import Path
from typing import Any, ClassVar

import gymnasium as gym
import rl_zoo3
import yaml
from rl_zoo3.exp_manager import ExperimentManager
from rl_zoo3.hyperparams_opt import HYPERPARAMS_CONVERTER
from rl_zoo3.utils import SimpleLinearSchedule
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from sb3_bruno.evaluation.eval_callback import TaskEvalCallback
from sb3_bruno.resume.checkpoint import ResumeCallback, resume
from sb3_bruno.runs.origin import save_origin
from sb3_bruno.zoo.configs import config_file, merged, read_configs
from sb3_bruno.zoo.held_out import FRESH, HeldOut, hold_out
from sb3_bruno.zoo.mistake import Mistake, mistake_of

CHECKPOINT = "checkpoint.pkl"
ENCODER_ARGUMENTS = {"encoder_class", "encoder_kwargs", "critic_input"}


class TaskExperiment(ExperimentManager):
    """One training run of rl_zoo3 that can be resumed exactly.

    Takes ExperimentManager's arguments. An environment that names its hidden task is evaluated on its test tasks in
    turn, and its monitor files carry the task of each episode.

    :cvar checkpoint_freq: env steps between checkpoints, 0 for none; ``train`` sets it
    :cvar folder: where to go on; None starts a new run
    :cvar has_started: whether an agent has begun to learn, so that what is raised is no mistake in the arguments
    """

    checkpoint_freq: ClassVar[int] = 25_000
    folder: ClassVar[Path | None] = None
    has_started: ClassVar[bool] = False

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        if self.folder is None:  # else it is the run's own
            kwargs["config"] = config_file(args[1], kwargs.get("config"))
        super().__init__(*args, **kwargs)
        self._held_out: HeldOut | None = None  # in a search
        self._is_new = self.folder is None and not Path(self.save_path).exists()
        if self.folder is not None:
            self.save_path = str(self.folder)
            self.params_path = f"{self.save_path}/{self.env_name}"

    def read_hyperparameters(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """As rl_zoo3, but of a dict in a YAML config, such as ``encoder_kwargs``, only the entries given are replaced.

        Those of a run that is resumed are its own, whatever the config says by now.
        """
        if self.folder is not None:
            saved: dict[str, Any] = yaml.unsafe_load(Path(self.params_path, "config.yml").read_text(encoding="utf-8"))
            return dict(saved), saved
        configs = read_configs(self.config)
        config = configs.get(self.env_name.gym_id, configs.get("default", {}))
        given = self.custom_hyperparams or {}
        if self.trial_id is not None:
            given = merged(self._drawn_in_trial(merged(config, given).get("n_envs", 1)), given)
        self.custom_hyperparams = {name: merged(config, given)[name] for name in given}
        read: tuple[dict[str, Any], dict[str, Any]] = super().read_hyperparameters()
        return read

    def _save_config(self, saved_hyperparams: dict[str, Any]) -> None:
        """As rl_zoo3; a run that is resumed has saved its config already."""
        if self.folder is None:
            super()._save_config(saved_hyperparams)

    def _drawn_in_trial(self, n_envs: int) -> dict[str, Any]:
        """The hyperparameters of the trial that ``--trial-id`` names, also of one that ``sweep`` made."""
        if self.storage is None or self.study_name is None:
            raise Mistake(f"--trial-id {self.trial_id} is of a study: give its --storage and --study-name")
        try:
            drawn = self.load_trial(self.storage, self.study_name, self.trial_id, convert=False)
            converted: dict[str, Any] = HYPERPARAMS_CONVERTER[self.algo]({**drawn, "n_envs": n_envs})
        except (KeyError, IndexError) as error:
            there = f"{self.study_name} in {self.storage}"
            raise Mistake(f"--trial-id {self.trial_id}: {there} has no such trial with all its draws") from error
        return converted

    @staticmethod
    def _preprocess_schedules(hyperparams: dict[str, Any]) -> dict[str, Any]:
        """As rl_zoo3, whose ``lin_1e-3`` the encoder's learning rate understands as well.

        The schedule is SB3's own, so that a saved agent loads where rl_zoo3 is not installed.
        """
        rate = hyperparams.get("encoder_learning_rate")
        if isinstance(rate, str):
            read = ExperimentManager._preprocess_schedules({"learning_rate": rate})
            hyperparams["encoder_learning_rate"] = read["learning_rate"]
        read = ExperimentManager._preprocess_schedules(hyperparams)
        return {
            name: LinearSchedule(value.initial_value, 0.0, 1.0) if isinstance(value, SimpleLinearSchedule) else value
            for name, value in read.items()
        }

    def _preprocess_action_noise(
        self, hyperparams: dict[str, Any], saved_hyperparams: dict[str, Any], env: VecEnv
    ) -> dict[str, Any]:
        """As rl_zoo3, whose search may draw that there is no noise, which it does not understand then."""
        if "noise_type" in hyperparams and hyperparams["noise_type"] is None:
            hyperparams = {name: one for name, one in hyperparams.items() if name not in ("noise_type", "noise_std")}
        without: dict[str, Any] = super()._preprocess_action_noise(hyperparams, saved_hyperparams, env)
        return without

    def setup_experiment(self) -> tuple[BaseAlgorithm, dict[str, Any]] | None:
        """As rl_zoo3; a run that is resumed gets the model of its checkpoint.

        What is raised is the user's to mend: all of it stands on config and command.
        """
        try:
            results = super().setup_experiment()
            if results is None:
                self._prepare_search()
                return None
            model, saved_hyperparams = results
            if self.folder is not None:
                model = self._resumed(model, self.folder)
        except Exception as error:
            if self._is_new:
                shutil.rmtree(self.save_path, ignore_errors=True)  # it holds no result
            if isinstance(error, Mistake):
                raise
            raise mistake_of(error) from error
        chosen = ["--seed", str(self.seed), "--checkpoint-freq", str(self.checkpoint_freq)]
        command = [*sys.argv[1:], *chosen]  # of a flag that is given twice the last one counts
        save_origin(Path(self.save_path), command)
        return model, saved_hyperparams

    def _resumed(self, model: BaseAlgorithm, folder: Path) -> BaseAlgorithm:
        """The model of the checkpoint in ``folder``, with the environments of ``model``."""
        assert model.env is not None  # for mypy
        model = resume(folder / CHECKPOINT, model.env, self.device)
        print(f"Going on at {model.num_timesteps:,} of {self.n_timesteps:,} env steps")
        for callback in self.callbacks:
            if isinstance(callback, TaskEvalCallback):
                callback.restore(model)
        return model

    def _prepare_search(self) -> None:
        """Trials are judged on held-out training tasks and fresh seeds; what is drawn goes over the config."""
        self._held_out = hold_out(self.env_name.gym_id, self.env_kwargs)
        self.env_kwargs = self._held_out.train
        self.n_eval_episodes = self._whole_cycles(self._held_out.n_tasks)
        self._hyperparams = _Config(self._hyperparams)

    def learn(self, model: BaseAlgorithm) -> None:
        """As rl_zoo3; a run that is resumed learns for the env steps that are left."""
        TaskExperiment.has_started = True
        super().learn(model if self.folder is None else _GoingOn(model))  # type: ignore[arg-type]  # all it asks

    def create_callbacks(self) -> None:
        """As rl_zoo3, with TaskEvalCallback where it has EvalCallback and the environment names its task."""
        super().create_callbacks()  # type: ignore[no-untyped-call]
        stock = self.callbacks[-1] if self.callbacks else None
        if isinstance(stock, EvalCallback) and self._names_its_task():
            self.callbacks[-1] = TaskEvalCallback(
                stock.eval_env,
                callback_on_new_best=stock.callback,
                best_model_save_path=self.save_path,
                n_eval_episodes=self._whole_cycles(self._n_test_tasks(stock.eval_env)),
                log_path=self.save_path,
                eval_freq=self.eval_freq,
                deterministic=self.deterministic_eval,
            )
        if self.checkpoint_freq > 0 and issubclass(rl_zoo3.ALGOS[self.algo], OffPolicyAlgorithm):
            self.callbacks.append(ResumeCallback(Path(self.save_path) / CHECKPOINT, self.checkpoint_freq))

    def create_envs(self, n_envs: int, eval_env: bool = False, no_log: bool = False) -> VecEnv:
        """As rl_zoo3; monitor files carry the task, and go on where a run is resumed."""
        if self._names_its_task():
            self.monitor_kwargs.setdefault("info_keywords", ("task_index", "task"))
        if self.folder is not None:
            self.monitor_kwargs["override_existing"] = False
        if eval_env and self._eval_env_kwargs_args is None:
            self.eval_env_kwargs = self._test_env_kwargs()
        fresh = FRESH if eval_env and self._held_out is not None else 0
        self.seed += fresh
        try:
            return super().create_envs(n_envs, eval_env, no_log)
        finally:
            self.seed -= fresh

    def _test_env_kwargs(self) -> dict[str, Any]:
        """The training environment's, config included; of our environments, with each test task in turn.

        In a search, with each held-out training task in turn.
        """
        if self._held_out is not None:
            return self._held_out.judge
        return {**self.env_kwargs, "split": "test", "draw": "cycle"} if self._is_ours() else self.env_kwargs

    def _n_test_tasks(self, eval_env: VecEnv) -> int:
        return len(eval_env.get_attr("task_distribution")[0].tasks("test")) if self._is_ours() else 1

    def _whole_cycles(self, n_tasks: int) -> int:
        """``n_eval_episodes``, rounded up until each environment goes through all its tasks every time."""
        n_a_cycle = n_tasks * self.n_eval_envs
        return n_a_cycle * math.ceil(self.n_eval_episodes / n_a_cycle)

    def _is_ours(self) -> bool:
        return self.entry_point(self.env_name.gym_id).startswith("sb3_bruno_envs")

    def _names_its_task(self) -> bool:
        env = gym.make(self.env_name.gym_id, **self.env_kwargs)
        try:
            return env.has_wrapper_attr("task_space")
        finally:
            env.close()

    def _load_pretrained_agent(self, hyperparams: dict[str, Any], env: VecEnv) -> BaseAlgorithm:
        """As rl_zoo3, which knows that a policy is not changed, and not that an encoder is not."""
        kept = {key: value for key, value in hyperparams.items() if key not in ENCODER_ARGUMENTS}
        model: BaseAlgorithm = super()._load_pretrained_agent(kept, env)
        return model


class _Config(dict[str, Any]):
    """Hyperparameters that a trial's go over as ``-params`` do, in the two calls that rl_zoo3 makes of its dict."""

    def copy(self) -> _Config:
        return _Config(self)

    def update(self, drawn: dict[str, Any]) -> None:  # type: ignore[override]  # all that is asked
        super().update(merged(self, drawn))


class _GoingOn:
    """What ``ExperimentManager.learn`` asks of a model, for one that has learned a part already."""

    def __init__(self, model: BaseAlgorithm) -> None:
        self._model = model
        self.env = model.env

    def learn(self, total_timesteps: int, **kwargs: Any) -> None:
        self._model.learn(max(total_timesteps - self._model.num_timesteps, 0), reset_num_timesteps=False, **kwargs)

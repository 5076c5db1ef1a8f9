"""One training run: rl_zoo3's ExperimentManager, plus configs of ours and evaluation task by task."""

from __future__ import annotations

import argparse
import math
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import rl_zoo3
from rl_zoo3.exp_manager import ExperimentManager
from rl_zoo3.hyperparams_opt import HYPERPARAMS_SAMPLER
from rl_zoo3.utils import SimpleLinearSchedule
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import EvalCallback
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv

from sb3_bruno.evaluation.eval_callback import TaskEvalCallback
from sb3_bruno.evaluation.resumable_eval import ResumableEvalCallback
from sb3_bruno.zoo.another_encoder import fitted_to_encoder
from sb3_bruno.zoo.configs import DEFAULT, config_file, find_config, merged, read_configs
from sb3_bruno.zoo.environments import EnvFacts, ask, in_turn
from sb3_bruno.zoo.fit import check_env, check_hyperparameters
from sb3_bruno.zoo.held_out import FRESH, HeldOut, hold_out
from sb3_bruno.zoo.kept_run import BestBeside, KeptRun, RunOptions
from sb3_bruno.zoo.merging import Merging
from sb3_bruno.zoo.one_line import in_one_line
from sb3_bruno.zoo.registry import sampler_of
from sb3_bruno.zoo.saved_yaml import read_saved
from sb3_bruno.zoo.search import begin_or_join
from sb3_bruno.zoo.seldom import SeldomTables
from sb3_bruno.zoo.storage import check_storage
from sb3_bruno.zoo.trial import drawn_in_trial

ENCODER_ARGUMENTS = {"encoder_class", "encoder_kwargs", "critic_input"}


class TaskExperiment(KeptRun):
    """Train an agent as rl_zoo3 does, on tasks, and so that the run can be resumed exactly.

    If the environment names its hidden task, evaluations go through its test tasks in turn, and the monitor files
    record the task of each episode.

    Args:
        args: the parsed command line, which rl_zoo3 saves with the run.
        algo: rl_zoo3's name of the algorithm.
        rest: further arguments of ExperimentManager, from ``env_id`` on.
        config: a config file, or the name of one of our folders of configs; None for our default.
        options: what ExperimentManager does not know of the run.
        kwargs: further arguments of ExperimentManager.
    """

    def __init__(
        self,
        args: argparse.Namespace,
        algo: str,
        *rest: Any,
        config: str | None = None,
        options: RunOptions | None = None,
        **kwargs: Any,
    ) -> None:
        options = options or RunOptions()
        if options.resume_from is None:  # a resumed run has its config in its folder
            config = config_file(algo, config)
        super().__init__(args, algo, *rest, options=options, **kwargs | {"config": config})
        self._held_out: HeldOut | None = None  # set in a search

    def read_hyperparameters(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Read the config, then merge what a trial drew and what ``-params`` says.

        rl_zoo3 replaces a whole dict such as ``encoder_kwargs``. Here only the entries that are given change. A resumed
        run uses the hyperparameters in its folder, even if the config has changed since.
        """
        if self._resume_from is not None:
            saved = read_saved(Path(self.params_path, "config.yml"))
            return dict(saved), saved
        configs = read_configs(self.config)
        config = find_config(configs, self.env_name.gym_id)
        if config is None and configs and not self._is_atari:
            raise ValueError(f"{self.config} has no {self.env_name.gym_id}: give another file by -conf")
        if config is not None and self.env_name.gym_id not in configs:
            print(f"{self.config} has no section of {self.env_name.gym_id}: taking the one called {DEFAULT}")
        config = config or {}
        given = self.custom_hyperparams or {}
        fitted = fitted_to_encoder(self.algo, config, given)
        if self.trial_id is not None:
            base = merged(fitted, given)
            drawn = drawn_in_trial(self.storage, self.study_name, self.trial_id, self.algo, base)
            given = merged(drawn, given)
        if configs and self.n_timesteps > 0 and "n_timesteps" not in config:
            given = {"n_timesteps": self.n_timesteps, **given}
        used = merged(fitted, given)
        changed = {name for name, value in fitted.items() if value != config.get(name)}
        self.custom_hyperparams = {name: used[name] for name in given.keys() | changed}
        try:
            read: tuple[dict[str, Any], dict[str, Any]] = super().read_hyperparameters()
        except Exception as error:  # a config that is a program may raise anything
            raise ValueError(f"-conf {self.config} cannot be read: {in_one_line(error)}: correct it") from error
        for hyperparams in read:  # rl_zoo3 has read the file itself, with what was left out of it
            for name in config.keys() - used.keys():
                del hyperparams[name]
        check_hyperparameters(self.algo, read[0])
        return read

    def load_trial(self, *args: Any, **kwargs: Any) -> dict[str, Any]:
        """Return nothing: what a trial drew is merged already, by the search space of the config's encoder."""
        return {}

    def _preprocess_hyperparams(self, hyperparams: dict[str, Any]) -> tuple[dict[str, Any], Any, list[Any], Any]:
        """Prepare the hyperparameters as rl_zoo3 does, and refuse an environment that the algorithm cannot learn in."""
        processed: tuple[dict[str, Any], Any, list[Any], Any] = super()._preprocess_hyperparams(hyperparams)
        self.env_wrapper = processed[1]
        check_env(self.algo, self.env_name.gym_id, self.env_kwargs, self.env_wrapper)
        return processed

    @staticmethod
    def _preprocess_schedules(hyperparams: dict[str, Any]) -> dict[str, Any]:
        """Turn ``lin_1e-3`` into a schedule, for ``encoder_learning_rate`` too.

        The schedules are SB3's rather than rl_zoo3's, so that a saved agent loads where rl_zoo3 is not installed.
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
        """Build the action noise. rl_zoo3's search may draw no noise, ``noise_type=None``: then leave it out."""
        if "noise_type" in hyperparams and hyperparams["noise_type"] is None:
            noise = ("noise_type", "noise_std")
            hyperparams = {name: value for name, value in hyperparams.items() if name not in noise}
        processed: dict[str, Any] = super()._preprocess_action_noise(hyperparams, saved_hyperparams, env)
        return processed

    def _set_up(self) -> tuple[BaseAlgorithm, dict[str, Any]] | None:
        if self.storage is not None:
            check_storage(self.storage)
        results = super()._set_up()
        if results is None:
            self._prepare_search()
        return results

    def _prepare_search(self) -> None:
        """Hold out training tasks to judge trials on, and let what a trial draws be merged into the config."""
        self._held_out = hold_out(self.env_name.gym_id, self.env_kwargs)
        self.env_kwargs = self._held_out.train
        self.n_eval_episodes = self._whole_cycles(self._held_out.n_tasks)
        self._hyperparams = Merging(self._hyperparams)
        if self.storage is not None and self.study_name is not None:
            begin_or_join(self.storage, self.study_name, self.algo, self.env_name.gym_id)

    def hyperparameters_optimization(self) -> None:
        """Search as rl_zoo3 does, in the space of the encoder that the config chooses."""
        stock = HYPERPARAMS_SAMPLER[self.algo]
        HYPERPARAMS_SAMPLER[self.algo] = sampler_of(self.algo, self._hyperparams)
        try:
            super().hyperparameters_optimization()
        finally:
            HYPERPARAMS_SAMPLER[self.algo] = stock

    def create_callbacks(self) -> None:
        """Create rl_zoo3's callbacks, TaskEvalCallback for an environment with a hidden task, and checkpoints."""
        super().create_callbacks()  # type: ignore[no-untyped-call]
        stock = self.callbacks[-1] if self.callbacks else None
        if isinstance(stock, EvalCallback):
            kind = TaskEvalCallback if self._facts.names_task else ResumableEvalCallback
            self.callbacks[-1] = kind(
                stock.eval_env,
                callback_on_new_best=BestBeside(Path(self.save_path)),
                best_model_save_path=self.save_path,
                n_eval_episodes=self._whole_cycles(max(len(self._facts.test_tasks), 1)),
                log_path=self.save_path,
                eval_freq=self.eval_freq,
                deterministic=self.deterministic_eval,
            )
        self.create_checkpoints(rl_zoo3.ALGOS[self.algo])
        if self.log_interval == -1:
            self.callbacks.append(SeldomTables(self.n_timesteps))

    def create_envs(self, n_envs: int, eval_env: bool = False, no_log: bool = False) -> VecEnv:
        """Create the environments, with the task in the monitor files.

        In a search, the environments that judge a trial get a seed of their own.
        """
        if self._facts.records_task:
            self.monitor_kwargs.setdefault("info_keywords", ("task_index", "task"))
        if eval_env and self._eval_env_kwargs_args is None:
            self.eval_env_kwargs = self._test_env_kwargs()
        fresh = FRESH if eval_env and self._held_out is not None else 0
        wrap = self.env_wrapper
        if eval_env and self._held_out is None and not self._facts.can_cycle and len(self._facts.test_tasks):
            self.env_wrapper = partial(in_turn, wrap=wrap, tasks=self._facts.test_tasks)
        self.seed += fresh
        try:
            return super().create_envs(n_envs, eval_env, no_log)
        finally:
            self.seed -= fresh
            self.env_wrapper = wrap

    def _test_env_kwargs(self) -> dict[str, Any]:
        """Return the keywords of the environments to evaluate in: the training ones, and which tasks to go through.

        They go through the test tasks, if these are listed, and in a search through the held-out training tasks.
        """
        if self._held_out is not None:
            return self._held_out.judge
        cycles = self._facts.can_cycle and len(self._facts.test_tasks)
        return {**self.env_kwargs, "split": "test", "draw": "cycle"} if cycles else self.env_kwargs

    @cached_property
    def _facts(self) -> EnvFacts:
        """What the environment says of its tasks."""
        return ask(self.env_name.gym_id, self.env_kwargs, self.env_wrapper)

    def _whole_cycles(self, n_tasks: int) -> int:
        """Round ``n_eval_episodes`` up, so that every evaluation env meets each of its tasks equally often.

        Example: 2 tasks in 3 environments make cycles of 6 episodes, so 10 episodes become 12.
        """
        cycle = n_tasks * self.n_eval_envs
        return cycle * math.ceil(self.n_eval_episodes / cycle)

    def _load_pretrained_agent(self, hyperparams: dict[str, Any], env: VecEnv) -> BaseAlgorithm:
        """Load the agent to train on. rl_zoo3 keeps the policy's arguments; keep the encoder's too."""
        kept = {key: value for key, value in hyperparams.items() if key not in ENCODER_ARGUMENTS}
        model: BaseAlgorithm = super()._load_pretrained_agent(kept, env)
        return model

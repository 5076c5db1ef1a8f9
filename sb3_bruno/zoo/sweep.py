"""The trials of a hyperparameter sweep: ordinary training runs, judged on training tasks held out from them.

A trial never sees the test tasks.
"""

from __future__ import annotations

import argparse
import copy
from typing import Any

import optuna
import rl_zoo3
from rl_zoo3.callbacks import TrialEvalCallback
from stable_baselines3 import HerReplayBuffer
from stable_baselines3.common.vec_env import VecEnv

from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.zoo.configs import merged
from sb3_bruno.zoo.experiment import TaskExperiment
from sb3_bruno.zoo.fit import check_hyperparameters
from sb3_bruno.zoo.plain_text import check_texts
from sb3_bruno.zoo.processes import this_process
from sb3_bruno.zoo.registry import check_registered, import_packages, sampler_of
from sb3_bruno.zoo.study import SweepSettings
from sb3_bruno.zoo.workers import OWNER


class SweepExperiment(TaskExperiment):
    """Train the agents of a study's trials.

    Args:
        settings: the study's.

    Raises:
        ValueError: if the environment is not registered, or a package that should register it cannot be imported; or
            if the config holds text that is more than plain values, or hyperparameters that cannot be.
    """

    def __init__(self, settings: SweepSettings) -> None:
        import_packages(settings.get("gym_packages", []))
        check_registered(settings["env"])
        check_texts(settings["config"])
        self._config = settings["config"]
        super().__init__(
            argparse.Namespace(),
            settings["algo"],
            settings["env"],
            "logs",
            n_timesteps=settings["n_timesteps"],
            optimize_hyperparameters=True,
            n_eval_episodes=10,
            n_evaluations=settings["n_evaluations"],
            seed=settings["seed"],
            verbose=0,
            device="cpu",
        )
        self.setup_experiment()

    def read_hyperparameters(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the study's hyperparameters, checked. The config files on a worker's machine may differ."""
        check_hyperparameters(self.algo, self._config)
        return copy.deepcopy(self._config), self._config

    def create_log_folder(self) -> None:
        """Create none: a trial leaves no folder."""

    def create_envs(self, n_envs: int, eval_env: bool = False, no_log: bool = False) -> VecEnv:
        """Create environments that write no monitor files."""
        return super().create_envs(n_envs, eval_env, no_log=True)

    def check(self) -> None:
        """Make a model once, so that a mistake shows before any worker starts. What it raises is raised as it is.

        Raises:
            ValueError: if a trial is too short for its evaluations.
        """
        most = self.n_timesteps // self.n_envs
        if self.n_evaluations > most:
            raise ValueError(
                f"--n-evaluations {self.n_evaluations}: a trial of -n {self.n_timesteps} has time for {most}, one per "
                f"step of {self.n_envs} environments: give fewer, or a larger -n"
            )
        env = self.create_envs(1)
        try:
            rl_zoo3.ALGOS[self.algo](env=env, device="cpu", **self._hyperparams)
        finally:
            env.close()

    def objective(self, trial: optuna.Trial) -> float:
        """Train with the drawn hyperparameters, and return the mean return of the last evaluation.

        An error fails the trial; rl_zoo3 would count it as pruned.
        """
        trial.set_user_attr(OWNER, this_process())
        drawn = sampler_of(self.algo, self._config)(trial, self.n_actions, self.n_envs, self._additional_args())
        env, eval_env = self.create_envs(self.n_envs), self.create_envs(1, eval_env=True)
        try:
            hyperparams = merged(self._hyperparams, drawn)
            algorithm = rl_zoo3.ALGOS[self.algo]
            if issubclass(algorithm, TaskInference):
                hyperparams = {"task_readout": False, **hyperparams}  # nobody reads it, and the agent is the same
            model = algorithm(env=env, seed=self.seed + trial.number, device="cpu", **hyperparams)
            evaluate = TrialEvalCallback(
                eval_env,
                trial,
                n_eval_episodes=self.n_eval_episodes,
                eval_freq=max(self.n_timesteps // self.n_evaluations // self.n_envs, 1),
            )
            model.learn(self.n_timesteps, evaluate)
        finally:
            env.close()
            eval_env.close()
        if evaluate.is_pruned:
            raise optuna.TrialPruned
        return float(evaluate.last_mean_reward)

    def _additional_args(self) -> dict[str, Any]:
        """Tell rl_zoo3's search spaces about the replay buffer, as they ask."""
        return {
            "using_her_replay_buffer": self._hyperparams.get("replay_buffer_class") is HerReplayBuffer,
            "her_kwargs": self._hyperparams.get("replay_buffer_kwargs", {}),
        }

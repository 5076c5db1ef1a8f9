"""Shows how many steps have been taken in environments, where rl_zoo3 takes them without a word."""

from __future__ import annotations

from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from sb3_bruno.evaluation.progress import progress


class ShownSteps(VecEnvWrapper):
    """Moves a progress bar with each step, where stderr is a terminal.

    Args:
        venv: the environments.
        total: how many steps will be taken in each.
    """

    def __init__(self, venv: VecEnv, total: int) -> None:
        super().__init__(venv)
        self._bar = progress(shown=True, total=total, about="steps")

    def reset(self) -> VecEnvObs:
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        self._bar.update()
        return self.venv.step_wait()

    def close(self) -> None:
        self._bar.close()
        super().close()

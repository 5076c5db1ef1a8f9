"""What the package is for: on a task that is hidden, plain SAC must fail and BrunoSAC succeed."""

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env

from sb3_bruno import BrunoSAC
from sb3_bruno.evaluation.adaptation import evaluate_adaptation
from sb3_bruno_envs import POINT_DIR_TASKS
from support.configs import settings_of, zoo_config

ENV_ID = "sb3_bruno_envs:PointDir-v0"
BEST = 30 * (1 - 0.05)  # thirty steps at full speed in the right direction
CONFIG = zoo_config("bruno_sac", "PointDir-v0")
N_TIMESTEPS = 2_000  # a third of the config's: enough to tell the two apart


def adaptation_of(model, observe):
    """What the agent does in both directions."""
    tasks = POINT_DIR_TASKS.tasks("test")
    return evaluate_adaptation(model, lambda: gym.make(ENV_ID, observe=observe), tasks, n_episodes=8)


@pytest.mark.slow
def test_brunosac_works_out_which_way_to_go_within_a_few_steps():
    env = make_vec_env(ENV_ID, CONFIG["n_envs"], seed=0)
    model = BrunoSAC(CONFIG["policy"], env, seed=0, **settings_of(CONFIG)).learn(N_TIMESTEPS)
    result = adaptation_of(model, "transition")
    assert min(result.mean_return()) > 0.6 * BEST
    assert result.steps_to_steady(window=1).max() <= 5


@pytest.mark.slow
def test_plain_sac_cannot_whatever_it_learns():
    """The task is nowhere in what SAC sees, so what it wins in one direction it loses in the other."""
    shared = {key: value for key, value in settings_of(CONFIG).items() if not key.startswith(("encoder", "replay"))}
    env = make_vec_env(ENV_ID, CONFIG["n_envs"], seed=0, env_kwargs={"observe": "plain"})
    model = SAC("MlpPolicy", env, seed=0, **shared).learn(N_TIMESTEPS)
    left, right = adaptation_of(model, "plain").mean_return()
    assert min(left, right) < 0.1 * BEST
    assert np.mean([left, right]) < 0.1 * BEST

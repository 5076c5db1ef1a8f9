"""What recurrent agents are for: where observations do not tell the state, SAC must fail and RecurrentSAC succeed."""

import gymnasium as gym
import pytest
from gymnasium.spaces import Box
from gymnasium.wrappers import TransformObservation
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy

from sb3_bruno import RecurrentSAC
from sb3_bruno.evaluation import evaluate_adaptation
from sb3_bruno_envs import POINT_DIR_TASKS, MetaTask, TransitionObservation
from support.configs import settings_of, zoo_config

SETTINGS = {
    "learning_rate": 1e-3,
    "learning_starts": 800,
    "batch_size": 128,
    "gradient_steps": 2,
    "gamma": 0.95,
    "policy_kwargs": {"net_arch": [64, 64]},
    "seed": 0,
    "device": "cpu",
}


def swing_up(shown):
    """Pendulum that shows its angular velocity alone, with episodes of 100 steps. Who sees the angle returns -130."""
    env = gym.make("Pendulum-v1", max_episode_steps=100)
    env = TransformObservation(env, lambda observation: observation[2:], Box(-8.0, 8.0, (1,)))
    return TransitionObservation(MetaTask(env)) if shown else env


def mean_return(algorithm, shown, n_timesteps, **kwargs):
    env, test = (make_vec_env(swing_up, n, seed=n, env_kwargs={"shown": shown}) for n in (4, 20))
    model = algorithm("MlpPolicy", env, **SETTINGS, **kwargs).learn(n_timesteps)
    return evaluate_policy(model, test, n_eval_episodes=20)[0]


@pytest.mark.slow
def test_recurrent_sac_swings_up_a_pendulum_whose_angle_is_hidden():
    kwargs = {"encoder_kwargs": {"cell": "lstm"}, "encoder_learning_rate": 1e-3}
    assert mean_return(RecurrentSAC, True, 8_000, **kwargs) > -400


@pytest.mark.slow
def test_plain_sac_cannot():
    assert mean_return(SAC, False, 8_000) < -550


@pytest.mark.slow
def test_recurrent_sac_works_out_which_way_to_go():
    config, env_id = zoo_config("recurrent_sac", "PointDir-v0"), "sb3_bruno_envs:PointDir-v0"
    env = make_vec_env(env_id, config["n_envs"], seed=0)
    model = RecurrentSAC(config["policy"], env, seed=0, **settings_of(config)).learn(3_000)  # half of the config's
    tasks = POINT_DIR_TASKS.tasks("test")
    returns = evaluate_adaptation(model, lambda: gym.make(env_id), tasks, n_episodes=8).mean_return()
    assert min(returns) > 0.6 * 28.5  # of what an agent that is told earns

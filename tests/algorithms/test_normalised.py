"""VecNormalize scales what an agent observes, but not the flag that says where episodes begin."""

import numpy as np
import pytest
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize, sync_envs_normalization

from sb3_bruno import BrunoSAC
from support.tiny_models import POINT, TRIAL, tiny


def make_env(env=POINT, **kwargs):
    return VecNormalize(make_vec_env(env, 2, seed=0), **kwargs)


@pytest.fixture(scope="module")
def model():
    return BrunoSAC("MlpPolicy", make_env(), **tiny(BrunoSAC)).learn(60)


def flags(env, n_steps):
    """The flags of the first environment at a reset and after each step."""
    seen = [env.reset()["episode_start"][0, 0]]
    for _ in range(n_steps):
        seen.append(env.step(np.zeros((2, 2), np.float32))[0]["episode_start"][0, 0])
    return np.array(seen).tolist()


def test_the_flag_stays_as_it_is_and_all_else_is_scaled(model):
    env = model.get_env()
    assert flags(env, 31) == [1.0, *[0.0] * 29, 1.0, 0.0]
    assert env.obs_rms["reward"].count > 60 and env.obs_rms["reward"].var != 1.0


def test_so_it_does_in_an_evaluation_and_in_statistics_that_were_saved(model, tmp_path):
    evaluation = make_env(training=False, norm_reward=False)
    sync_envs_normalization(model.get_env(), evaluation)
    assert flags(evaluation, 2) == [1.0, 0.0, 0.0]
    model.get_env().save(str(tmp_path / "statistics.pkl"))
    loaded = VecNormalize.load(str(tmp_path / "statistics.pkl"), make_vec_env(POINT, 2))
    assert flags(loaded, 31) == [1.0, *[0.0] * 29, 1.0, 0.0]


@pytest.mark.parametrize(
    "kwargs", [{}, {"epsilon": 0.1}, {"clip_obs": 5.0}, {"norm_obs": False}, {"norm_obs_keys": ["reward"]}], ids=str
)
def test_it_does_beneath_other_wrappers_and_within_trials(kwargs):
    env = VecMonitor(make_env(TRIAL, **kwargs))
    BrunoSAC("MlpPolicy", env, **tiny(BrunoSAC))
    assert sorted(set(flags(env, 61))) == [0.0, 0.5, 1.0]


def test_statistics_of_an_earlier_version_are_mended_where_a_model_gets_them(model):
    env = make_env()
    env.obs_rms["episode_start"] = RunningMeanStd(shape=(1,))
    flags(env, 40)
    assert 1.0 not in flags(env, 3)
    model.set_env(env)
    assert flags(env, 2) == [1.0, 0.0, 0.0]


def test_a_state_kept_over_a_reset_is_warned_of_with_normalisation_too(model):
    env = make_env()
    model.set_env(env)
    observation, state = env.reset(), None
    for _ in range(30):
        action, state = model.predict(observation, state)
        observation, *_ = env.step(action)
    with pytest.warns(UserWarning, match=r"`state` from before the env's reset.*pass `episode_start=True`"):
        model.predict(observation, state)

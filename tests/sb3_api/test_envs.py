"""Envs are exchanged, normalised and left in mid-episode, and the belief in the buffer is that of the rollout."""

import warnings
from copy import deepcopy

import gymnasium as gym
import numpy as np
import pytest
import torch as th
from stable_baselines3.common.callbacks import (
    BaseCallback,
    EvalCallback,
)
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno import BrunoSAC, BrunoTQC, PearlSAC, RecurrentSAC, Transitions
from support.tiny_models import (
    BRUNO,
    POINT,
    TRIAL,
    assert_carries,
    assert_close,
    assert_same,
    for_each,
    for_each_in_turn,
    make_pendulum,
    n_absorbed,
    normalized,
    takes,
)


def test_envs_are_exchanged_for_their_like_only(make_model):
    model = make_model().learn(50)
    model.set_env(make_vec_env(POINT, 1, env_kwargs={"split": "test"}))
    assert model._last_obs is None
    model.learn(50, reset_num_timesteps=False)
    assert model.num_timesteps == 100
    model.set_env(model.get_env(), force_reset=False)
    assert model._last_obs is not None
    with pytest.raises(ValueError, match="task_space"):
        model.set_env(make_pendulum())
    with pytest.raises(ValueError, match="task_space"):
        model.set_env(gym.make("Pendulum-v1"))
    with pytest.raises(AssertionError):
        model.set_env(make_vec_env(POINT, 2))


def test_a_loaded_model_takes_another_number_of_envs(algorithm, make_model, tmp_path):
    make_model().learn(50).save(tmp_path / "model")
    model = algorithm.load(tmp_path / "model", env=make_vec_env(POINT, 2))
    model.learn(100)
    assert model.replay_buffer.actions.shape[1] == 2


def test_a_loaded_model_goes_on_in_the_middle_of_an_episode(algorithm, make_model, tmp_path):
    model = make_model().learn(50)
    model.save(tmp_path / "model")
    loaded = algorithm.load(tmp_path / "model", env=model.get_env(), force_reset=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        loaded.learn(50, reset_num_timesteps=False)
    assert loaded.num_timesteps == 100


def test_a_model_is_not_loaded_on_another_family(algorithm, make_model, tmp_path):
    make_model().save(tmp_path / "model")
    with pytest.raises(ValueError, match="Observation spaces do not match"):
        algorithm.load(tmp_path / "model", env=make_pendulum())


KEYS = [["observation"], ["observation", "reward"], None]  # None: SB3's default, all of them


@for_each_in_turn("keys", KEYS)
def test_vec_normalize_is_saved_and_synchronised(algorithm, make_model, tmp_path, keys):
    env, eval_env = normalized(norm_obs_keys=keys), normalized(norm_obs_keys=keys, training=False)
    model = make_model(env)
    assert model.get_vec_normalize_env() is env
    model.learn(80, EvalCallback(eval_env, eval_freq=40, n_eval_episodes=1, verbose=0))
    assert_same(env.obs_rms["observation"].mean, eval_env.obs_rms["observation"].mean)
    model.save(tmp_path / "model")
    env.save(tmp_path / "normalize")
    renewed = VecNormalize.load(tmp_path / "normalize", DummyVecEnv([make_pendulum]))
    algorithm.load(tmp_path / "model", env=renewed).learn(50)
    model.set_env(eval_env)
    assert model.get_vec_normalize_env() is eval_env


@for_each([BrunoSAC])
@pytest.mark.parametrize("options", [*({"norm_obs_keys": keys} for keys in KEYS), {"norm_obs": False}], ids=str)
def test_a_belief_carried_through_predict_is_that_of_the_transitions(make_model, options):
    env = normalized(**options)
    model = make_model(env, encoder_kwargs={"modelled": "rewards"}).learn(60)
    env.training = False
    rows, observation, state, start = [], env.reset(), None, np.ones(1)
    for _ in range(10):
        before = env.get_original_obs()["observation"]
        action, state = model.predict(observation, state, start)
        observation, _, start, _ = env.step(action)
        rows.append((before, action, env.get_original_reward()[:, None], env.get_original_obs()["observation"]))
    _, state = model.predict(observation, state, start)
    transitions = Transitions(*(np.stack(part, axis=1) for part in zip(*rows, strict=True)))
    carried, inferred = model.belief(state), model.infer(transitions)
    np.testing.assert_allclose(carried.mean, inferred.mean, atol=1e-4)
    np.testing.assert_allclose(carried.var, inferred.var, atol=1e-4)
    assert np.abs(carried.mean).max() > 0.01  # it is not the prior


class Watch(BaseCallback):
    """Keeps, of every step, whether it began an episode, what the agent saw, and the state in which it acted."""

    def __init__(self):
        super().__init__()
        self.steps = []

    def _on_step(self):
        model = self.model
        self.steps.append(deepcopy((model._last_episode_starts, model._last_obs, model._next_carried)))
        return True


@for_each_in_turn("env_id", [POINT, TRIAL])
def test_beliefs_in_the_buffer_are_those_of_the_rollout_at_every_step(make_model, env_id):
    options = {"replay_buffer_kwargs": {"context": "episode"}, "learning_starts": 1_000}
    watch, model = Watch(), make_model(make_vec_env(env_id, 2, seed=0), **options)
    model.learn(2 * 130, watch)  # every env has finished two trials, and is in the first episode of its third
    layout, encoder = model.policy.layout, model.encoder
    begins, shown, states = zip(*watch.steps, strict=True)
    with th.no_grad():
        beliefs = [encoder.belief(carried.memory).numpy() for carried in states]
    step_of = {seen["observation"][env].tobytes(): (step, env) for step, seen in enumerate(shown) for env in (0, 1)}
    met, inner_ends = set(), 0
    for _ in range(60):
        samples = model.replay_buffer.sample(64)
        departures, arrivals = samples.observations.detach().numpy(), samples.next_observations.numpy()
        for here, there in zip(departures, arrivals, strict=True):
            step, env = step_of[here[layout.observation].tobytes()]
            met.add((step, env))
            np.testing.assert_allclose(here[layout.belief], beliefs[step][env], rtol=1e-4, atol=1e-5)
            if step == 129 or begins[step + 1][env]:
                continue
            np.testing.assert_allclose(there[layout.belief], beliefs[step + 1][env], rtol=1e-4, atol=1e-5)
            inner_ends += bool(shown[step + 1]["episode_start"][env])
            np.testing.assert_array_equal(there[layout.observation], shown[step + 1]["observation"][env])
    assert len(met) > 200
    assert (inner_ends > 0) == (env_id == TRIAL)


@for_each([BrunoSAC, RecurrentSAC, PearlSAC])
@pytest.mark.parametrize("n_steps", [20, 21, 47])  # an inner episode ends with the last transition, before it, long ago
def test_the_running_trial_is_encoded_again_as_the_agent_would_see_it(algorithm, make_model, n_steps):
    often = {"encoder_update_ratio": 1}
    often = often if takes(algorithm, often) else {}
    watch, model = Watch(), make_model(make_vec_env(TRIAL, 2, seed=0), learning_starts=10, **often)
    model.learn(2 * n_steps, watch)
    assert model._n_encoder_updates > 0
    state = None
    for begins, seen, _ in watch.steps:
        _, state = model.policy.extend(seen, state, begins)
    assert_carries(model, [n_steps] * 2)
    if algorithm in BRUNO:  # whose memory counts
        assert n_absorbed(model, state.memory) == [n_steps - 1 - (n_steps - 1) // 20] * 2
    assert_close(model._carried.memory, state.memory)


@for_each([BrunoTQC])
def test_no_transitions_give_the_prior(trained):
    nothing = Transitions(*(np.zeros((2, 0, dim)) for dim in (3, 1, 1, 3)))
    prior = trained.infer(nothing)
    assert prior.mean.shape == (2, 6)  # three weights for the reward, three for next observations
    np.testing.assert_array_equal(prior.mean, 0)
    _, state = trained.predict(make_pendulum().reset(seed=0)[0])
    assert_same(trained.belief(state).var, prior.var[:1])

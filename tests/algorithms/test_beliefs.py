"""Beliefs and predictions for people: in the env's own units, equal to what the agent carries."""

import gymnasium as gym
import numpy as np
import pytest
import torch as th
import zuko
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno import BrunoSAC, Transitions
from sb3_bruno_envs import MetaTask, TransitionObservation

SMALL = {"flow_class": zuko.flows.MAF, "flow_kwargs": {"transforms": 2, "hidden_features": (16,)}, "net_arch": (16,)}


def pendulum():
    """Actions in [-2, 2]: another scale than the encoder's."""
    return TransitionObservation(MetaTask(gym.make("Pendulum-v1")))


def make_model(normalize, **encoder_kwargs):
    env = DummyVecEnv([pendulum])
    env = VecNormalize(env) if normalize else env
    settings = {"learning_starts": 50, "batch_size": 16, "policy_kwargs": {"net_arch": [16]}}
    model = BrunoSAC("MlpPolicy", env, seed=0, encoder_kwargs={**SMALL, **encoder_kwargs}, **settings)
    return model.learn(80)


@pytest.mark.parametrize("normalize", [False, True])
def test_infer_equals_the_belief_that_the_agent_carries(normalize):
    model = make_model(normalize)
    env, seen = pendulum(), []
    observation, _ = env.reset(seed=1)
    state, action, rng = None, None, np.random.default_rng(0)
    for _ in range(15):
        normalizer = model.get_vec_normalize_env()
        shown = normalizer.normalize_obs(observation) if normalize else observation
        _, state = model.predict(shown, state, deterministic=True)
        action = rng.uniform(-2, 2, size=1).astype(np.float32)
        before = observation["observation"]
        observation, reward, *_ = env.step(action)
        seen.append((before, action, [reward], observation["observation"]))
    history = Transitions(*map(np.array, zip(*seen[:-1], strict=True)))
    carried, inferred = model.belief(state), model.infer(history)
    np.testing.assert_allclose(inferred.mean, carried.mean[0], rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(inferred.var, carried.var[0], rtol=1e-4)
    order = rng.permutation(14)
    shuffled = model.infer(Transitions(*(column[order] for column in history)))
    np.testing.assert_allclose(shuffled.mean, inferred.mean, rtol=1e-4, atol=1e-6)


def test_no_transitions_give_the_prior():
    model = make_model(False)
    belief = model.infer(Transitions(np.zeros((0, 3)), np.zeros((0, 1)), np.zeros((0, 1)), np.zeros((0, 3))))
    np.testing.assert_allclose(belief.mean, 0)
    np.testing.assert_allclose(belief.var, 1, rtol=1e-5)
    of_no_envs = model.infer(Transitions(*(np.zeros((0, 6, dim)) for dim in (3, 1, 1, 3))))
    assert of_no_envs.mean.shape == (0, *belief.mean.shape)


def test_batches_of_sets():
    model = make_model(False)
    rng = np.random.default_rng(0)
    sets = Transitions(*(rng.normal(size=(4, 6, dim)) for dim in (3, 1, 1, 3)))
    belief = model.infer(sets)
    assert belief.mean.shape == (4, model.encoder.model.latent_dim)
    alone = model.infer(Transitions(*(column[2] for column in sets)))
    np.testing.assert_allclose(belief.mean[2], alone.mean, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("normalize", [False, True])
def test_outcomes_come_in_the_envs_own_units(normalize):
    """An encoder that knows nothing predicts a standard normal reward, and a change as much, in what the agent sees."""
    model = make_model(normalize, modelled="both", process="gaussian", condition_on_next=False)
    for parameter in model.encoder.model.flow.parameters():
        parameter.data.zero_()  # the identity
    variables = model.encoder.model.variables
    for standardize in (variables.rewards, variables.changes):
        standardize.mean.zero_()
        standardize.var.fill_(1.0)
    model.encoder.process.log_var.data.zero_()
    belief = model.infer(Transitions(np.zeros((0, 3)), np.zeros((0, 1)), np.zeros((0, 1)), np.zeros((0, 3))))
    outcomes = model.predict_outcomes(belief, np.zeros(3), np.zeros(1), n_samples=20_000)
    means, variances = {"observation": 0.0, "reward": 0.0}, {"observation": 1.0, "reward": 1.0}
    if normalize:
        for key, statistics in model.get_vec_normalize_env().obs_rms.items():
            means[key], variances[key] = statistics.mean, statistics.var
    means["observation"] = 0.0  # the observation at which it was asked
    for key, samples in (("reward", outcomes.rewards), ("observation", outcomes.next_observations)):
        scale = np.sqrt(variances[key])
        np.testing.assert_allclose((samples.cpu().numpy().mean(axis=0) - means[key]) / scale, 0, atol=0.05)
        np.testing.assert_allclose(samples.cpu().numpy().std(axis=0) / scale, 1, rtol=0.05)
    assert outcomes.mean().rewards.shape == outcomes.quantile(0.9).rewards.shape == (1,)


@pytest.mark.parametrize("normalize", [False, True])
def test_moments_come_in_the_envs_own_units(normalize):
    model = make_model(normalize, flow_class=None, flow_kwargs=None)
    rng = np.random.default_rng(0)
    belief = model.infer(Transitions(*(rng.normal(size=(4, 6, dim)) for dim in (3, 1, 1, 3))))
    here, action, there = (rng.normal(size=(4, dim)) for dim in (3, 1, 3))
    for known in (None, there):
        mean, std = model.predict_moments(belief, here, action, known)
        samples = model.predict_outcomes(belief, here, action, known, n_samples=20_000)
        drawn = samples.next_observations
        assert (mean.rewards is None) == (known is None)
        np.testing.assert_allclose((mean.next_observations - drawn.mean(dim=0)) / drawn.std(dim=0), 0, atol=0.05)
        np.testing.assert_allclose(std.next_observations / drawn.std(dim=0), 1, rtol=0.05)
    np.testing.assert_allclose((mean.rewards - samples.rewards.mean(dim=0)) / samples.rewards.std(dim=0), 0, atol=0.05)
    np.testing.assert_allclose(std.rewards / samples.rewards.std(dim=0), 1, rtol=0.05)
    with pytest.raises(ValueError, match="`actions`"):
        model.predict_moments(belief, here, np.full((4, 1), np.nan))


@pytest.mark.parametrize("normalize", [False, True])
def test_standard_deviations_keep_their_digits_far_from_zero(normalize):
    model = make_model(normalize, flow_class=None, flow_kwargs=None)
    unit = np.ones(3)
    if normalize:
        statistics = model.get_vec_normalize_env().obs_rms["observation"]
        statistics.mean, unit = np.full(3, 5e4), np.sqrt(statistics.var + model.get_vec_normalize_env().epsilon)
    rng = np.random.default_rng(0)
    belief = model.infer(Transitions(*(5e4 * (dim == 3) + rng.normal(size=(4, 6, dim)) for dim in (3, 1, 1, 3))))
    here, action = 5e4 + rng.normal(size=(4, 3)), rng.normal(size=(4, 1))
    found = model.predict_moments(belief, here, action).std.next_observations
    asked = model._view._ask(belief, here, action, None)
    with th.no_grad():
        truth = model.encoder.moments(*asked).std.next_observations.numpy()
    np.testing.assert_allclose(found, truth * unit, rtol=1e-6)


def test_candidate_tasks_are_probable_as_their_likelihood_and_their_prior_say():
    env = make_vec_env("sb3_bruno_envs:PointDir-v0", 2, seed=0)
    model = BrunoSAC("MlpPolicy", env, seed=0, learning_starts=50, policy_kwargs={"net_arch": [16]}).learn(80)
    rng = np.random.default_rng(0)
    sets = Transitions(*(rng.normal(size=(3, 6, dim)) for dim in (2, 2, 1, 2)))
    belief, candidates = model.infer(sets), rng.uniform(-1, 1, size=(5, 2))
    found = model.task_probabilities(belief, candidates)
    assert found.shape == (3, 5)
    np.testing.assert_allclose(found.sum(axis=-1), 1, rtol=1e-6)
    log_prior = rng.normal(size=5)
    weighted = found * np.exp(log_prior)
    expected = weighted / weighted.sum(axis=-1, keepdims=True)
    np.testing.assert_allclose(model.task_probabilities(belief, candidates, log_prior), expected, rtol=1e-4)
    nothing = model.infer(Transitions(*(column[0, :0] for column in sets)))
    np.testing.assert_allclose(model.task_probabilities(nothing, candidates), 0.2, rtol=1e-5)
    for bad, named in (
        ({"tasks": candidates[:, :1]}, r"`tasks` has shape \(5, 1\): give candidates of shape \(1 or more, 2\)"),
        ({"tasks": candidates[:0]}, r"`tasks` has shape \(0, 2\): give candidates of shape \(1 or more, 2\)"),
        (
            {"tasks": candidates, "log_prior": np.zeros(4)},
            r"`log_prior` has shape \(4,\): give one for each task, \(5,\)",
        ),
    ):
        with pytest.raises(ValueError, match=named):
            model.task_probabilities(belief, **bad)

"""What SB3's critics and actors compute for nothing is left out, and all else stays: to the bit, or to its rounding."""

import copy

import numpy as np
import pytest
import torch as th
from gymnasium import spaces
from sb3_contrib.crossq.policies import CrossQCritic
from sb3_contrib.tqc.policies import Critic as TQCCritic
from stable_baselines3.common.distributions import SquashedDiagGaussianDistribution
from stable_baselines3.common.policies import ContinuousCritic
from stable_baselines3.common.torch_layers import FlattenExtractor

from sb3_bruno import BrunoSAC, BrunoTD3
from sb3_bruno.algorithms.crossq import TaskCrossQCritic
from sb3_bruno.algorithms.lean_networks import LeanContinuousCritic, LeanSquashedGaussian
from sb3_bruno.algorithms.tqc import TaskTQCCritic
from support.tiny_models import ALGORITHMS, POINT, tiny

PAIRS = [(LeanContinuousCritic, ContinuousCritic), (TaskTQCCritic, TQCCritic), (TaskCrossQCritic, CrossQCritic)]
CALLS = [(lean, theirs, "__call__") for lean, theirs in PAIRS] + [(*PAIRS[0], "q1_forward")]
BATCH = 40


def critics_of(lean, theirs):
    """The same critics twice, in training mode."""
    space = spaces.Box(-1, 1, (5,), np.float32)
    actions = spaces.Box(-1, 1, (2,), np.float32)
    th.manual_seed(0)
    made = lean(space, actions, [32, 32], FlattenExtractor(space), 5, share_features_extractor=False)
    other = theirs(space, actions, [32, 32], FlattenExtractor(space), 5, share_features_extractor=False)
    other.load_state_dict(made.state_dict())
    return made, other


def learn(critic, call, acts):
    """Differentiate a loss by observations, by what the actions come from if the actor acts, and by the weights."""
    generator = th.Generator().manual_seed(1)
    observations = th.randn(BATCH, 5, generator=generator).requires_grad_()
    origin = th.randn(BATCH, 2, generator=generator).requires_grad_(acts)
    found = getattr(critic, call)(observations, th.tanh(origin))
    values = th.cat(found, dim=-1) if isinstance(found, tuple) else found
    values.sin().sum().backward()
    weights = [parameter.grad for parameter in critic.parameters()]
    return [values, observations.grad, origin.grad], weights, [buffer.clone() for buffer in critic.buffers()]


def assert_equal(found, expected):
    for ours, theirs in zip(found, expected, strict=True):
        assert (ours is None and theirs is None) or th.equal(ours, theirs)


@pytest.mark.parametrize(("lean", "theirs", "call"), CALLS, ids=lambda value: getattr(value, "__name__", value))
def test_the_actors_gradient_is_the_same_to_the_bit_and_no_weights_have_one(lean, theirs, call):
    ours, other = critics_of(lean, theirs)
    (data, weights, buffers), (data_too, _, buffers_too) = learn(ours, call, True), learn(other, call, True)
    assert_equal(data + buffers, data_too + buffers_too)
    assert weights == [None] * len(weights)
    assert all(parameter.requires_grad for parameter in ours.parameters())


@pytest.mark.parametrize(("lean", "theirs"), PAIRS, ids=lambda value: value.__name__)
def test_the_critics_own_gradient_stays_as_it_is(lean, theirs):
    ours, other = critics_of(lean, theirs)
    for found, expected in zip(learn(ours, "__call__", False), learn(other, "__call__", False), strict=True):
        assert_equal(found, expected)


def test_weights_learn_again_after_an_error_and_frozen_ones_stay_frozen():
    critic, _ = critics_of(*PAIRS[0])
    frozen = next(critic.parameters()).requires_grad_(False)
    with pytest.raises(RuntimeError):
        critic(th.zeros(3, 4), th.zeros(3, 2, requires_grad=True))
    assert [parameter for parameter in critic.parameters() if not parameter.requires_grad] == [frozen]


@pytest.mark.parametrize("algorithm", ALGORITHMS, ids=lambda algorithm: algorithm.__name__)
def test_every_algorithm_has_them(algorithm):
    policy = algorithm("MlpPolicy", POINT, **tiny(algorithm)).policy
    assert type(policy.critic) in {lean for lean, _ in PAIRS}
    assert algorithm is BrunoTD3 or type(policy.actor.action_dist) is LeanSquashedGaussian


@pytest.mark.parametrize("learns_from", ["critic", "actor"])
def test_an_encoder_learns_from_actor_or_critics_as_with_sb3s_critics(learns_from):
    from sb3_bruno import RecurrentSAC

    model = RecurrentSAC("MlpPolicy", POINT, **tiny(RecurrentSAC, encoder_kwargs={"learns_from": learns_from}))
    model.learn(60)
    other = copy.deepcopy(model)
    for critic in (other.policy.critic, other.policy.critic_target):
        critic.forward = ContinuousCritic.forward.__get__(critic)
    other.bind_buffer()
    other.replay_buffer.rng = copy.deepcopy(model.replay_buffer.rng)
    for each in (model, other):
        th.manual_seed(0)
        each.train(2, 16)
    assert_equal(model.policy.state_dict().values(), other.policy.state_dict().values())


def scored(distribution, dtype):
    """Actions, log-densities, and the gradient of both by mean and log_std; noise of a fixed seed."""
    generator = th.Generator().manual_seed(0)
    mean = th.randn(500, 3, generator=generator, dtype=dtype).requires_grad_()
    log_std = (th.randn(500, 3, generator=generator, dtype=dtype) - 1).requires_grad_()
    th.manual_seed(3)
    actions, log_prob = distribution.log_prob_from_params(mean, log_std)
    gradient = th.autograd.grad((log_prob.sin() + actions.sum(dim=1)).sum(), (mean, log_std))
    return actions, log_prob, *gradient


def test_samples_are_sb3s_to_the_bit_and_their_densities_to_rounding():
    ours, theirs = LeanSquashedGaussian(3), SquashedDiagGaussianDistribution(3)
    found, expected = scored(ours, th.float32), scored(theirs, th.float32)
    assert th.equal(found[0], expected[0])
    th.testing.assert_close(found[1], expected[1], rtol=1e-6, atol=2e-6)
    for exact, rounded in zip(scored(theirs, th.float64), scored(ours, th.float64), strict=True):
        th.testing.assert_close(rounded, exact, rtol=1e-9, atol=1e-9)


def test_the_rest_of_sb3s_interface_is_there():
    mean, log_std = th.randn(4, 3), th.randn(4, 3)
    ours, theirs = LeanSquashedGaussian(3), SquashedDiagGaussianDistribution(3)
    for deterministic in (True, False):
        found = []
        for distribution in (ours, theirs):
            th.manual_seed(0)
            actions = distribution.actions_from_params(mean, log_std, deterministic=deterministic)
            found.append((actions, distribution.log_prob(actions), distribution.gaussian_actions))
        assert_equal(*found)
    assert_equal((ours.distribution.mean, ours.distribution.stddev), (mean, log_std.exp()))


@pytest.mark.parametrize("deterministic", [True, False])
@pytest.mark.parametrize("algorithm", [BrunoSAC, BrunoTD3])
def test_an_actor_that_diverged_is_told_as_that(algorithm, deterministic):
    model = algorithm("MlpPolicy", POINT, **tiny(algorithm))
    with th.no_grad():
        next(model.policy.actor.parameters()).fill_(th.nan)
    with pytest.raises(ValueError, match="diverged"):
        model.predict(model.get_env().reset(), deterministic=deterministic)
    with pytest.raises(ValueError, match="diverged"):
        model.learn(60)


@pytest.mark.parametrize("fused", [True, False])
def test_the_entropy_coefficients_optimizer_is_fused_where_the_policys_is(fused, tmp_path):
    policy_kwargs = {"optimizer_kwargs": {"fused": fused}}
    model = BrunoSAC("MlpPolicy", POINT, **tiny(BrunoSAC, policy_kwargs=policy_kwargs)).learn(45)
    model.save(tmp_path / "model.zip")
    for each in (model, BrunoSAC.load(tmp_path / "model.zip")):
        (group,) = each.ent_coef_optimizer.param_groups
        assert bool(group["fused"]) == fused and group["params"] == [each.log_ent_coef]
    assert BrunoSAC("MlpPolicy", POINT, **tiny(BrunoSAC, ent_coef=0.1)).ent_coef_optimizer is None

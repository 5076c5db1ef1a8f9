"""PEARL's product of Gaussians: by hand, its KL by Monte Carlo, and what is drawn, kept and held of z."""

import numpy as np
import pytest
import torch as th
from torch.distributions import Normal, kl_divergence

from sb3_bruno.encoders import ProductOfGaussians, TaskSequences, Transitions
from sb3_bruno.encoders.base import map_memory
from support.small_encoder import transitions_of


def make(**kwargs):
    th.manual_seed(0)
    encoder = ProductOfGaussians(3, 2, latent_dim=4, net_arch=(16,), **kwargs).double()
    for parameter in encoder.network[-1].parameters():  # as if it had learned to tell transitions apart
        th.nn.init.uniform_(parameter, -1.0, 1.0)
    return encoder


def at(memory, index):
    return map_memory(lambda prefixes: prefixes[..., index, :], memory)


def factors(encoder, transitions):
    """Means and variances of the transitions, as numpy arrays (..., latent_dim)."""
    mean, spread = np.split(encoder.network(th.cat(transitions, dim=-1)).detach().numpy(), 2, axis=-1)
    return mean, np.log1p(np.exp(spread))


@pytest.mark.parametrize("prior_factor", [True, False])
def test_the_posterior_is_the_product_of_the_densities_on_a_grid(prior_factor):
    encoder, transitions = make(prior_factor=prior_factor), transitions_of(5)
    z = np.linspace(-20, 20, 200_001)
    means, variances = factors(encoder, transitions)
    posterior = encoder.posterior(at(encoder.prefixes(transitions), -1))
    for d in range(4):
        log_density = -0.5 * ((z[:, None] - means[:, d]) ** 2 / variances[:, d]).sum(axis=1)
        log_density -= 0.5 * z**2 * prior_factor
        density = np.exp(log_density - log_density.max())
        density /= density.sum()
        mean = density @ z
        assert posterior.mean[d].item() == pytest.approx(mean, abs=1e-6)
        assert posterior.variance[d].item() == pytest.approx(density @ (z - mean) ** 2, rel=1e-5)


@pytest.mark.parametrize("prior_factor", [True, False])
def test_nothing_seen_leaves_the_prior(prior_factor):
    posterior = make(prior_factor=prior_factor).posterior(make().empty((2,)))
    assert (posterior.mean == 0).all() and (posterior.variance == 1).all()


def test_with_the_prior_as_a_factor_one_transition_makes_surer_and_without_it_may_not():
    transitions = transitions_of(200, 1)
    (_, variances), encoders = factors(make(), transitions), [make(prior_factor=factor) for factor in (True, False)]
    assert variances.max() > 1
    most = [encoder.posterior(encoder.prefixes(transitions)).variance[:, 1].max() for encoder in encoders]
    assert most[0] < 1 < most[1]


def test_without_the_bottleneck_the_belief_is_the_plain_mean_of_features():
    encoder, transitions = make(information_bottleneck=False), transitions_of(6)
    features = encoder.network(th.cat(transitions, dim=-1))
    th.testing.assert_close(encoder.belief(at(encoder.prefixes(transitions), -1)), features.mean(dim=0))
    assert not encoder.belief(encoder.empty()).any()
    assert encoder.loss(TaskSequences(transitions_of(2, 6), th.zeros(2, 1))) is None


def test_the_kl_is_that_of_monte_carlo_and_of_the_prefixes_that_are_read():
    encoder, transitions = make(kl_weight=0.5), transitions_of(3, 4)
    loss = encoder.loss(TaskSequences(transitions, th.zeros(3, 1)))
    posterior = encoder.posterior(at(encoder.prefixes(transitions), slice(0, 4)))
    prior = Normal(th.zeros(4).double(), 1.0)
    exact = kl_divergence(posterior, prior).sum(dim=-1)
    assert loss.total.item() == pytest.approx(0.5 * exact.mean().item())
    assert loss.scalars["kl_nats"].item() == pytest.approx(exact.mean().item())
    z = posterior.sample((100_000,))
    ratios = (posterior.log_prob(z) - prior.log_prob(z)).sum(dim=-1).detach()
    np.testing.assert_allclose(ratios.mean(dim=0), exact.detach(), atol=5 * ratios.std(dim=0).max().item() / 300)


def test_the_kl_leaves_padding_out():
    encoder, short = make(), transitions_of(2, 4)
    longer = Transitions(*(th.cat([part, part + 5], dim=1) for part in short))
    weights = (th.arange(8) < 4).double().expand(2, 8)
    padded = encoder.loss(TaskSequences(longer, th.zeros(2, 1), weights)).total
    th.testing.assert_close(padded, encoder.loss(TaskSequences(short, th.zeros(2, 1))).total)


def test_the_kl_draws_beliefs_to_the_prior_and_a_weight_of_zero_does_not():
    moved = {}
    for kl_weight in (0.0, 10.0):
        encoder, transitions = make(kl_weight=kl_weight), transitions_of(8, 10)
        optimizer = th.optim.SGD(encoder.parameters(), lr=1e-3)
        before = encoder.posterior(encoder.prefixes(transitions)).mean.abs().mean().item()
        for _ in range(30):
            optimizer.zero_grad()
            encoder.loss(TaskSequences(transitions, th.zeros(8, 1))).total.backward()
            optimizer.step()
        moved[kl_weight] = encoder.posterior(encoder.prefixes(transitions)).mean.abs().mean().item() / before
    assert moved[0.0] == 1 and moved[10.0] < 0.9


def test_z_is_drawn_anew_where_an_episode_begins_and_moves_with_the_posterior_alone():
    encoder, transitions = make(belief="sample"), transitions_of(5)
    th.manual_seed(1)
    memory = encoder.start_episode(encoder.empty())
    th.manual_seed(1)
    th.testing.assert_close(memory, encoder.start_episode(encoder.empty()))
    noise = encoder.belief(memory)  # of the prior, z itself
    for t in range(5):
        memory = encoder.absorb(memory, Transitions(*(column[t] for column in transitions)))
        posterior = encoder.posterior(memory)
        th.testing.assert_close(encoder.belief(memory), posterior.mean + posterior.stddev * noise)
    again = encoder.start_episode(memory)
    assert not th.equal(encoder.belief(again), encoder.belief(memory))
    th.testing.assert_close(encoder.posterior(again).mean, posterior.mean)


def test_samples_have_the_moments_of_the_posterior():
    encoder = make(belief="sample")
    memory = at(encoder.prefixes(transitions_of(5)), -1)
    many = encoder.redraw(map_memory(lambda tensor: tensor.expand(50_000, -1), memory))
    z, posterior = encoder.belief(many).detach(), encoder.posterior(memory)
    np.testing.assert_allclose(z.mean(dim=0), posterior.mean.detach(), atol=0.03)
    np.testing.assert_allclose(z.std(dim=0), posterior.stddev.detach(), rtol=0.03)


def test_pearls_protocol_explores_with_the_prior_and_holds_what_it_drew():
    encoder, transitions = make(belief="sample", exploration_episodes=2), transitions_of(3, 200, 5)
    memory = encoder.empty((200,))
    for episode in range(3):
        memory = encoder.start_episode(memory)
        posterior, z = encoder.posterior(memory), encoder.belief(memory)
        explores = episode < 2
        mean, std = (0.0, 1.0) if explores else (posterior.mean, posterior.stddev)
        assert ((z - mean) / std).std().item() == pytest.approx(1, abs=0.1)
        assert ((z - mean) / std).mean().item() == pytest.approx(0, abs=0.1)
        if episode == 1:  # it knows more than it acts on
            assert posterior.stddev.max() < 0.9
        for t in range(5):
            memory = encoder.absorb(memory, Transitions(*(column[episode, :, t] for column in transitions)))
            th.testing.assert_close(encoder.belief(memory), z, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("kwargs", "remedy"),
    [
        ({"belief": "median"}, "'mean', 'mean_var', 'sample', got 'median'"),
        ({"latent_dim": 0}, "`latent_dim`"),
        ({"net_arch": 64}, "size of each layer"),
        ({"kl_weight": -1.0}, "`kl_weight`"),
        ({"exploration_episodes": 1}, "needs a z to hold"),
        ({"exploration_episodes": 0, "belief": "sample"}, "1 or more, got 0"),
        ({"exploration_episodes": 1.5, "belief": "sample"}, "whole number"),
        ({"information_bottleneck": False, "belief": "sample"}, "`belief='sample'` needs the information bottleneck"),
        ({"information_bottleneck": False, "kl_weight": 1.0}, "`kl_weight=1.0` needs the information bottleneck"),
        ({"information_bottleneck": False, "prior_factor": True}, "`prior_factor=True` needs"),
    ],
)
def test_what_does_not_go_together_is_refused(kwargs, remedy):
    with pytest.raises(ValueError, match=remedy):
        ProductOfGaussians(3, 2, **kwargs)


@pytest.mark.parametrize("given", ["no", 1])
def test_a_prior_factor_is_on_or_off(given):
    with pytest.raises(TypeError, match="neither True nor False"):
        ProductOfGaussians(3, 2, prior_factor=given)

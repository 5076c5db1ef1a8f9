"""BRUNO: exact beliefs whatever the order, learned, and predictions in data space."""

import numpy as np
import pytest
import torch as th

from sb3_bruno.encoders import BrunoEncoder, TaskSequences, Transitions
from sb3_bruno.encoders.base import map_memory
from sb3_bruno.maths.processes import PROCESSES
from support.small_encoder import SMALL, encoder_of, transitions_of


def permuted_prefixes(encoder: BrunoEncoder, transitions: Transitions, noise: th.Tensor, seed: int):
    order = th.as_tensor(np.random.default_rng(seed).permutation(noise.shape[-2]))
    shuffled = Transitions(*(column[..., order, :] for column in transitions))
    return encoder.prefixes(shuffled, noise=noise[..., order, :])


def last(statistics):
    return map_memory(lambda prefixes: prefixes[..., -1, :], statistics)


@pytest.mark.parametrize("process", PROCESSES)
@pytest.mark.parametrize("modelled", ["rewards", "next_observations", "both"])
def test_belief_does_not_depend_on_the_order(modelled, process):
    encoder, transitions = encoder_of(modelled=modelled, process=process), transitions_of(4, 20)
    noise = encoder.draw_noise((4, 20))
    belief = encoder.belief(last(encoder.prefixes(transitions, noise=noise)))
    for seed in range(5):
        shuffled = encoder.belief(last(permuted_prefixes(encoder, transitions, noise, seed)))
        th.testing.assert_close(shuffled, belief, rtol=1e-10, atol=1e-12)


def test_belief_is_the_conditional_of_a_dense_gaussian_over_theta_and_latents():
    encoder, transitions = encoder_of(process="gaussian"), transitions_of(12)
    noise = encoder.draw_noise((12,))
    z = encoder.latents(transitions, noise)
    posterior = encoder.posterior(last(encoder.prefixes(transitions, noise=noise)))
    for d in range(encoder.latent_dim):
        var, cov = encoder.process.var[d].item(), encoder.process.cov[d].item()
        joint = np.full((13, 13), cov)  # theta first, then the latents
        joint[np.arange(1, 13), np.arange(1, 13)] = var
        gain = np.linalg.solve(joint[1:, 1:], joint[1:, 0])
        assert posterior.mean[d].item() == pytest.approx(gain @ z[:, d].detach().numpy(), rel=1e-9)
        assert posterior.variance[d].item() == pytest.approx(cov - gain @ joint[1:, 0], rel=1e-9)


def test_a_transition_of_weight_zero_is_as_if_it_were_not_there():
    transitions, encoder = transitions_of(2, 5), encoder_of()
    weights = th.tensor([1.0, 1.0, 0.0, 1.0, 0.0], dtype=th.float64).expand(2, 5)
    found = encoder.prefixes(transitions, weights=weights)
    left = encoder.prefixes(type(transitions)(*(column[:, [0, 1, 3]] for column in transitions)))
    for one, two in zip(found, left, strict=True):
        th.testing.assert_close(one, two[:, [0, 1, 2, 2, 3, 3]])
    assert not th.allclose(found[1], encoder.prefixes(transitions)[1])


@pytest.mark.parametrize("process", PROCESSES)
def test_absorbing_one_by_one_equals_all_prefixes_at_once(process):
    encoder, transitions = encoder_of(process=process), transitions_of(6, 9)
    noise = encoder.draw_noise((6, 9))
    prefixes = encoder.prefixes(transitions, noise=noise)
    statistics = encoder.empty((6,))
    for t in range(10):
        for carried, prefix in zip(statistics, prefixes, strict=True):
            th.testing.assert_close(carried, prefix[:, t])
        if t < 9:
            now = Transitions(*(column[:, t] for column in transitions))
            statistics = encoder.absorb(statistics, now, noise[:, t])


def test_noise_is_an_argument():
    encoder, transitions = encoder_of(), transitions_of(5)
    zeros = th.zeros(5, 4, dtype=th.float64)
    th.testing.assert_close(encoder.prefixes(transitions), encoder.prefixes(transitions, noise=zeros), rtol=0, atol=0)
    noise = encoder.draw_noise((5,))
    again, other = (
        encoder.prefixes(transitions, noise=noise),
        encoder.prefixes(transitions, noise=encoder.draw_noise((5,))),
    )
    th.testing.assert_close(again, encoder.prefixes(transitions, noise=noise), rtol=0, atol=0)
    assert not th.allclose(again[1], other[1])


def test_belief_is_mean_and_variance_or_the_mean_alone():
    statistics = last(encoder_of().prefixes(transitions_of(4, 7), noise=th.zeros(4, 7, 4, dtype=th.float64)))
    both, mean = encoder_of(), encoder_of(belief="mean")
    posterior = both.posterior(statistics)
    th.testing.assert_close(both.belief(statistics), th.cat([posterior.mean, posterior.variance], dim=-1))
    th.testing.assert_close(mean.belief(statistics), posterior.mean)
    assert (both.belief_dim, mean.belief_dim) == (10, 5)


@pytest.mark.parametrize(
    ("modelled", "extra_dims", "latent_dim"),
    [
        ("rewards", None, 5),
        ("rewards", 2, 3),
        ("next_observations", None, 3),
        ("both", None, 4),
        ("both", 1, 5),
    ],
)
def test_what_is_modelled_sets_the_latent_dimension(modelled, extra_dims, latent_dim):
    assert encoder_of(modelled=modelled, extra_dims=extra_dims).latent_dim == latent_dim


def test_only_what_is_modelled_enters_the_belief():
    noise = encoder_of().draw_noise((6,))
    transitions = transitions_of(6)
    elsewhere = transitions._replace(next_observations=transitions.next_observations + 1)
    th.testing.assert_close(
        encoder_of().prefixes(transitions, noise=noise), encoder_of().prefixes(elsewhere, noise=noise)
    )
    dynamics = encoder_of(modelled="next_observations", extra_dims=4)
    richer = transitions._replace(rewards=transitions.rewards + 1)
    th.testing.assert_close(dynamics.prefixes(transitions, noise=noise), dynamics.prefixes(richer, noise=noise))


def test_next_observations_are_modelled_as_changes():
    encoder, transitions = encoder_of(modelled="next_observations"), transitions_of(6)
    moved = Transitions(*transitions)._replace(next_observations=transitions.observations + 1)
    th.testing.assert_close(encoder._y(moved), th.ones(6, 3, dtype=th.float64))


def test_the_reward_may_be_explained_by_where_the_action_led():
    encoder, transitions = encoder_of(condition_on_next=True), transitions_of(6)
    elsewhere = transitions._replace(next_observations=transitions.next_observations + 1)
    assert not th.allclose(encoder.prefixes(transitions)[1], encoder.prefixes(elsewhere)[1])
    statistics = encoder.empty()
    here, action, there = (th.zeros(dim, dtype=th.float64) for dim in (3, 2, 3))
    assert encoder.outcomes(statistics, here, action, there, 10).rewards.shape == (10, 1)
    with pytest.raises(ValueError, match="next_observations"):
        encoder.outcomes(statistics, here, action, None, 10)
    with pytest.raises(ValueError, match="condition_on_next"):
        encoder_of(condition_on_next=True, modelled="both")


def test_encoder_learns_the_hidden_task():
    """r = d a with d = +-1: after training, the belief after 10 transitions tells the two apart."""
    th.manual_seed(0)
    encoder = BrunoEncoder(1, 1, **SMALL)
    optimizer = th.optim.Adam(encoder.parameters(), lr=3e-3)

    def sequences(batch, time):
        direction = th.randint(2, (batch, 1, 1)) * 2.0 - 1
        observations, actions = th.randn(batch, time, 1), th.rand(batch, time, 1) * 2 - 1
        rewards = direction * actions + 0.1 * th.randn_like(actions)
        return TaskSequences(Transitions(observations, actions, rewards, observations), direction[:, 0])

    first = None
    for _ in range(600):
        loss = encoder.loss(sequences(16, 32)).total
        first = loss.item() if first is None else first
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert loss.item() < first - 0.3
    transitions, tasks, _ = sequences(400, 10)
    direction = tasks[:, 0]
    with th.no_grad():
        means = encoder.posterior(last(encoder.prefixes(transitions))).mean.numpy()
    weights, *_ = np.linalg.lstsq(np.c_[means, np.ones(400)][:200], direction.numpy()[:200])
    right = np.sign(np.c_[means, np.ones(400)][200:] @ weights) == direction.numpy()[200:]
    assert right.mean() > 0.9


@pytest.mark.parametrize("process", PROCESSES)
@pytest.mark.parametrize("modelled", ["rewards", "both"])
def test_outcomes_have_the_density_of_the_predictive(modelled, process):
    """Map samples forward again: their latents must have the predictive's moments."""
    encoder = encoder_of(modelled=modelled, extra_dims=0, process=process)
    statistics = last(encoder.prefixes(transitions_of(7), noise=encoder.draw_noise((7,))))
    observation, action = th.zeros(3, dtype=th.float64), th.ones(2, dtype=th.float64)
    with th.no_grad():
        outcomes = encoder.outcomes(statistics, observation, action, None, 20_000)
        assert outcomes.rewards.shape == (20_000, 1)
        assert (outcomes.next_observations is None) == (modelled == "rewards")
        there = observation.expand(20_000, 3) if outcomes.next_observations is None else outcomes.next_observations
        drawn = Transitions(observation.expand(20_000, 3), action.expand(20_000, 2), outcomes.rewards, there)
        z = encoder.latents(drawn, encoder.draw_noise((20_000,)))
        predictive = encoder.process.predictive(encoder.process.empty()._make(statistics))
    np.testing.assert_allclose(z.mean(dim=0), predictive.mean, atol=0.05)
    np.testing.assert_allclose(z.var(dim=0), predictive.variance, rtol=0.06)
    median, mean = outcomes.quantile(0.5).rewards, outcomes.mean().rewards
    assert median.shape == mean.shape == (1,)
    assert outcomes.quantile(0.9).rewards > median > outcomes.quantile(0.1).rewards


@pytest.mark.parametrize(
    "bad",
    [{"modelled": "actions"}, {"belief": "var"}, {"extra_dims": -1}, {"process": "cauchy"}, {"objective": "elbo"}],
)
def test_bad_arguments_are_named(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        encoder_of(**bad)

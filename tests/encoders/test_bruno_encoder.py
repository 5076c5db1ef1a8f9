"""BRUNO: exact beliefs whatever the order, learned, and predictions in data space."""

import numpy as np
import pytest
import torch as th

from sb3_bruno.encoders import BrunoEncoder, TaskSequences, Transitions
from sb3_bruno.encoders.base import map_memory
from support.small_encoder import NOISY, PROCESSES, SMALL, encoder_of, transitions_of


def last(statistics):
    return map_memory(lambda prefixes: prefixes[..., -1, :], statistics)


@pytest.mark.parametrize("kwargs", [*({"process": process} for process in PROCESSES), NOISY])
@pytest.mark.parametrize("modelled", ["rewards", "next_observations", "both"])
def test_belief_does_not_depend_on_the_order(modelled, kwargs):
    encoder, transitions = encoder_of(modelled=modelled, condition_on_next=False, **kwargs), transitions_of(4, 20)
    noise = encoder.draw_noise((4, 20))
    belief = encoder.belief(last(encoder.prefixes(transitions, noise=noise)))
    for seed in range(5):
        order = th.as_tensor(np.random.default_rng(seed).permutation(20))
        shuffled = Transitions(*(column[:, order] for column in transitions))
        found = encoder.belief(last(encoder.prefixes(shuffled, noise=noise[:, order])))
        th.testing.assert_close(found, belief, rtol=1e-9, atol=1e-11)


def test_belief_is_the_conditional_of_a_dense_gaussian_over_theta_and_latents():
    encoder, transitions = encoder_of(**NOISY), transitions_of(12)
    noise = encoder.draw_noise((12,))
    z = encoder.see(transitions, noise).z
    posterior = encoder.posterior(last(encoder.prefixes(transitions, noise=noise)))
    for d in range(encoder.model.latent_dim):
        var, cov = encoder.process.var[d].item(), encoder.process.cov[d].item()
        joint = np.full((13, 13), cov)  # theta first, then the latents
        joint[np.arange(1, 13), np.arange(1, 13)] = var
        gain = np.linalg.solve(joint[1:, 1:], joint[1:, 0])
        assert posterior.mean[d].item() == pytest.approx(gain @ z[:, d].detach().numpy(), rel=1e-9)
        assert posterior.variance[d].item() == pytest.approx(cov - gain @ joint[1:, 0], rel=1e-9)


@pytest.mark.parametrize("process", PROCESSES)
def test_a_transition_of_weight_zero_is_as_if_it_were_not_there(process):
    transitions, encoder = transitions_of(2, 5), encoder_of(process=process)
    weights = th.tensor([1.0, 1.0, 0.0, 1.0, 0.0], dtype=th.float64).expand(2, 5)
    found = encoder.prefixes(transitions, weights=weights)
    left = encoder.prefixes(type(transitions)(*(column[:, [0, 1, 3]] for column in transitions)))
    for one, two in zip(found, left, strict=True):
        th.testing.assert_close(one, two[:, [0, 1, 2, 2, 3, 3]])
    assert not th.allclose(encoder.belief(found), encoder.belief(encoder.prefixes(transitions)))


def test_noise_is_an_argument():
    encoder, transitions = encoder_of(**NOISY), transitions_of(5)
    zeros = th.zeros(5, 4, dtype=th.float64)
    th.testing.assert_close(encoder.prefixes(transitions), encoder.prefixes(transitions, noise=zeros), rtol=0, atol=0)
    noise = encoder.draw_noise((5,))
    again, other = (
        encoder.prefixes(transitions, noise=noise),
        encoder.prefixes(transitions, noise=encoder.draw_noise((5,))),
    )
    th.testing.assert_close(again, encoder.prefixes(transitions, noise=noise), rtol=0, atol=0)
    assert not th.allclose(again[1], other[1])


@pytest.mark.parametrize(("belief", "spread"), [("mean_std", "stddev"), ("mean_var", "variance")])
def test_a_belief_is_the_mean_and_what_spreads_around_it_or_the_mean_alone(belief, spread):
    both, mean = encoder_of(belief=belief), encoder_of(belief="mean")
    memory = last(both.prefixes(transitions_of(4, 7)))
    posterior = both.posterior(memory)
    th.testing.assert_close(both.belief(memory), th.cat([posterior.mean, getattr(posterior, spread)], dim=-1))
    th.testing.assert_close(mean.belief(memory), posterior.mean)
    assert (both.belief_dim, mean.belief_dim) == (8, 4)


@pytest.mark.parametrize(
    ("modelled", "extra_dims", "latent_dim"),
    [("rewards", 0, 1), ("rewards", 2, 3), ("next_observations", 0, 3), ("both", 0, 4), ("both", 1, 5)],
)
def test_what_is_modelled_sets_the_latent_dimension_of_the_papers_process(modelled, extra_dims, latent_dim):
    encoder = encoder_of(process="gaussian", modelled=modelled, extra_dims=extra_dims, condition_on_next=False)
    assert encoder.model.latent_dim == latent_dim


@pytest.mark.parametrize("process", ["kernel", "gaussian"])
def test_only_what_is_modelled_enters_the_belief(process):
    transitions = transitions_of(6)
    elsewhere = transitions._replace(next_observations=transitions.next_observations + 1)
    rewards = encoder_of(process=process, condition_on_next=False)
    th.testing.assert_close(rewards.prefixes(transitions), rewards.prefixes(elsewhere))
    dynamics = encoder_of(process=process, modelled="next_observations")
    richer = transitions._replace(rewards=transitions.rewards + 1)
    th.testing.assert_close(dynamics.prefixes(transitions), dynamics.prefixes(richer))


def test_next_observations_are_modelled_as_changes():
    encoder, transitions = encoder_of(modelled="next_observations"), transitions_of(6)
    moved = Transitions(*transitions)._replace(next_observations=transitions.observations + 1)
    th.testing.assert_close(encoder.see(moved).z, th.ones(6, 3, dtype=th.float64), rtol=0, atol=1e-6)


@pytest.mark.parametrize("process", ["kernel", "gaussian"])
def test_the_reward_may_be_explained_by_where_the_action_led(process):
    encoder, transitions = encoder_of(process=process), transitions_of(6)
    elsewhere = transitions._replace(next_observations=transitions.next_observations + 1)
    found, other = (encoder.belief(encoder.prefixes(columns)) for columns in (transitions, elsewhere))
    assert not th.allclose(found, other)
    memory = encoder.empty()
    here, action, there = (th.zeros(dim, dtype=th.float64) for dim in (3, 2, 3))
    assert encoder.outcomes(memory, here, action, there, 10).rewards.shape == (10, 1)
    with pytest.raises(ValueError, match="next_observations"):
        encoder.outcomes(memory, here, action, None, 10)
    with pytest.raises(ValueError, match="condition_on_next"):
        encoder_of(process="gaussian", modelled="both", condition_on_next=True)


def test_what_a_change_is_given_does_not_hold_the_change():
    encoder, transitions = encoder_of(modelled="both"), transitions_of(6)
    elsewhere = transitions._replace(next_observations=transitions.next_observations + 1)
    (features,), (others,) = encoder.see(transitions).given, encoder.see(elsewhere).given
    for one, two in zip(features, others, strict=True):
        th.testing.assert_close(one[:, 1:], two[:, 1:], rtol=0, atol=0)
        assert not th.allclose(one[:, 0], two[:, 0])


@pytest.mark.parametrize("kwargs", [{"process": "kernel"}, {"process": "kernel_student_t"}, NOISY])
def test_encoder_learns_the_hidden_task(kwargs):
    """r = d a with d = +-1: after training, the belief after 10 transitions tells the two apart."""
    th.manual_seed(0)
    encoder = BrunoEncoder(1, 1, **SMALL, **kwargs)
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
    encoder = encoder_of(modelled=modelled, process=process, condition_on_next=False)
    memory = last(encoder.prefixes(transitions_of(7)))
    observation, action = th.zeros(3, dtype=th.float64), th.ones(2, dtype=th.float64)
    with th.no_grad():
        outcomes = encoder.outcomes(memory, observation, action, None, 20_000)
        assert outcomes.rewards.shape == (20_000, 1)
        assert (outcomes.next_observations is None) == (modelled == "rewards")
        there = observation.expand(20_000, 3) if outcomes.next_observations is None else outcomes.next_observations
        drawn = Transitions(observation.expand(20_000, 3), action.expand(20_000, 2), outcomes.rewards, there)
        given, z, _ = encoder.see(drawn)
        features = [type(columns)(*(column[0] for column in columns)) for columns in given]
        predictive = encoder.process.predictive(memory, *features)
    np.testing.assert_allclose(z.mean(dim=0), predictive.mean, atol=0.05)
    np.testing.assert_allclose(z.var(dim=0), predictive.variance, rtol=0.06)
    median, mean = outcomes.quantile(0.5).rewards, outcomes.mean().rewards
    assert median.shape == mean.shape == (1,)
    assert outcomes.quantile(0.9).rewards > median > outcomes.quantile(0.1).rewards


def test_a_reward_given_where_the_action_led_shares_its_scale():
    """Under a Student-t, a surprising change makes the reward as uncertain as p(r, s') / p(s') says."""
    encoder = encoder_of(modelled="both", process="kernel_student_t", condition_on_next=False)
    memory, here, action = encoder.empty(), th.zeros(3, dtype=th.float64), th.zeros(2, dtype=th.float64)
    spreads = []
    with th.no_grad():
        for there in (0.0, 30.0):
            rewards = encoder.outcomes(memory, here, action, th.full((3,), there, dtype=th.float64), 5_000).rewards
            spreads.append((rewards.quantile(0.75) - rewards.quantile(0.25)).item())
    assert spreads[1] > 5 * spreads[0]


def test_rewards_follow_from_next_observations_that_were_drawn():
    """Samples of (s', r) without s' have the joint density: r given a drawn s' is what it is given that s'."""
    encoder = encoder_of(modelled="both")
    memory = last(encoder.prefixes(transitions_of(7)))
    observation, action = th.zeros(3, dtype=th.float64), th.ones(2, dtype=th.float64)
    with th.no_grad():
        n = 20_000
        rewards, arrivals = encoder.outcomes(memory, observation, action, None, n)
        here, there = observation.expand(n, 3), arrivals
        seen = encoder.see(Transitions(here, action.expand(n, 2), rewards, there))
        scores = encoder.process.log_predictive(memory, *seen.given, seen.z)
        entropy = -scores.mean()  # of one transition: compare with samples drawn dimension by dimension
        shuffled = encoder.see(Transitions(here, action.expand(n, 2), rewards.roll(1, 0), there))
        assert -encoder.process.log_predictive(memory, *shuffled.given, shuffled.z).mean() > entropy
        # The squared distance of such draws is chi-squared with 4 degrees of freedom.
        added = encoder.process.distance(encoder.process.absorb(memory, *seen.given, seen.z)).beta
        assert (added - encoder.process.distance(memory).beta).mean().item() == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("process", ["kernel", "kernel_student_t"])
@pytest.mark.parametrize("flow_class", [None, "spline"])
def test_moments_are_those_of_many_samples(process, flow_class):
    encoder = encoder_of(modelled="both", process=process, flow_class=flow_class, flow_kwargs=None)
    memory = last(encoder.prefixes(transitions_of(7)))
    observation, action, there = (th.full((dim,), 0.3, dtype=th.float64) for dim in (3, 2, 3))
    with th.no_grad():
        samples = encoder.outcomes(memory, observation, action, None, 40_000).next_observations
        mean, std = encoder.moments(memory, observation, action, None)
        assert mean.rewards is None and std.rewards is None  # for want of s'
        np.testing.assert_allclose((mean.next_observations - samples.mean(dim=0)) / samples.std(dim=0), 0, atol=0.03)
        np.testing.assert_allclose(std.next_observations / samples.std(dim=0), 1, rtol=0.05)
        rewards = encoder.outcomes(memory, observation, action, there, 40_000).rewards
        mean, std = encoder.moments(memory, observation, action, there)
    np.testing.assert_allclose((mean.rewards - rewards.mean(dim=0)) / rewards.std(dim=0), 0, atol=0.03)
    np.testing.assert_allclose(std.rewards / rewards.std(dim=0), 1, rtol=0.05)


def test_moments_of_batches_and_of_a_process_without_a_kernel():
    encoder = encoder_of(modelled="rewards")
    memories = encoder.prefixes(transitions_of(7))
    columns = (transitions_of(8).observations, transitions_of(8).actions, transitions_of(8).next_observations)
    with th.no_grad():
        mean, std = encoder.moments(memories, *columns)
        alone = encoder.moments(map_memory(lambda states: states[3], memories), *(column[3] for column in columns))
    assert mean.rewards.shape == std.rewards.shape == (8, 1) and mean.next_observations is None
    np.testing.assert_allclose(mean.rewards[3], alone.mean.rewards)
    np.testing.assert_allclose(std.rewards[3], alone.std.rewards)
    encoder = encoder_of(process="gaussian")
    with pytest.raises(ValueError, match="need a process with a kernel"):
        encoder.moments(encoder.empty((8,)), *columns)


@pytest.mark.parametrize(
    "bad",
    [
        {"modelled": "actions"},
        {"belief": "var"},
        {"extra_dims": -1},
        {"extra_dims": 1, "process": "kernel_student_t"},
        {"process": "cauchy"},
        {"objective": "elbo"},
        {"n_weights": 0},
        {"n_weights": 8.0},
        {"flow_class": "maf"},
        {"flow_class": "paper_maf"},  # of one value
        {"condition_on_next": True, "modelled": "next_observations"},
    ],
)
def test_bad_arguments_are_named(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        encoder_of(**bad)


@pytest.mark.parametrize("form", ["mean_std", "mean_var"])
def test_the_spread_in_a_belief_is_bounded_whatever_comes(form):
    """One reward of 1e6 multiplies a Student-t's variances by as much as it likes."""
    th.manual_seed(0)
    encoder = BrunoEncoder(3, 2, process="kernel_student_t", n_weights=2, net_arch=(8,), flow_class=None, belief=form)
    transitions = transitions_of(20)
    encoder.double().eval()
    before = encoder.belief(last(encoder.prefixes(transitions)))[..., encoder.belief_dim // 2 :]
    transitions.rewards[..., 10, :] = 1e6
    memory = last(encoder.prefixes(transitions))
    after = encoder.belief(memory)[..., encoder.belief_dim // 2 :]
    var = encoder.process.posterior_moments(memory)[1]
    assert var.max() > 3 and before.max() < 1 and after.max() < 2.1
    th.testing.assert_close(after, var.log1p() if form == "mean_var" else var.log1p().sqrt())

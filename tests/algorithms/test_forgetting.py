"""A switch of the task is noticed soon, and rarely without a cause; what is left is what came after it."""

import torch as th

from sb3_bruno.algorithms.forgetting import absorb_or_forget, no_suspicion
from sb3_bruno.encoders import BrunoEncoder, Transitions
from sb3_bruno.encoders.base import map_memory
from sb3_bruno.encoders.latents import Seen

N, SWITCH, STEPS, THRESHOLD = 500, 30, 60, 5.0


class Bare(BrunoEncoder):
    """The rewards are the latents: z = r."""

    def __init__(self):
        super().__init__(1, 1, modelled="rewards", process="gaussian")
        with th.no_grad():
            self.process.correlation_logit.fill_(3.0)  # v = 1, theta has a variance of 0.95

    def see(self, transitions, noise=None):
        return Seen((), transitions.rewards, th.zeros(()))


def transitions_of(rewards: th.Tensor) -> Transitions:
    nothing = th.zeros_like(rewards)
    return Transitions(nothing, nothing, rewards, nothing)


def run(rewards: th.Tensor, threshold: float = THRESHOLD):
    """The statistics after each step: rewards (N, STEPS), time by time."""
    encoder = Bare()
    statistics, suspicion = encoder.empty((N,)), no_suspicion(encoder, (N,))
    seen = []
    with th.no_grad():
        for t in range(rewards.shape[1]):
            arrived = transitions_of(rewards[:, t, None])
            statistics, suspicion = absorb_or_forget(encoder, statistics, suspicion, arrived, threshold)
            seen.append(statistics)
    return encoder, seen, suspicion


def rewards_of(switch: bool) -> th.Tensor:
    """theta is 1, and -1 after a switch at step 30; the noise has the model's variance."""
    generator = th.Generator().manual_seed(0)
    theta = th.ones(N, STEPS)
    if switch:
        theta[:, SWITCH:] = -1.0
    return theta + 0.05**0.5 * th.randn(N, STEPS, generator=generator)


def test_a_switch_is_noticed_within_a_few_steps_and_only_what_came_after_is_kept():
    rewards = rewards_of(switch=True)
    encoder, seen, _ = run(rewards)
    n = th.stack([statistics[0][:, 0] for statistics in seen], dim=1)  # (N, STEPS)
    noticed = (n[:, SWITCH:] <= th.arange(1, STEPS - SWITCH + 1) + 1).float().argmax(dim=1)
    assert noticed.float().mean() < 3
    assert (n[:, SWITCH + 10] <= 11 + 1).float().mean() > 0.99  # at most one older transition is left
    posterior = encoder.posterior(seen[SWITCH + 10])
    th.testing.assert_close(posterior.mean.mean(), th.tensor(-1.0), atol=0.05, rtol=0)


def test_without_a_switch_hardly_anything_is_forgotten():
    _, seen, suspicion = run(rewards_of(switch=False))
    assert (seen[-1][0] == STEPS).float().mean() > 0.97
    assert (suspicion.evidence >= 0).all()


def test_a_threshold_out_of_reach_is_plain_absorbing():
    rewards = rewards_of(switch=True)
    encoder, seen, _ = run(rewards, threshold=float("inf"))
    whole = encoder.prefixes(transitions_of(rewards.unsqueeze(-1)))
    for carried, prefix in zip(seen[-1], whole, strict=True):
        th.testing.assert_close(carried, prefix[:, -1])


def test_the_log_bayes_factor_is_that_of_the_predictive_densities():
    encoder = BrunoEncoder(3, 2, process="gaussian").double()
    parts = [th.randn(5, 4, dim, dtype=th.float64) for dim in (3, 2, 1, 3)]
    context, arrived = (Transitions(*(column[:, t] for column in parts)) for t in (slice(0, 3), 3))
    statistics = map_memory(lambda prefixes: prefixes[:, -1], encoder.prefixes(context))
    z = encoder.see(arrived).z
    before, after = (encoder.process.predictive(memory) for memory in (encoder.empty((5,)), statistics))
    expected = (before.log_prob(z) - after.log_prob(z)).sum(dim=-1)
    th.testing.assert_close(encoder.log_bayes_factor(statistics, arrived), expected)

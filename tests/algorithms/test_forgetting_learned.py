"""An encoder that has learned a noisy task notices its switches, and its intervals hold what they should."""

import pytest
import torch as th

from sb3_bruno.algorithms.forgetting import absorb_or_forget, no_suspicion
from sb3_bruno.encoders import BrunoEncoder, TaskSequences, Transitions
from sb3_bruno.encoders.base import map_memory
from support.small_encoder import SMALL

SWITCH, STEPS, THRESHOLD = 60, 120, 10.0  # steps, nats


def transitions_of(direction: th.Tensor) -> Transitions:
    """r = d + o / 2 + N(0, 1), with d = +-1 of each step, (batch, time)."""
    observations, actions = th.randn(*direction.shape, 1), 2 * th.rand(*direction.shape, 1) - 1
    rewards = direction.unsqueeze(-1) + 0.5 * observations + th.randn(*direction.shape, 1)
    return Transitions(observations, actions, rewards, th.randn(*direction.shape, 1))


def directions(batch: int, time: int) -> th.Tensor:
    return (th.randint(2, (batch, 1)) * 2.0 - 1).expand(batch, time)


@pytest.fixture(scope="module", params=["kernel", "kernel_student_t", "gaussian"])
def encoder(request):
    th.manual_seed(0)
    encoder = BrunoEncoder(1, 1, **{**SMALL, "process": request.param, "flow_class": "spline", "flow_kwargs": None})
    optimizer = th.optim.Adam(encoder.parameters(), lr=3e-3)
    for _ in range(500):
        direction = directions(16, 40)
        loss = encoder.loss(TaskSequences(transitions_of(direction), direction[:, :1])).total
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return encoder.eval()


def noticed(encoder: BrunoEncoder, transitions: Transitions) -> th.Tensor:
    """The steps at which the belief forgot what came before, (batch, time)."""
    n_envs, time = transitions.rewards.shape[:2]
    memory, suspicion = encoder.empty((n_envs,)), no_suspicion(encoder, (n_envs,))
    forgot = th.zeros(n_envs, time, dtype=th.bool)
    for t in range(time):
        now = Transitions(*(column[:, t] for column in transitions))
        passed = suspicion.evidence + encoder.log_bayes_factor(memory, now).unsqueeze(-1) > THRESHOLD
        memory, suspicion = absorb_or_forget(encoder, memory, suspicion, now, THRESHOLD)
        forgot[:, t] = passed[:, 0]
    return forgot


@th.no_grad()
def test_every_switch_is_noticed_soon_and_hardly_any_is_imagined(encoder):
    th.manual_seed(1)
    direction = directions(100, STEPS).clone()
    direction[:, SWITCH:] *= -1
    forgot = noticed(encoder, transitions_of(direction))
    assert forgot[:, :SWITCH].any(dim=1).float().mean() < 0.05
    after = forgot[:, SWITCH:]
    assert after.any(dim=1).float().mean() > 0.95
    assert after.float().argmax(dim=1).float().mean() < 25


@th.no_grad()
@pytest.mark.parametrize("n", [2, 20])
def test_the_central_interval_holds_as_much_as_it_says(encoder, n):
    th.manual_seed(2)
    transitions = transitions_of(directions(1_000, n + 1))
    memory = map_memory(lambda prefixes: prefixes[:, n], encoder.prefixes(transitions))
    observations, actions, rewards, arrivals = (column[:, n] for column in transitions)
    outcomes = encoder.outcomes(memory, observations, actions, arrivals, 200)
    low, high = outcomes.quantile(0.05).rewards, outcomes.quantile(0.95).rewards
    assert ((low < rewards) & (rewards < high)).float().mean().item() == pytest.approx(0.9, abs=0.05)

"""The bound that BRUNO maximises: each objective against a dense Gaussian, constant and log-determinant included."""

import math

import numpy as np
import pytest
import torch as th
from torch.distributions import MultivariateNormal, Normal

from sb3_bruno.encoders import TaskSequences, Transitions
from sb3_bruno.encoders.base import map_memory
from sb3_bruno.maths.flow import ConditionalFlow
from support.small_encoder import NOISY, PROCESSES, encoder_of, transitions_of


def test_bound_without_noise_is_eq_4_by_a_dense_gaussian(monkeypatch):
    """log p(y_t | x_t, tau_1:k) by conditioning the joint of theta-free latents, k fixed at 3 of 8."""
    encoder = encoder_of(process="gaussian", objective="paper")
    transitions = transitions_of(2, 8)
    monkeypatch.setattr(th, "randint", lambda *args: th.tensor(3))
    bound = encoder.bound(transitions).item()
    _, z, log_det = encoder.see(transitions)
    var, cov = encoder.process.var.item(), encoder.process.cov.item()
    gain = np.linalg.solve(np.full((3, 3), cov) + (var - cov) * np.eye(3), np.full(3, cov))
    means, spread = z[:, :3, 0].detach().numpy() @ gain, math.sqrt(var - gain @ np.full(3, cov))
    expected = Normal(th.as_tensor(means)[:, None], spread).log_prob(z[..., 0]) + log_det
    assert bound == pytest.approx(expected.mean().item(), rel=1e-9)


@pytest.mark.parametrize("process", PROCESSES)
def test_holdout_scores_what_comes_after_the_context_alone(monkeypatch, process):
    encoder, transitions = encoder_of(process=process, objective="holdout"), transitions_of(2, 8)
    monkeypatch.setattr(th, "randint", lambda *args: th.tensor(3))
    memory = map_memory(lambda prefixes: prefixes[:, 3], encoder.prefixes(transitions))
    scored = []
    for t in range(3, 8):
        given, z, log_det = encoder.see(Transitions(*(column[:, t] for column in transitions)))
        scored.append(encoder.process.log_predictive(memory, *given, z) + log_det)
    assert encoder.bound(transitions).item() == pytest.approx(th.stack(scored).mean().item(), rel=1e-9)
    with pytest.raises(ValueError, match=r"`transitions` has 1 in a sequence: .* needs 2"):
        encoder.bound(Transitions(*(column[:, :1] for column in transitions)))


@pytest.mark.parametrize("process", PROCESSES)
def test_prequential_is_the_exact_joint_evidence_per_transition(process):
    encoder, transitions = encoder_of(process=process, objective="prequential"), transitions_of(2, 8)
    one_by_one = encoder.one_step_scores(transitions)
    assert encoder.bound(transitions).item() == pytest.approx(one_by_one.mean().item(), rel=1e-9)
    memory, scores = encoder.empty((2,)), []
    for t in range(8):
        now = Transitions(*(column[:, t] for column in transitions))
        given, z, log_det = encoder.see(now)
        scores.append(encoder.process.log_predictive(memory, *given, z) + log_det)
        memory = encoder.absorb(memory, now)
    th.testing.assert_close(one_by_one, th.stack(scores, dim=1))


def test_bound_holds_and_is_tight_where_noise_is_left_alone(monkeypatch):
    """A flow that copies the noise makes log p(y, eps) - log p(eps) exact: the bound, constant included, is equal."""

    class Copy(ConditionalFlow):
        def forward(self, y, x):
            return super().forward(y, x)._replace(z=y, log_det=y[..., 0] * 0)

    encoder, transitions = encoder_of(**NOISY), transitions_of(400, 40)
    encoder.model.flow.__class__ = Copy
    with th.no_grad():
        encoder.process.correlation_logit.fill_(-30.0)  # standard normal latents, nothing to infer
    exact = Normal(0.0, 1.0).log_prob(transitions.rewards).mean().item()
    assert encoder.bound(transitions).item() == pytest.approx(exact, abs=0.05)


@pytest.mark.parametrize("kwargs", [{}, {"process": "gaussian", "condition_on_next": False}])
def test_standardising_changes_the_map_and_not_what_the_bound_measures(kwargs):
    """The log-determinant is that of the whole map from data to latents, standardisation included."""
    encoder, transitions = encoder_of(modelled="both", **kwargs), transitions_of(64)
    encoder.model.variables.update(Transitions(*(5 + (i + 2) * column for i, column in enumerate(transitions))))
    one = Transitions(*(part[0] for part in transitions))

    def whole(y):
        return encoder.see(one._replace(rewards=y[:1], next_observations=y[1:])).z

    jacobian = th.autograd.functional.jacobian(whole, th.cat([one.rewards, one.next_observations]))
    assert jacobian.shape == (4, 4)
    th.testing.assert_close(encoder.see(one).log_det, jacobian.slogdet().logabsdet, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("objective", ["paper", "holdout", "prequential"])
@pytest.mark.parametrize("process", PROCESSES)
def test_padding_of_weight_zero_changes_nothing(monkeypatch, process, objective):
    encoder = encoder_of(process=process, objective=objective).train()
    monkeypatch.setattr(th, "randint", lambda *args: th.tensor(3))
    short = transitions_of(2, 8)
    longer = Transitions(*(th.cat([part, part[:, :4] + 5], dim=1) for part in short))
    weights = (th.arange(12) < 8).double().expand(2, 12)
    padded = encoder.loss(TaskSequences(longer, th.zeros(2, 1), weights)).total
    moved = [buffer.clone() for buffer in encoder.buffers()]
    again = encoder_of(process=process, objective=objective).train()
    th.testing.assert_close(padded, again.loss(TaskSequences(short, th.zeros(2, 1))).total)
    for one, two in zip(moved, again.buffers(), strict=True):
        th.testing.assert_close(one, two)


def test_only_training_moves_the_statistics():
    encoder, transitions = encoder_of(), transitions_of(4, 20)
    before = [buffer.clone() for buffer in encoder.buffers()]
    sequences = TaskSequences(transitions, th.zeros(4, 1))
    encoder.eval().loss(sequences)
    encoder.train().bound(transitions)
    assert all(th.equal(one, two) for one, two in zip(before, encoder.buffers(), strict=True))
    encoder.loss(sequences)
    th.testing.assert_close(encoder.model.variables.rewards.mean, transitions.rewards.mean(dim=(0, 1)))


def test_context_is_the_papers_for_a_hundred_transitions(monkeypatch):
    asked = []
    real = th.randint
    monkeypatch.setattr(th, "randint", lambda low, high, size: asked.append((low, high)) or real(low, high, size))
    encoder = encoder_of(objective="paper")
    for time in (100, 50, 1):
        encoder.bound(transitions_of(2, time))
    assert asked == [(25, 75), (12, 37), (1, 2)]


def test_dense_joint_of_a_whole_history_agrees_with_the_evidence():
    encoder, transitions = encoder_of(process="gaussian"), transitions_of(6)
    _, z, log_det = encoder.see(transitions)
    var, cov = encoder.process.var.item(), encoder.process.cov.item()
    dense = MultivariateNormal(
        th.zeros(6, dtype=th.float64), th.full((6, 6), cov) + (var - cov) * th.eye(6, dtype=th.float64)
    )
    evidence = encoder.process.log_evidence(encoder.process.statistics(z)).item() + log_det.sum().item()
    assert evidence == pytest.approx((dense.log_prob(z[:, 0]) + log_det.sum()).item(), rel=1e-9)

"""The mean embedding beside slow loops: what is kept, what is scored, and that it learns."""

import math

import pytest
import torch as th
from torch.distributions import Normal
from torch.nn import functional as F

from sb3_bruno.encoders import MeanEmbedding, TaskSequences, Transitions
from sb3_bruno.encoders.base import map_memory
from support.small_encoder import transitions_of
from support.toy_tasks import explained, trained

WEIGHTS = th.tensor([[1.0, 2.0, 0.0], [1.0, 0.0, 0.5]], dtype=th.float64)
SEQUENCES = TaskSequences(transitions_of(2, 3), th.zeros(2, 1), WEIGHTS)


def make_encoder(**kwargs):
    th.manual_seed(0)
    encoder = MeanEmbedding(3, 2, net_arch=(16,), latent_dim=3, **kwargs).double()
    encoder.loss(SEQUENCES)  # moves the statistics
    return encoder.eval()


@pytest.mark.parametrize("aggregate", ["mean", "sum"])
def test_the_belief_is_of_the_mean_or_the_sum_and_of_how_many(aggregate):
    encoder = make_encoder(aggregate=aggregate)
    memory = map_memory(lambda prefixes: prefixes[:, -1], encoder.prefixes(*SEQUENCES[::2]))
    for sequence, n in ((0, 3.0), (1, 1.5)):
        total = 0.0
        for t in range(3):
            values = encoder.variables(Transitions(*(column[sequence, t] for column in SEQUENCES.transitions)))
            total = total + WEIGHTS[sequence, t] * encoder.embed(th.cat([*values[:1], values.rewards, values.changes]))
        expected = encoder.rho(total / (n if aggregate == "mean" else 100))
        found = encoder.belief(memory)[sequence]
        th.testing.assert_close(found[:-1], expected)
        assert found[-1].item() == pytest.approx(math.log(1 + n))
        assert float(encoder.count(memory)[sequence]) == n


@pytest.mark.parametrize("modelled", ["rewards", "next_observations", "both"])
def test_the_loss_is_the_surprise_at_every_transition_given_every_prefix(modelled):
    encoder = make_encoder(modelled=modelled)
    transitions, weights = SEQUENCES.transitions, th.ones(2, 3).double()
    beliefs, values = encoder.belief(encoder.prefixes(transitions)), encoder.variables(transitions)
    nats = []
    for sequence in range(2):
        for prefix in range(4):
            for target in range(3):
                here, there, reward, change = (column[sequence, target] for column in values)
                code, score = beliefs[sequence, prefix], 0.0
                if modelled != "next_observations":
                    mean, raw = encoder.decoder.rewards(th.cat([code, here, there]))
                    score = score + Normal(mean, 0.1 + 0.9 * F.softplus(raw)).log_prob(reward).sum()
                if modelled != "rewards":
                    mean, raw = encoder.decoder.changes(th.cat([code, here])).split(3)
                    score = score + Normal(mean, 0.1 + 0.9 * F.softplus(raw)).log_prob(change).sum()
                nats.append(score)
    th.manual_seed(1)
    found = th.stack([encoder.loss(SEQUENCES._replace(weights=weights)).total for _ in range(60)])
    th.testing.assert_close(-found.mean(), th.stack(nats).mean(), rtol=0.02, atol=0.02)


@pytest.mark.parametrize("aggregate", ["mean", "sum"])
def test_it_learns_the_task(aggregate):
    encoder = trained(MeanEmbedding(3, 2, modelled="rewards", net_arch=(32,), aggregate=aggregate))
    assert explained(encoder, 0) < 0.01 < 0.9 < explained(encoder, 3)


def test_taught_by_others_it_has_no_loss_and_still_standardises():
    encoder = make_encoder(learns_from="critic").train()
    before = encoder.variables.rewards.mean.clone()
    shifted = SEQUENCES.transitions._replace(rewards=SEQUENCES.transitions.rewards + 5)
    assert encoder.decoder is None and encoder.loss(SEQUENCES._replace(transitions=shifted)) is None
    assert encoder.variables.rewards.mean > before + 1


@pytest.mark.parametrize(
    ("kwargs", "told"),
    [
        ({"aggregate": "max"}, "`aggregate` must be one of 'mean', 'sum', got 'max'"),
        ({"modelled": "all"}, "`modelled` must be one of 'rewards', 'next_observations', 'both', got 'all'"),
        ({"learns_from": "both"}, "`learns_from` must be one of 'own', 'critic', 'actor', got 'both'"),
        ({"latent_dim": -1}, "`latent_dim` must be finite and at least 1, got -1"),
        ({"net_arch": 64}, r"`net_arch` must hold the size of each layer, such as \(128, 128\), got 64"),
        ({"net_arch": (0,)}, r"`net_arch` must hold the size of each layer, such as \(128, 128\), got \(0,\)"),
        ({"net_arch": (True,)}, r"`net_arch` must hold the size of each layer, such as \(128, 128\), got \(True,\)"),
    ],
)
def test_what_cannot_be_is_refused(kwargs, told):
    with pytest.raises(ValueError, match=told):
        MeanEmbedding(3, 2, **kwargs)

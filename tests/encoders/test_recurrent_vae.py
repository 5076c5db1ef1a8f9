"""VariBAD's loss beside Monte Carlo and slow loops, and what each of its parts is for."""

import pytest
import torch as th
from torch.distributions import Normal

from sb3_bruno.encoders import RecurrentVae, TaskSequences, Transitions
from support.small_encoder import transitions_of
from support.toy_tasks import explained, trained

WEIGHTS = th.tensor([[1.0, 1.0, 0.0], [1.0, 0.0, 1.0]], dtype=th.float64)
SEQUENCES = TaskSequences(transitions_of(2, 3), th.zeros(2, 1), WEIGHTS)


def make_encoder(**kwargs):
    th.manual_seed(0)
    encoder = RecurrentVae(3, 2, hidden_size=8, latent_dim=2, **kwargs).double()
    with th.no_grad():
        encoder.moments.weight *= 5  # so that posteriors differ from one another
    encoder.loss(SEQUENCES)  # moves the statistics
    return encoder.eval()


def posteriors(encoder, sequence):
    """The posteriors of each prefix that counts, and the transitions that count, one by one."""
    memory, found = encoder.empty((1,)), []
    steps = [Transitions(*(column[[sequence], t] for column in SEQUENCES.transitions)) for t in range(3)]
    counted = [step for step, weight in zip(steps, WEIGHTS[sequence], strict=True) if weight > 0]
    found = [encoder.posterior(memory)]
    for step in counted:
        memory = encoder.absorb(memory, step)
        found.append(encoder.posterior(memory))
    return found, counted


def test_the_kl_is_that_of_monte_carlo():
    encoder = make_encoder()
    th.manual_seed(1)
    per_sequence = []
    for sequence in range(2):
        before, kls = Normal(th.zeros(1, 2).double(), th.ones(1, 2).double()), []
        for posterior in posteriors(encoder, sequence)[0]:
            m = posterior.sample((20_000,))
            kls.append((posterior.log_prob(m) - before.log_prob(m)).sum(dim=-1).mean())
            before = posterior
        per_sequence.append(th.stack(kls).mean())
    found = encoder.loss(SEQUENCES).scalars["kl_nats"]
    th.testing.assert_close(found, th.stack(per_sequence).mean(), rtol=0.03, atol=0)


@pytest.mark.parametrize("modelled", ["rewards", "next_observations", "both"])
def test_the_squared_error_is_that_of_every_transition_from_every_prefix(modelled):
    encoder = make_encoder(modelled=modelled)
    th.manual_seed(1)
    errors = []
    for sequence in range(2):
        found, steps = posteriors(encoder, sequence)
        for posterior in found:
            m = posterior.sample((4_000,))[:, 0]
            for step in steps:
                values = encoder.variables(step)
                error = 0.0
                if modelled != "next_observations":
                    x = th.cat([m, values.here.expand(4_000, -1), values.there.expand(4_000, -1)], dim=-1)
                    error = error + (encoder.decoder.rewards(x) - values.rewards)[:, 0] ** 2
                if modelled != "rewards":
                    x = th.cat([m, values.here.expand(4_000, -1)], dim=-1)
                    error = error + ((encoder.decoder.changes(x) - values.changes) ** 2).mean(dim=-1)
                errors.append(error.mean())
    found = th.stack([encoder.loss(SEQUENCES).scalars["squared_error"] for _ in range(80)])
    th.testing.assert_close(found.mean(), th.stack(errors).mean(), rtol=0.03, atol=0)


def test_the_loss_is_the_squared_error_and_the_weighted_kl():
    for kl_weight in (0.0, 0.02, 3.0):
        total, scalars = make_encoder(kl_weight=kl_weight).loss(SEQUENCES)
        th.testing.assert_close(total, scalars["squared_error"] + kl_weight * scalars["kl_nats"])


def test_it_learns_the_task_and_the_latent_variable_is_the_prior_before():
    encoder = trained(RecurrentVae(3, 2, modelled="rewards", hidden_size=16))
    assert explained(encoder, 0) < 0.01 < 0.95 < explained(encoder, 3)
    prior = encoder.posterior(encoder.empty())
    assert prior.mean.abs().max() < 0.5 and (prior.stddev - 1).abs().max() < 0.5


def test_a_heavy_kl_leaves_nothing_to_know():
    encoder = trained(RecurrentVae(3, 2, modelled="rewards", hidden_size=16, kl_weight=100.0), 40)
    memory = encoder.prefixes(SEQUENCES.transitions._make(column.float() for column in SEQUENCES.transitions))
    assert encoder.posterior(memory).mean.std(dim=(0, 1)).max() < 0.05


def test_no_kl_leaves_the_posterior_away_from_the_prior():
    heavy, none = (
        trained(RecurrentVae(3, 2, modelled="rewards", hidden_size=16, kl_weight=weight), 30) for weight in (1.0, 0.0)
    )
    kl_of_heavy, kl_of_none = (float(encoder.loss(toy()).scalars["kl_nats"]) for encoder in (heavy, none))
    assert kl_of_none > 3 * kl_of_heavy


def toy():
    return SEQUENCES._replace(
        transitions=Transitions(*(column.float() for column in SEQUENCES.transitions)), weights=WEIGHTS.float()
    )


def test_taught_by_others_it_has_no_decoder_and_the_kl_alone_is_its_own():
    encoder = make_encoder(learns_from="critic", kl_weight=0.5)
    assert encoder.decoder is None
    total, scalars = encoder.loss(SEQUENCES)
    assert set(scalars) == {"kl_nats"}
    th.testing.assert_close(total, 0.5 * scalars["kl_nats"])


def test_the_belief_is_mean_and_log_variance():
    encoder = make_encoder()
    memory = encoder.prefixes(*SEQUENCES[::2])
    posterior = encoder.posterior(memory)
    th.testing.assert_close(encoder.belief(memory), th.cat([posterior.mean, posterior.variance.log()], dim=-1))


@pytest.mark.parametrize(
    ("kwargs", "told"),
    [
        ({"modelled": "reward"}, r"`modelled` must be one of 'rewards', 'next_observations', 'both', got 'reward'"),
        ({"learns_from": "critics"}, "`learns_from` must be one of 'own', 'critic', 'actor', got 'critics'"),
        ({"latent_dim": 0}, "`latent_dim` must be finite and at least 1, got 0"),
        ({"kl_weight": -0.1}, "`kl_weight` must be finite and at least 0, got -0.1"),
        ({"kl_weight": float("nan")}, "`kl_weight` must be finite and at least 0, got nan"),
        ({"hidden_size": 0}, "`hidden_size` must be finite and at least 1, got 0"),
    ],
)
def test_what_cannot_be_is_refused(kwargs, told):
    with pytest.raises(ValueError, match=told):
        RecurrentVae(3, 2, **kwargs)

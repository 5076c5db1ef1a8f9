"""The way of a loss back to sampled beliefs, by numbers that can be counted."""

import pytest
import torch as th

from sb3_bruno.buffers.critic_gradient import BeliefGradient
from sb3_bruno.encoders import TaskSequences, Transitions

COLUMNS = slice(1, 3)


def gradient_of(weight, n_sequences=2, time=3):
    """Beliefs = weight * (place, -place), so that what arrives at the weight tells which places were scored."""
    places = th.arange(1.0, n_sequences * time + 1).reshape(n_sequences, time, 1)
    beliefs = weight * th.cat([places, -places], dim=-1)
    nothing = Transitions(*(th.zeros(n_sequences, time, 1) for _ in range(4)))
    return BeliefGradient(TaskSequences(nothing, th.zeros(n_sequences, 1)), beliefs, COLUMNS), beliefs


def observations_of(beliefs, places):
    here = beliefs.detach().flatten(0, 1)[places]
    return th.cat([th.zeros(len(here), 1), here, th.zeros(len(here), 2)], dim=1)


def test_a_losss_gradient_reaches_the_encoder_as_if_nothing_were_cut():
    weight = th.tensor(2.0, requires_grad=True)
    gradient, beliefs = gradient_of(weight)
    places = th.tensor([4, 0, 4])  # a belief sampled twice counts twice
    leaf = gradient.leaf(observations_of(beliefs, places), places)
    assert leaf.is_leaf and leaf.grad is None
    leaf.pow(3).sum().backward()
    gradient.collect()
    gradient.backward()
    whole = th.tensor(2.0, requires_grad=True)
    _, uncut = gradient_of(whole)
    uncut.flatten(0, 1)[places].pow(3).sum().backward()
    assert weight.grad == pytest.approx(whole.grad.item())


def test_several_samples_of_one_encode_give_the_mean_of_their_gradients():
    weight = th.tensor(2.0, requires_grad=True)
    gradient, beliefs = gradient_of(weight)
    expected = []
    for places in (th.tensor([0, 1]), th.tensor([5, 3])):
        leaf = gradient.leaf(observations_of(beliefs, places), places)
        leaf[:, COLUMNS][:, 0].sum().backward()
        gradient.collect()
        expected.append((places + 1).sum().item())
    gradient.backward()
    assert weight.grad == pytest.approx(sum(expected) / 2) and gradient.n_collected == 2


def test_what_is_dropped_teaches_nothing():
    weight = th.tensor(2.0, requires_grad=True)
    gradient, beliefs = gradient_of(weight)
    leaf = gradient.leaf(observations_of(beliefs, th.tensor([0])), th.tensor([0]))
    (100 * leaf).sum().backward()
    gradient.drop()
    leaf[:, 1].sum().backward()
    gradient.collect()
    gradient.backward()
    assert weight.grad == 1


def test_other_columns_than_the_beliefs_teach_nothing():
    weight = th.tensor(2.0, requires_grad=True)
    gradient, beliefs = gradient_of(weight)
    leaf = gradient.leaf(observations_of(beliefs, th.tensor([2])), th.tensor([2]))
    (leaf[:, 0] + leaf[:, 3:].sum(dim=1)).sum().backward()
    gradient.collect()
    gradient.backward()
    assert weight.grad == 0

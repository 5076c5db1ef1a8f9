"""The transformer beside a slow one that attends step by step, and how far it sees."""

import math

import pytest
import torch as th

from sb3_bruno.encoders import CausalTransformer, Transitions
from support.largest_tensor import LargestTensor
from support.small_encoder import transitions_of


def make(**kwargs):
    th.manual_seed(0)
    encoder = CausalTransformer(3, 2, **{"hidden_size": 8, "n_heads": 2, "window": 4, **kwargs}).double()
    for layer in encoder.layers:
        th.nn.init.normal_(layer.of_distance)
    return encoder


def attend_slowly(layer, x):
    """One layer over one sequence, (time, 8), each step and each head by itself."""
    normed = layer.before_attention(x)
    keys, values = layer.key_and_value(normed).chunk(2, dim=-1)
    queries, outputs = layer.query(normed), []
    for i in range(len(x)):
        seen = range(max(i - layer.window + 1, 0), i + 1)
        heads = []
        for h in range(2):
            part = slice(4 * h, 4 * h + 4)
            scores = [queries[i, part] @ keys[j, part] / math.sqrt(4) + layer.of_distance[h, i - j] for j in seen]
            weights = th.stack(scores).softmax(dim=0)
            heads.append(sum(weight * values[j, part] for weight, j in zip(weights, seen, strict=True)))
        outputs.append(x[i] + layer.out(th.cat(heads)))
    x = th.stack(outputs)
    return x + layer.mlp(x)


@pytest.mark.parametrize("time", [3, 4, 11])
def test_blocks_are_attention_step_by_step(time):
    encoder, transitions = make(), transitions_of(2, time)
    found = encoder.belief(encoder.prefixes(transitions))
    for i in range(2):
        x = encoder.embedding(th.cat([column[i] for column in transitions], dim=-1))
        for layer in encoder.layers:
            x = attend_slowly(layer, x)
        th.testing.assert_close(found[i, 1:], encoder.norm(x))
    assert not found[:, 0].any()


@pytest.mark.parametrize(("n_layers", "reach"), [(1, 4), (2, 7)])
def test_each_layer_sees_a_window_farther(n_layers, reach):
    encoder, transitions = make(n_layers=n_layers), transitions_of(1, 12)
    belief = encoder.belief(encoder.prefixes(transitions))[0, -1]
    for age in (reach - 1, reach):
        rewards = transitions.rewards.clone()
        rewards[:, 11 - age] += 1.0
        changed = encoder.belief(encoder.prefixes(transitions._replace(rewards=rewards)))[0, -1]
        assert th.equal(belief, changed) == (age == reach)


def test_positions_are_relative():
    """Once the window is full, when an episode began makes no difference."""
    encoder, transitions = make(), transitions_of(1, 20)
    later = Transitions(*(column[:, 5:] for column in transitions))
    found, expected = (encoder.belief(encoder.prefixes(columns))[:, -1] for columns in (transitions, later))
    th.testing.assert_close(found, expected)


@pytest.mark.parametrize("weights", [None, th.ones(2, 50).double()])
def test_windows_of_prefixes_take_no_memory_where_all_counts(weights):
    encoder, transitions = make(window=64), transitions_of(2, 50)
    windows = encoder.prefixes(transitions, weights).window
    assert windows.untyped_storage().nbytes() < windows.numel() * windows.element_size() / 20


@pytest.mark.parametrize("n_left_out", [0, 1, 300])
def test_no_windows_are_copied_for_the_last_memory_but_its_own(n_left_out):
    encoder, transitions, weights = make(window=64), transitions_of(2, 300), th.ones(2, 300).double()
    weights[:, :n_left_out] = 0
    with LargestTensor() as largest:
        memory = encoder.last(transitions, weights)
    assert largest.n_bytes < 301 * memory.window.nbytes / 4


@pytest.mark.parametrize(
    ("kwargs", "remedy"),
    [({"n_heads": 3}, "does not divide `hidden_size=8`"), ({"window": 0}, "at least 1"), ({"n_layers": 0}, "at least")],
)
def test_what_cannot_work_is_refused(kwargs, remedy):
    with pytest.raises(ValueError, match=remedy):
        make(**kwargs)

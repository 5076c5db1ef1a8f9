"""SplAgger's halves, step by step."""

import pytest
import torch as th

from sb3_bruno.encoders import SplitAggregator
from support.small_encoder import transitions_of


def make(**kwargs):
    th.manual_seed(0)
    return SplitAggregator(3, 2, hidden_size=8, output_dim=5, **kwargs).double()


@pytest.mark.parametrize("reduce", ["max", "mean"])
def test_one_half_passes_and_the_other_is_reduced(reduce):
    encoder, transitions = make(reduce=reduce), transitions_of(4, 20)
    cell = th.nn.GRUCell(8, 8).double()
    cell.load_state_dict({name.removesuffix("_l0"): x for name, x in encoder.reader.rnn.state_dict().items()})
    features = encoder.reader.features(th.cat(transitions, dim=-1))
    hidden, seen, beliefs = th.zeros(4, 8, dtype=th.float64), [], encoder.belief(encoder.prefixes(transitions))
    for t in range(20):
        hidden = cell(features[:, t], hidden)
        seen.append(hidden[:, 4:])
        so_far = th.stack([*seen, th.zeros_like(seen[0])] if reduce == "max" else seen)  # a maximum starts at 0
        reduced = so_far.amax(dim=0) if reduce == "max" else so_far.mean(dim=0)
        th.testing.assert_close(beliefs[:, t + 1], encoder.head(th.cat([hidden[:, :4], reduced], dim=-1)))


@pytest.mark.parametrize("reduce", ["max", "mean"])
def test_without_a_network_the_features_are_reduced_in_any_order(reduce):
    encoder, transitions = make(reduce=reduce, rnn=False), transitions_of(4, 6)
    features = encoder.reader(th.cat(transitions, dim=-1))
    reduced = features.amax(dim=1) if reduce == "max" else features.mean(dim=1)
    th.testing.assert_close(encoder.belief(encoder.prefixes(transitions))[:, -1], encoder.head(reduced))
    assert (encoder.order, make().order) == ("any", "time")
    assert not [name for name, _ in encoder.named_parameters() if "rnn" in name]


@pytest.mark.parametrize(
    ("kwargs", "remedy"),
    [
        ({"reduce": "sum"}, "'max', 'mean', got 'sum'"),
        ({"hidden_size": 7}, "no halves to split: give an even number"),
        ({"hidden_size": 0}, "at least 1"),
        ({"output_dim": 0}, "at least 1"),
    ],
)
def test_what_cannot_work_is_refused(kwargs, remedy):
    with pytest.raises(ValueError, match=remedy):
        SplitAggregator(3, 2, **kwargs)

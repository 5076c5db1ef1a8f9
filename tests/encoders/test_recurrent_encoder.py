"""The recurrent encoder beside torch's own network, step by step, and what GPUs ask of its inputs."""

import pytest
import torch as th

from sb3_bruno.encoders import RecurrentEncoder, Transitions
from support.small_encoder import transitions_of


def make_encoder(cell):
    th.manual_seed(0)
    return RecurrentEncoder(3, 2, cell=cell, hidden_size=8).double()


@pytest.mark.parametrize("cell", ["gru", "lstm"])
def test_prefixes_are_the_states_of_torchs_cell_run_step_by_step(cell):
    encoder, transitions = make_encoder(cell), transitions_of(4, 20)
    one_step = {"gru": th.nn.GRUCell, "lstm": th.nn.LSTMCell}[cell](8, 8).double()
    one_step.load_state_dict({name.removesuffix("_l0"): value for name, value in encoder.rnn.state_dict().items()})
    features = encoder.features(th.cat(transitions, dim=-1))
    hidden = cell_state = th.zeros(4, 8, dtype=th.float64)
    prefixes = encoder.prefixes(transitions)
    for t in range(20):
        if cell == "gru":
            hidden = one_step(features[:, t], hidden)
        else:
            hidden, cell_state = one_step(features[:, t], (hidden, cell_state))
            th.testing.assert_close(prefixes.cell[:, t + 1], cell_state)
        th.testing.assert_close(prefixes.hidden[:, t + 1], hidden)


@pytest.mark.parametrize("cell", ["gru", "lstm"])
def test_the_network_is_given_contiguous_states_as_cudnn_needs_them(monkeypatch, cell):
    encoder, transitions = make_encoder(cell), transitions_of(4, 5)
    prefixes = encoder.prefixes(transitions)
    memory = type(prefixes)(*(states[:, 3] for states in prefixes))
    assert not memory.hidden.is_contiguous()
    seen, forward = [], encoder.rnn.forward

    def watched(x, states):
        seen.extend([x, *(states if cell == "lstm" else [states])])
        return forward(x, states)

    monkeypatch.setattr(encoder.rnn, "forward", watched)
    encoder.absorb(memory, Transitions(*(column[:, 3] for column in transitions)))
    assert len(seen) == (3 if cell == "lstm" else 2) and all(tensor.is_contiguous() for tensor in seen)


def test_a_whole_episode_that_does_not_count_leaves_the_start():
    encoder = make_encoder("gru")
    found = encoder.prefixes(transitions_of(2, 4), th.zeros(2, 4, dtype=th.float64))
    assert not found.hidden.any()


@pytest.mark.parametrize(
    ("kwargs", "told"),
    [
        ({"cell": "rnn"}, "`cell` must be one of 'gru', 'lstm', got 'rnn'"),
        ({"cell": ["gru"]}, r"`cell` must be one of 'gru', 'lstm', got \['gru'\]"),
        ({"hidden_size": 0}, "`hidden_size` must be finite and at least 1, got 0"),
        ({"learns_from": "own"}, "`learns_from` must be 'critic' or 'actor', got 'own': it has no own loss"),
        ({"max_grad_norm": 0.0}, "`max_grad_norm` must be positive, got 0.0"),
    ],
)
def test_what_cannot_be_is_refused(kwargs, told):
    with pytest.raises(ValueError, match=told):
        RecurrentEncoder(3, 2, **kwargs)

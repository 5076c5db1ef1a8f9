"""The gradient that reaches an encoder is that of SB3's own loss, end to end; it is clipped, and its norm logged."""

import pytest
import torch as th

from sb3_bruno import RecurrentCrossQ, RecurrentTD3, TaskSAC
from sb3_bruno.buffers.critic_gradient import BeliefGradient
from sb3_bruno.encoders import Loss, RecurrentEncoder
from support.taught import ALGORITHMS, Stop, make_model, stop


def gradients(encoder):
    return [parameter.grad.clone() for parameter in encoder.parameters()]


@pytest.mark.parametrize("teacher", ["critic", "actor"])
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_the_gradient_is_that_of_sb3s_loss_differentiated_end_to_end(monkeypatch, algorithm, teacher):
    own = {"policy_delay": 1} if algorithm in (RecurrentCrossQ, RecurrentTD3) else {}
    critic_input = "both" if teacher == "critic" else "belief"
    options = {"encoder_kwargs": {"hidden_size": 8, "learns_from": teacher}, "critic_input": critic_input, **own}
    check_gradient(monkeypatch, algorithm, options)


TAUGHT = {
    "product": ("product_of_gaussians", {"net_arch": (8,), "kl_weight": 0.0}),
    "sample": ("product_of_gaussians", {"net_arch": (8,), "kl_weight": 0.0, "belief": "sample"}),
    "no bottleneck": ("product_of_gaussians", {"net_arch": (8,), "information_bottleneck": False}),
    "split": ("split_aggregator", {"hidden_size": 8, "output_dim": 4}),
    "split mean": ("split_aggregator", {"hidden_size": 8, "output_dim": 4, "reduce": "mean"}),
    "features' maximum": ("split_aggregator", {"hidden_size": 8, "output_dim": 4, "rnn": False}),
    "transformer": ("causal_transformer", {"hidden_size": 8, "n_heads": 2, "window": 8}),
}
"""Encoders that the critics teach, with nothing that their own loss adds."""


@pytest.mark.parametrize("case", TAUGHT)
def test_the_gradient_is_that_end_to_end_for_every_encoder_that_the_critics_teach(monkeypatch, case):
    name, encoder_kwargs = TAUGHT[case]
    check_gradient(monkeypatch, TaskSAC, {"encoder_class": name, "encoder_kwargs": encoder_kwargs})


def check_gradient(monkeypatch, algorithm, options):
    ours, theirs = (make_model(algorithm, **options) for _ in range(2))

    # Ours: what the hooks collect, before clipping and the optimiser's step.
    monkeypatch.setattr(ours, "_step_encoder", lambda: None)
    th.manual_seed(1)
    ours.train(1, 16)

    # Theirs: the graph from loss to encoder is never cut, and kept for the actor's backward pass.
    def uncut(self, observations, places):
        beliefs = self._beliefs.flatten(0, 1)[places]
        return th.cat([observations[:, : self._columns.start], beliefs, observations[:, self._columns.stop :]], dim=1)

    backward = th.Tensor.backward
    monkeypatch.setattr(BeliefGradient, "leaf", uncut)
    monkeypatch.setattr(th.Tensor, "backward", lambda self: backward(self, retain_graph=True))
    monkeypatch.setattr(theirs, "_drop_gradient", lambda *_: theirs.encoder.zero_grad())
    monkeypatch.setattr(theirs, "_collect_gradient", stop)
    th.manual_seed(1)
    with pytest.raises(Stop):
        theirs.train(1, 16)
    for found, expected in zip(gradients(ours.encoder), gradients(theirs.encoder), strict=True):
        assert expected.abs().max() > 0
        th.testing.assert_close(found, expected, rtol=1e-4, atol=1e-7)


def test_the_encoders_gradient_is_clipped_and_its_norm_logged(monkeypatch):
    model = make_model(encoder_kwargs={"hidden_size": 8, "max_grad_norm": 1e-3})
    norms = []
    step = model.encoder_optimizer.step

    def watched():
        norms.append(th.cat([gradient.flatten() for gradient in gradients(model.encoder)]).norm().item())
        step()

    monkeypatch.setattr(model.encoder_optimizer, "step", watched)
    model.train(4, 16)
    assert max(norms) <= 1e-3 * (1 + 1e-4)
    assert model.logger.name_to_value["encoder/gradient_norm"] > 1e-3


def test_the_norm_of_a_gradient_that_is_not_clipped_is_logged_too():
    model = make_model(encoder_kwargs={"hidden_size": 8, "max_grad_norm": None})
    model.train(4, 16)
    assert model.logger.name_to_value["encoder/gradient_norm"] > 0


class Opinionated(RecurrentEncoder):
    """Learns from the critics, and wants each of its parameters to be smaller by a loss of its own."""

    strength = 0.0

    def loss(self, sequences):
        assert self.training and sequences.tasks.shape == (4, 2)
        total = self.strength * sum(parameter.sum() for parameter in self.parameters())
        return Loss(total, {"total": total.detach()})


def test_a_loss_of_its_own_is_added_to_what_teaches_the_encoder_and_logged(monkeypatch):
    found = {}
    for strength in (0.0, 3.0):
        monkeypatch.setattr(Opinionated, "strength", strength)
        model = make_model(encoder_class=Opinionated)
        monkeypatch.setattr(model, "_step_encoder", lambda: None)
        th.manual_seed(1)
        model.train(1, 16)
        found[strength] = gradients(model.encoder)
    for without, with_it in zip(found[0.0], found[3.0], strict=True):
        th.testing.assert_close(with_it, without + 3.0)
    total = 3.0 * sum(parameter.sum() for parameter in model.encoder.parameters())
    assert model.logger.name_to_value["encoder/total"] == pytest.approx(total.item())
    assert not model.encoder.training

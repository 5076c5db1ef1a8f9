"""What every encoder promises, whatever it is made of."""

import inspect
from typing import get_type_hints

import pytest
import torch as th

from sb3_bruno.encoders import (
    ENCODERS,
    BrunoEncoder,
    CausalTransformer,
    HasPosterior,
    MeanEmbedding,
    MeasuresDistance,
    Predicts,
    ProductOfGaussians,
    RandomFeatures,
    RecurrentEncoder,
    RecurrentVae,
    SplitAggregator,
    SupervisedBelief,
    TaskSequences,
    Transitions,
    find_encoder,
)
from sb3_bruno.encoders.base import map_memory
from sb3_bruno.encoders.bruno_arguments import BrunoArguments
from sb3_bruno.encoders.causal_transformer import TransformerArguments
from sb3_bruno.encoders.mean_embedding import EmbeddingArguments
from sb3_bruno.encoders.product_arguments import ProductArguments
from sb3_bruno.encoders.random_features import RandomArguments
from sb3_bruno.encoders.recurrent import RecurrentArguments
from sb3_bruno.encoders.recurrent_vae import VaeArguments
from sb3_bruno.encoders.split_aggregator import SplitArguments
from sb3_bruno.encoders.supervised_belief import SupervisedArguments
from support.small_encoder import SMALL, transitions_of
from support.stream import Recorder

CASES = {
    "bruno": (BrunoEncoder, {}),
    "bruno-both": (BrunoEncoder, {**SMALL, "modelled": "both"}),
    "bruno-student-t": (BrunoEncoder, {**SMALL, "modelled": "rewards", "process": "kernel_student_t"}),
    "bruno-paper": (BrunoEncoder, {**SMALL, "condition_on_next": False, "process": "gaussian", "extra_dims": 4}),
    "bruno-mean": (BrunoEncoder, {**SMALL, "modelled": "next_observations", "belief": "mean"}),
    "gru": (RecurrentEncoder, {"hidden_size": 8}),
    "lstm": (RecurrentEncoder, {"hidden_size": 8, "cell": "lstm", "learns_from": "actor"}),
    "product": (ProductOfGaussians, {"net_arch": (16,)}),
    "product-sample": (ProductOfGaussians, {"net_arch": (16,), "belief": "sample", "prior_factor": False}),
    "product-held": (ProductOfGaussians, {"net_arch": (16,), "belief": "sample", "exploration_episodes": 2}),
    "product-no-bottleneck": (ProductOfGaussians, {"net_arch": (16,), "information_bottleneck": False}),
    "split": (SplitAggregator, {"hidden_size": 8}),
    "split-mean": (SplitAggregator, {"hidden_size": 8, "reduce": "mean"}),
    "max": (SplitAggregator, {"hidden_size": 8, "rnn": False}),
    "mean": (SplitAggregator, {"hidden_size": 8, "rnn": False, "reduce": "mean"}),
    "transformer": (CausalTransformer, {"hidden_size": 8, "n_heads": 2, "window": 4}),  # shorter than the sequences
    "transformer-wide": (CausalTransformer, {"hidden_size": 8, "n_heads": 2, "n_layers": 1}),
    "random": (RandomFeatures, {"n_features": 8}),
    "vae": (RecurrentVae, {"hidden_size": 8}),
    "vae-by-critic": (RecurrentVae, {"hidden_size": 8, "learns_from": "critic"}),
    "supervised": (SupervisedBelief, {"hidden_size": 8}),
    "supervised-code": (SupervisedBelief, {"hidden_size": 8, "bottleneck": 0.1, "belief": "moments"}),
    "supervised-mixture": (SupervisedBelief, {"hidden_size": 8, "head": "mixture"}),
    "embedding": (MeanEmbedding, {"net_arch": (16,)}),
    "embedding-sum": (MeanEmbedding, {"net_arch": (16,), "aggregate": "sum", "learns_from": "critic"}),
}
ARGUMENTS = {
    BrunoEncoder: BrunoArguments,
    CausalTransformer: TransformerArguments,
    MeanEmbedding: EmbeddingArguments,
    ProductOfGaussians: ProductArguments,
    RandomFeatures: RandomArguments,
    RecurrentEncoder: RecurrentArguments,
    RecurrentVae: VaeArguments,
    SplitAggregator: SplitArguments,
    SupervisedBelief: SupervisedArguments,
}


@pytest.fixture(params=CASES)
def encoder(request):
    """An encoder of observations (3,), actions (2,) and tasks (2,), in float64."""
    encoder_class, kwargs = CASES[request.param]
    th.manual_seed(0)
    return encoder_class.build(3, 2, 2, **kwargs).double()


def weights_of(*shape):
    return (th.rand(*shape, generator=th.Generator().manual_seed(1)) < 0.6).double()


def at(memory, index):
    return map_memory(lambda prefixes: prefixes[..., index, :], memory)


def assert_close(memory, other, **tolerance):
    assert type(memory) is type(other)
    for tensor, expected in zip(memory, other, strict=True):
        th.testing.assert_close(tensor, expected, **tolerance)


def learn(encoder, sequences):
    """Give each parameter its gradient, of the loss of its own and of one that reads beliefs, where that teaches it."""
    loss, total = encoder.loss(sequences), th.zeros(()).double()
    if loss is not None:
        assert loss.total.shape == () and all(scalar.shape == () for scalar in loss.scalars.values())
        total = total + loss.total
    if encoder.learns_from != "own":
        total = total + (encoder.belief(encoder.prefixes(sequences.transitions, sequences.weights)) ** 2).sum()
    if total.requires_grad:
        total.backward()


def test_every_encoder_with_a_name_is_tested():
    assert {encoder_class for encoder_class, _ in CASES.values()} == set(ENCODERS.values()) == set(ARGUMENTS)


@pytest.mark.parametrize("batch_shape", [(), (3,), (2, 3)])
def test_prefixes_are_absorbing_one_by_one(encoder, batch_shape):
    transitions, weights = transitions_of(*batch_shape, 9), weights_of(*batch_shape, 9)
    prefixes, memory = encoder.prefixes(transitions, weights), encoder.empty(batch_shape)
    for t in range(10):
        assert_close(at(prefixes, t), memory)
        assert encoder.belief(memory).shape == (*batch_shape, encoder.belief_dim)
        if t < 9:
            after = encoder.absorb(memory, Transitions(*(column[..., t, :] for column in transitions)))
            counts = weights[..., t, None] > 0
            memory = map_memory(lambda new, old, counts=counts: th.where(counts, new, old), after, memory)


def test_the_last_memory_is_that_of_all_transitions(encoder):
    for batch_shape in ((), (3,), (2, 3)):
        transitions, weights = transitions_of(*batch_shape, 9), weights_of(*batch_shape, 9)
        uneven = weights * th.linspace(0.5, 2.5, 9).double()
        for given in (None, th.ones_like(weights), weights, uneven, 0 * weights):
            expected = at(encoder.prefixes(transitions, given), -1)
            assert_close(encoder.last(transitions, given), expected, rtol=0, atol=0)


@pytest.mark.parametrize("batch_shape", [(), (3,), (2, 3), (0,)])
def test_of_no_transitions_the_last_memory_is_empty(encoder, batch_shape):
    nothing = transitions_of(*batch_shape, 0)
    for weights in (None, th.ones(*batch_shape, 0).double()):
        assert_close(encoder.last(nothing, weights), encoder.empty(batch_shape), rtol=0, atol=0)


def test_the_last_memory_may_hold_tensors_of_any_shape():
    class InMatrices(Recorder):
        def prefixes(self, transitions, weights=None):
            return map_memory(lambda states: states.unflatten(-1, (1, 2)), super().prefixes(transitions, weights))

    transitions = Transitions(*(th.ones(4, 9, 1) for _ in range(4)))
    th.testing.assert_close(InMatrices().last(transitions), (th.full((4, 1, 2), 9.0),))


def test_without_weights_all_count(encoder):
    transitions = transitions_of(4, 9)
    assert_close(encoder.prefixes(transitions), encoder.prefixes(transitions, th.ones(4, 9).double()))


@pytest.mark.parametrize("anything", [7.0, 1e300, float("inf"), float("nan")])
def test_a_transition_of_weight_zero_may_be_anything(encoder, anything):
    transitions, weights = transitions_of(4, 9), weights_of(4, 9)
    weights[-1] = 0  # padding from end to end
    padded = Transitions(*(th.where(weights[..., None] > 0, column, anything) for column in transitions))
    assert_close(encoder.prefixes(padded, weights), encoder.prefixes(transitions, weights))
    th.manual_seed(0)
    learn(encoder, TaskSequences(padded, th.randn(4, 2).double(), weights))
    gradients = [parameter.grad for parameter in encoder.parameters() if parameter.grad is not None]
    assert all(gradient.isfinite().all() for gradient in gradients)


def test_a_transition_of_another_weight_counts_as_often_or_in_an_order_once(encoder):
    transitions, weights = transitions_of(4, 9), weights_of(4, 9)
    uneven = weights * th.linspace(0.5, 2.5, 9).double()
    if encoder.order == "time":
        other = encoder.prefixes(transitions, weights)
    else:
        twice = Transitions(*(column.repeat_interleave(2, dim=-2) for column in transitions))
        other = map_memory(lambda x: x[:, ::2], encoder.prefixes(twice, uneven.repeat_interleave(2, dim=-1) / 2))
    th.testing.assert_close(encoder.belief(encoder.prefixes(transitions, uneven)), encoder.belief(other))


def test_order_matters_where_the_encoder_says_so_and_only_there(encoder):
    transitions = transitions_of(4, 20)
    turned = Transitions(*(column.flip(-2) for column in transitions))
    belief, other = (encoder.belief(at(encoder.prefixes(columns), -1)) for columns in (transitions, turned))
    assert th.allclose(belief, other, rtol=1e-9, atol=1e-11) == (encoder.order == "any")


def test_another_episode_starts_from_the_memory(encoder):
    memory = at(encoder.prefixes(transitions_of(4, 5)), -1)
    begun = encoder.start_episode(memory)
    assert_close(encoder.with_noise_of(begun, memory), memory)
    if encoder.belief(begun).equal(encoder.belief(memory)):
        assert_close(begun, memory)


def test_beliefs_of_prefixes_share_the_noise_that_they_are_given(encoder):
    transitions, weights = transitions_of(4, 9), weights_of(4, 9)
    noise = encoder.redraw(encoder.empty((4, 1)))
    memory = encoder.with_noise_of(encoder.prefixes(transitions, weights), noise)
    th.testing.assert_close(encoder.prefix_beliefs(transitions, weights, noise), encoder.belief(memory))
    th.testing.assert_close(encoder.belief(noise)[:, 0], encoder.belief(at(memory, 0)))


def test_single_precision_is_near_double_after_a_thousand_steps(encoder):
    transitions = transitions_of(2, 1_000)
    with th.no_grad():
        exact = encoder.belief(encoder.prefixes(transitions))
        single = encoder.float()
        found = single.belief(single.prefixes(Transitions(*(column.float() for column in transitions))))
    th.testing.assert_close(found.double(), exact, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("factor", [1e3, 0.0])
def test_a_belief_is_finite_at_rewards_of_any_size(encoder, factor):
    transitions = transitions_of(2, 100)
    belief = encoder.belief(encoder.prefixes(transitions._replace(rewards=factor * transitions.rewards)))
    assert belief.isfinite().all()


def test_what_teaches_it_reaches_every_parameter(encoder):
    if not any(parameter.requires_grad for parameter in encoder.parameters()):
        return
    learn(encoder, TaskSequences(transitions_of(4, 9), th.randn(4, 2).double(), weights_of(4, 9)))
    for name, parameter in encoder.named_parameters():
        assert parameter.grad.isfinite().all() and parameter.grad.abs().sum() > 0, name


def test_a_saved_encoder_believes_the_same(encoder, request):
    encoder.loss(TaskSequences(transitions_of(4, 9), th.zeros(4, 2).double()))  # moves running statistics, if any
    encoder_class, kwargs = CASES[request.node.callspec.params["encoder"]]
    other = encoder_class.build(3, 2, 2, **kwargs).double()
    other.load_state_dict(encoder.state_dict())
    transitions = transitions_of(4, 9)
    th.testing.assert_close(
        other.belief(other.prefixes(transitions)), encoder.belief(encoder.prefixes(transitions)), rtol=0, atol=0
    )


def test_scalars_of_diagnostics_are_scalars(encoder):
    assert all(scalar.shape == () for scalar in encoder.diagnostics().values())


def test_abilities_are_honoured(encoder):
    transitions = transitions_of(4, 9)
    memory, now = at(encoder.prefixes(transitions), 5), Transitions(*(column[:, 5] for column in transitions))
    if isinstance(encoder, HasPosterior):
        posterior = encoder.posterior(memory)
        assert posterior.mean.shape[0] == 4 and (posterior.variance > 0).all()
        usual = transitions._replace(rewards=0.0 * transitions.rewards)  # a surprise may make less sure of the scale
        before, after = encoder.posterior(encoder.empty((4,))), encoder.posterior(at(encoder.prefixes(usual), -1))
        if encoder.order == "any":  # by Bayes' rule; a network has to learn it
            assert after.variance.mean() < before.variance.mean()  # what was seen makes surer
    if isinstance(encoder, Predicts):
        outcomes = encoder.outcomes(memory, now.observations, now.actions, now.next_observations, 7)
        shapes = [None if samples is None else tuple(samples.shape) for samples in outcomes]
        assert set(shapes) - {None} <= {(7, 4, 1), (7, 4, 3)} and any(shapes)
        assert encoder.one_step_scores(transitions).shape == (4, 9)
        nothing = encoder.log_bayes_factor(encoder.empty((4,)), now)
        th.testing.assert_close(nothing, th.zeros(4).double())  # the prior against itself
        assert encoder.log_bayes_factor(memory, now).abs().min() > 0
    if isinstance(encoder, MeasuresDistance):
        assert (encoder.distance(transitions).beta >= 0).all()


@pytest.mark.parametrize("encoder_class", ARGUMENTS)
def test_the_typed_arguments_are_those_of_the_constructor(encoder_class):
    parameters = inspect.signature(encoder_class).parameters
    taken = [name for name in parameters if name not in ("observation_dim", "action_dim", "task_dim")]
    assert list(get_type_hints(ARGUMENTS[encoder_class])) == taken
    assert set(encoder_class.search_space) <= set(taken)


@pytest.mark.parametrize("encoder_class", ARGUMENTS)
def test_every_choice_of_the_search_space_can_be_built(encoder_class):
    for name, choices in encoder_class.search_space.items():
        for choice in choices:
            encoder_class.build(3, 2, 1, **{name: choice})


def test_encoders_are_found_by_name_or_class():
    assert find_encoder("recurrent") is find_encoder(RecurrentEncoder) is RecurrentEncoder
    with pytest.raises(ValueError, match=r"'brnuo'` is unknown: use one of \['bruno', .*'recurrent'"):
        find_encoder("brnuo")
    with pytest.raises(ValueError, match="no `TaskEncoder`"):
        find_encoder(th.nn.Linear)

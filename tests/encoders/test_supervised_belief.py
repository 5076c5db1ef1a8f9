"""The supervised belief beside slow loops and hand computations, and that it knows what it is told."""

import pytest
import torch as th
from torch.distributions import Normal
from torch.nn import functional as F

from sb3_bruno.encoders import InfersTask, SupervisedBelief, TaskSequences, Transitions
from sb3_bruno.encoders.task_heads import GaussianHead, OneHotHead
from support.small_encoder import transitions_of
from support.toy_tasks import explained, memory_after, trained

WEIGHTS = th.tensor([[1.0, 1.0, 0.0], [1.0, 0.0, 1.0]], dtype=th.float64)
TASKS = th.tensor([[500.0, 0.1], [-300.0, 0.3]], dtype=th.float64)
SEQUENCES = TaskSequences(transitions_of(2, 3), TASKS, WEIGHTS)


def make_encoder(**kwargs):
    th.manual_seed(0)
    encoder = SupervisedBelief(3, 2, 2, **{"hidden_size": 8, "feature_dim": 8, **kwargs}).double()
    if kwargs.get("head") != "one_hot":
        encoder.loss(SEQUENCES)  # moves the statistics
    return encoder.eval()


def mean_over_prefixes(encoder, score):
    """The mean of a score of memory and task over the prefixes that count, one by one, then over sequences."""
    means = []
    for sequence in range(2):
        memory = encoder.empty((1,))
        scores = [score(memory, TASKS[[sequence]])]
        for t in range(3):
            if WEIGHTS[sequence, t] > 0:
                columns = (column[[sequence], t] for column in SEQUENCES.transitions)
                memory = encoder.absorb(memory, Transitions(*columns))
                scores.append(score(memory, TASKS[[sequence]]))
        means.append(th.stack(scores).mean())
    return th.stack(means).mean()


@pytest.mark.parametrize("head", ["gaussian", "mixture"])
def test_the_loss_is_the_surprise_at_the_task_after_every_prefix(head):
    encoder = make_encoder(head=head)
    expected = -mean_over_prefixes(encoder, lambda memory, task: encoder.posterior(memory).log_prob(task)[0])
    th.testing.assert_close(encoder.loss(SEQUENCES).total, expected)


def test_a_gaussian_is_one_of_the_standardised_task():
    th.manual_seed(0)
    head = GaussianHead(4, 2).double()
    tasks = th.randn(1_000, 2).double() * th.tensor([100.0, 0.01]) + th.tensor([7.0, -3.0])
    head.update(tasks)
    features = th.randn(5, 4).double()
    mean, raw = (features @ head.components.weight.T + head.components.bias).chunk(2, dim=-1)
    std = 0.01 + F.softplus(raw)
    scale = tasks.std(dim=0, correction=0)
    expected = Normal(tasks.mean(dim=0) + scale * mean, scale * std)
    for found, known in (
        (head(features).log_prob(tasks[:5]), expected.log_prob(tasks[:5]).sum(dim=-1)),
        (head(features).mean, expected.mean),
        (head.moments(head(features)), th.cat([mean, 2 * std.log()], dim=-1)),
    ):
        th.testing.assert_close(found, known, rtol=1e-3, atol=1e-3)  # of what outliers are brought nearer


def test_a_mixture_is_a_density_with_the_moments_that_it_tells():
    th.manual_seed(0)
    head = GaussianHead(4, 1, n_components=2).double()
    with th.no_grad():
        head.components.bias.copy_(th.tensor([-1.0, -2.0, 1.5, -1.0]))
    tasks = head(th.randn(1, 4).double())
    grid = th.linspace(-12, 12, 20_001, dtype=th.float64)[:, None]
    density = tasks.log_prob(grid).exp() * (24 / 20_000)
    mean = (density * grid[:, 0]).sum()
    th.testing.assert_close(density.sum(), th.ones(()).double(), rtol=1e-4, atol=0)
    th.testing.assert_close(tasks.mean[0, 0], mean, rtol=1e-3, atol=1e-4)
    th.testing.assert_close(tasks.variance[0, 0], (density * (grid[:, 0] - mean) ** 2).sum(), rtol=1e-3, atol=0)


def test_of_one_hot_tasks_the_loss_is_the_cross_entropy():
    encoder = make_encoder(head="one_hot", belief="moments")
    labels = th.tensor([1, 0])
    tasks = F.one_hot(labels, 2).double()
    memory = encoder.prefixes(SEQUENCES.transitions)
    logits = encoder.head.logits(encoder.features(memory.hidden))
    expected = F.cross_entropy(logits.flatten(0, 1), labels[:, None].expand(-1, 4).flatten())
    th.testing.assert_close(encoder.loss(SEQUENCES._replace(tasks=tasks, weights=None)).total, expected)
    th.testing.assert_close(encoder.belief(memory), logits.softmax(dim=-1))
    assert encoder.posterior(memory).variance.shape == (2, 4, 2)


@pytest.mark.parametrize("task", [[0.5, 0.5], [1.0, 1.0], [2.0, -1.0], [0.0, 0.0]])
def test_one_hot_tasks_must_be_one_hot(task):
    encoder = make_encoder(head="one_hot").train()
    with pytest.raises(ValueError, match=r"needs tasks that are one-hot vectors, got \[.*use 'gaussian'"):
        encoder.loss(SEQUENCES._replace(tasks=th.tensor([task, [1.0, 0.0]]).double()))


def test_a_single_number_is_no_one_hot_task():
    with pytest.raises(ValueError, match="got tasks of size 1: use 'gaussian'"):
        OneHotHead(4, 1)


def test_the_bottleneck_costs_the_kl_to_a_standard_normal():
    encoder = make_encoder(bottleneck=0.5)
    th.manual_seed(1)

    def kl(memory, _):
        mean, log_var = encoder.code(encoder.features(memory.hidden)).chunk(2, dim=-1)
        code = Normal(mean, (log_var / 2).exp())
        drawn = code.sample((20_000,))
        return (code.log_prob(drawn) - Normal(0.0, 1.0).log_prob(drawn)).sum(dim=-1).mean()

    total, scalars = encoder.loss(SEQUENCES)
    th.testing.assert_close(scalars["bottleneck_nats"], mean_over_prefixes(encoder, kl), rtol=0.03, atol=0)
    th.testing.assert_close(total, 0.5 * scalars["bottleneck_nats"] - scalars["task_nats"])
    memory = encoder.prefixes(SEQUENCES.transitions)
    assert th.equal(encoder.belief(memory), encoder.belief(memory))  # without noise
    assert "bottleneck_nats" not in make_encoder().loss(SEQUENCES).scalars


@pytest.fixture(scope="module")
def by_head():
    """Encoders that learned the toy tasks, by their heads."""
    return {head: trained(SupervisedBelief(3, 2, 1, head=head, hidden_size=16)) for head in ("gaussian", "mixture")}


@pytest.fixture(params=["gaussian", "mixture"])
def learned(request, by_head):
    return by_head[request.param]


@th.no_grad()
def test_it_learns_the_task_and_is_unsure_before(learned):
    assert explained(learned, 0) < 0.01 < 0.95 < explained(learned, 3)
    before, (memory, tasks) = learned.posterior(learned.empty()), memory_after(learned, 6)
    assert abs(float(before.mean)) < 0.3 and 0.3 < float(before.variance) < 1.3
    after = learned.posterior(memory)
    assert (after.mean[:, 0] - tasks).abs().max() < 0.3 and after.variance.max() < 0.1


@th.no_grad()
def test_candidates_are_as_likely_as_what_was_seen_tells(learned):
    assert isinstance(learned, InfersTask)
    memory, tasks = memory_after(learned, 6)
    candidates = th.tensor([[-1.0], [1.0]])
    found = learned.log_task_likelihood(memory, candidates)
    assert found.shape == (64, 2)
    assert th.equal(found.argmax(dim=-1), (tasks > 0).long())
    assert learned.log_task_likelihood(learned.empty((64,)), candidates).abs().max() < 1e-5


@th.no_grad()
def test_a_mixture_knows_of_both_tasks_where_a_gaussian_knows_their_mean(by_head):
    tasks = th.tensor([[-1.0], [0.0], [1.0]])
    gaussian, mixture = (
        by_head[head].posterior(by_head[head].empty((3,))).log_prob(tasks) for head in ("gaussian", "mixture")
    )
    assert gaussian[1] > gaussian[[0, 2]].max()
    assert mixture[1] < mixture[[0, 2]].min()


def test_one_hot_tasks_are_learned():
    encoder = SupervisedBelief(3, 2, 2, head="one_hot", belief="moments", hidden_size=16)
    trained(encoder, tasks_of=lambda tasks: F.one_hot((tasks[:, 0] > 0).long(), 2).float())
    memory, tasks = memory_after(encoder, 6)
    assert (encoder.belief(memory)[:, 1] - (tasks > 0).float()).abs().max() < 0.1


@pytest.mark.parametrize(
    ("kwargs", "told"),
    [
        ({"head": "normal"}, "`head` must be one of 'gaussian', 'mixture', 'one_hot', got 'normal'"),
        ({"belief": "mean"}, "`belief` must be one of 'features', 'moments', got 'mean'"),
        ({"feature_dim": 0}, "`feature_dim` must be finite and at least 1, got 0"),
        ({"bottleneck": -1.0}, "`bottleneck` must be finite and at least 0, got -1.0"),
        ({"hidden_size": 0}, "`hidden_size` must be finite and at least 1, got 0"),
    ],
)
def test_what_cannot_be_is_refused(kwargs, told):
    with pytest.raises(ValueError, match=told):
        SupervisedBelief(3, 2, 1, **kwargs)


@pytest.mark.parametrize("candidates", [[[0.5, 0.5], [1.0, 0.0]], [[1.0, 1.0], [1.0, 0.0]], [[0.0, 0.0]]])
def test_a_candidate_that_is_no_one_hot_task_is_refused(candidates):
    encoder = make_encoder(head="one_hot")
    with pytest.raises(ValueError, match="needs tasks that are one-hot vectors"):
        encoder.log_task_likelihood(encoder.empty(), th.tensor(candidates, dtype=th.float64))
    likely = encoder.log_task_likelihood(encoder.empty((3,)), th.eye(2, dtype=th.float64).expand(3, 2, 2))
    assert likely.shape == (3, 2)

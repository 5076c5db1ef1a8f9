"""The posterior over tasks: in their own units, calibrated on tasks that were not trained on, of several modes."""

import pytest
import torch as th
from scipy.stats import kstest

from sb3_bruno.encoders import BrunoEncoder, TaskSequences, Transitions
from sb3_bruno.encoders.base import map_memory
from support.small_encoder import SMALL


def sequences_of(tasks: th.Tensor, time: int) -> TaskSequences:
    """r = |task . a| + noise: a task and its opposite cannot be told apart."""
    shape = (len(tasks), time)
    observations, actions = th.randn(*shape, 1), 2 * th.rand(*shape, 2) - 1
    rewards = (actions @ tasks.unsqueeze(-1)).abs() + 0.1 * th.randn(*shape, 1)
    return TaskSequences(Transitions(observations, actions, rewards, observations), tasks)


@pytest.fixture(scope="module")
def encoder():
    th.manual_seed(0)
    settings = {
        **SMALL,
        "flow_class": None,
        "flow_kwargs": None,
        "net_arch": (64, 64),
        "n_weights": 6,
        "modelled": "rewards",
    }
    encoder = BrunoEncoder.build(1, 2, 2, **settings)
    optimizer = th.optim.Adam(encoder.parameters(), lr=3e-3)
    for _ in range(1_500):
        loss = encoder.loss(sequences_of(2 * th.rand(16, 2) - 1, 32)).total
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return encoder.eval()


def posterior(encoder, sequences, n, candidates):
    """Probabilities of the candidates (n_candidates, 2) after n transitions: (batch, n_candidates)."""
    memory = map_memory(lambda prefixes: prefixes[:, n], encoder.prefixes(sequences.transitions))
    return encoder.log_task_likelihood(memory, candidates).softmax(dim=-1)


@th.no_grad()
def test_both_of_two_tasks_that_look_alike_are_probable_and_no_other_is(encoder):
    task = th.tensor([[0.8, 0.4]])
    candidates = th.tensor([[0.8, 0.4], [-0.8, -0.4], [0.8, -0.4], [0.1, 0.2]])
    found = posterior(encoder, sequences_of(task, 30), 30, candidates)[0]
    assert found[:2].min() > 0.2 and found[2:].max() < 0.01
    at_first = posterior(encoder, sequences_of(task, 30), 0, candidates)[0]
    th.testing.assert_close(at_first, th.full((4,), 0.25).double())


@th.no_grad()
@pytest.mark.parametrize("n", [5, 20])
def test_the_posterior_of_tasks_not_trained_on_is_calibrated(encoder, n):
    """As often as it says so, the true task is among the most probable."""
    batch, n_candidates = 400, 50
    candidates = 2 * th.rand(n_candidates, 2) - 1
    truth = th.randint(n_candidates, (batch,))
    found = posterior(encoder, sequences_of(candidates[truth], n), n, candidates)
    given_truth = found.gather(1, truth[:, None])
    assert given_truth.log().mean() > -2.5  # of ln 50 = 3.9 nats at first
    more_probable = (found * (found > given_truth)).sum(dim=1)
    rank = more_probable + th.rand(batch) * given_truth[:, 0]  # uniform if the probabilities are right
    assert kstest(rank.numpy(), "uniform").statistic < 0.2


def test_the_map_teaches_the_encoder_nothing(encoder):
    sequences = sequences_of(2 * th.rand(4, 2) - 1, 8)
    gradients = []
    for tasks in (sequences.tasks, -3 * sequences.tasks):
        encoder.zero_grad()
        th.manual_seed(0)
        encoder.loss(sequences._replace(tasks=tasks)).total.backward()
        gradients.append([parameter.grad for parameter in encoder.model.parameters()])
    for one, other in zip(*gradients, strict=True):
        th.testing.assert_close(one, other, rtol=0, atol=0)


def test_an_encoder_that_knows_no_tasks_says_so():
    encoder = BrunoEncoder(1, 2, process="gaussian")
    with pytest.raises(ValueError, match="knows no tasks"):
        encoder.log_task_likelihood(encoder.empty(), th.zeros(3, 2))

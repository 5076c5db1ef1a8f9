"""The read-out tells the task with honest spread, on tasks it has learned and on others."""

import pytest
import torch as th

from sb3_bruno.encoders import ENCODERS, RandomFeatures, find_encoder
from sb3_bruno.encoders.task_readout import DensityReadout, ListReadout, TaskReadout, make_readout
from support.small_encoder import transitions_of

N_TASKS = 30


def noisy(tasks, n, generator):
    """Features that hold the task in noise, and how much noise: (..., 4)"""
    std = 0.05 + 0.5 * th.rand(n, 1, generator=generator)
    seen = tasks[th.randint(len(tasks), (n,), generator=generator)]
    mean = seen + std * th.randn(n, 2, generator=generator)
    return th.cat([mean, 2 * std.log().expand(n, 2)], dim=-1), seen


def fitted(readout, tasks, spared, n_updates=600):
    generator = th.Generator().manual_seed(1)
    optimizer = th.optim.Adam(readout.parameters(), lr=3e-3)
    readout.train()
    for _ in range(n_updates):
        features, seen = noisy(tasks, 64, generator)
        is_spared = (seen.unsqueeze(1) == spared).all(-1).any(-1, keepdim=True)
        loss = readout.loss(features.unsqueeze(1), seen, th.ones(64, 1), is_spared)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    return readout.eval()


@pytest.fixture(scope="module")
def density():
    th.manual_seed(0)
    tasks = 2 * th.rand(N_TASKS, 2) - 1
    return fitted(DensityReadout(4, 2), tasks, tasks[::5]), tasks


@pytest.mark.parametrize("held_out", [False, True])
def test_nine_intervals_in_ten_hold_the_task(density, held_out):
    readout, tasks = density
    generator = th.Generator().manual_seed(2)
    tasks = 2 * th.rand(200, 2, generator=generator) - 1 if held_out else tasks
    features, seen = noisy(tasks, 4_000, generator)
    reading = readout(features)
    inside = ((reading.mean - seen).abs() < 1.645 * reading.std).float().mean()
    assert 0.85 < inside < 0.98  # on the tasks that it fitted, too wide if anything
    assert reading.probabilities is None
    wide = features[:, 2] > features[:, 2].median()
    assert reading.std[wide].mean() > 1.3 * reading.std[~wide].mean()  # it says where it does not know


def test_spared_tasks_teach_nothing_but_the_width():
    readout = DensityReadout(4, 2).train()
    tasks = th.rand(8, 2)
    readout.loss(th.rand(8, 3, 4), tasks, th.ones(8, 3), th.ones(8, 1, dtype=th.bool)).backward()
    taught = {name for name, parameter in readout.named_parameters() if parameter.grad.abs().sum() > 0}
    assert taught == {"log_widen"}
    readout.zero_grad()
    readout.loss(th.rand(8, 3, 4), tasks, th.ones(8, 3), th.zeros(8, 1, dtype=th.bool)).backward()
    assert readout.log_widen.grad.abs().sum() == 0 and readout.head.components.weight.grad.abs().sum() > 0


def test_few_tasks_get_probabilities_which_are_right():
    th.manual_seed(0)
    tasks = th.tensor([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    readout = fitted(ListReadout(4, tasks), tasks, tasks[:0])
    features, seen = noisy(tasks, 4_000, th.Generator().manual_seed(2))
    reading = readout(features)
    th.testing.assert_close(reading.probabilities.sum(dim=-1), th.ones(4_000))
    th.testing.assert_close(reading.mean, reading.probabilities @ tasks)
    spread = (reading.probabilities.unsqueeze(-1) * (tasks - reading.mean.unsqueeze(1)).square()).sum(dim=1).sqrt()
    th.testing.assert_close(reading.std, spread, atol=2e-3, rtol=0)
    is_true = (tasks == seen.unsqueeze(1)).all(-1)
    assert (
        abs(
            reading.probabilities.amax(dim=-1).mean()
            - is_true[range(4_000), reading.probabilities.argmax(-1)].float().mean()
        )
        < 0.05
    )
    th.testing.assert_close(readout.error(reading, seen), 1 - reading.probabilities[is_true])


def test_what_does_not_count_teaches_nothing():
    th.manual_seed(0)
    readout, features, tasks = DensityReadout(4, 2), th.rand(6, 3, 4), th.rand(6, 2)
    counts, spared = th.tensor([[1.0, 0.0, 1.0]]).expand(6, 3), th.zeros(6, 1, dtype=th.bool)
    readout.eval()
    loss = readout.loss(features, tasks, counts, spared)
    features[:, 1] = 100.0
    assert loss == readout.loss(features, tasks, counts, spared)


@pytest.mark.parametrize("name", ENCODERS)
def test_every_encoder_can_be_read(name):
    encoder = find_encoder(name).build(3, 2, 2)
    readout = make_readout(encoder, 2, None).double().eval()
    transitions, weights = transitions_of(4, 5), th.tensor([1.0, 0.0, 1.0, 1.0, 0.0]).double().expand(4, 5)
    memory = encoder.double().prefixes(transitions, weights)
    features = readout.prefix_features(encoder, transitions, weights, th.tensor([[0, 5, 2]]).expand(4, 3))
    th.testing.assert_close(features, readout.features(encoder, memory)[:, [0, 5, 2]], rtol=0, atol=0)
    reading = readout.read(encoder, memory)
    assert reading.mean.shape == reading.std.shape == (4, 6, 2)
    assert (reading.std > 0).all()


def test_a_variance_without_bounds_is_read():
    encoder = find_encoder("bruno").build(3, 1, 2, process="kernel_student_t")
    assert TaskReadout.features(encoder, encoder.empty((2,))).isfinite().all()


def test_making_one_draws_no_random_numbers_of_others():
    encoder = RandomFeatures(3, 1)
    th.manual_seed(0)
    expected = th.rand(3)
    th.manual_seed(0)
    make_readout(encoder, 2, [[0.0, 1.0], [1.0, 0.0]])
    th.testing.assert_close(th.rand(3), expected, atol=0, rtol=0)


def test_the_spread_of_few_tasks_is_right_however_far_from_0_they_are():
    readout = ListReadout(4, th.tensor([[1e6], [1e6 + 1]])).eval()
    th.nn.init.zeros_(readout.logits.weight)
    th.nn.init.zeros_(readout.logits.bias)
    th.testing.assert_close(readout(th.zeros(3, 4)).std, th.full((3, 1), 0.5))


def test_a_posterior_without_moments_is_left_to_the_belief():
    class Flow(RandomFeatures):
        def posterior(self, memory):
            return th.distributions.TransformedDistribution(
                th.distributions.Normal(memory.total, 1.0), [th.distributions.ExpTransform()]
            )

    encoder = Flow(3, 1)
    memory = encoder.empty((2,))
    assert th.equal(TaskReadout.features(encoder, memory), encoder.belief(memory))

"""What a task does not say of its weights is learned in closed form, however little it is."""

import pytest
import torch as th

from sb3_bruno.encoders import BrunoEncoder, TaskSequences, Transitions
from sb3_bruno.encoders.base import map_memory
from sb3_bruno.encoders.task_map import RATE, TaskMap
from sb3_bruno.maths.kernel_process import KernelGaussian
from sb3_bruno.maths.kernel_process_t import KernelStudentT
from sb3_bruno.maths.kernel_statistics import Features


def turned(tasks, time):
    """s' - s is the action, turned by the task's angle, all but exactly."""
    shape = (len(tasks), time)
    observations, actions = th.randn(*shape, 2), 2 * th.rand(*shape, 2) - 1
    cos, sin = tasks.unsqueeze(1).unbind(dim=-1)
    x, y = actions.unbind(dim=-1)
    moved = th.stack([cos * x - sin * y, sin * x + cos * y], dim=-1)
    arrivals = observations + moved + 1e-3 * th.randn(*shape, 2)
    return TaskSequences(Transitions(observations, actions, th.zeros(*shape, 1), arrivals), tasks)


def directions(angles):
    return th.stack([angles.cos(), angles.sin()], dim=-1)


def test_a_task_that_shows_at_once_is_told_from_its_neighbours_after_few_updates():
    th.manual_seed(0)
    encoder = BrunoEncoder.build(2, 2, 2, modelled="next_observations", n_weights=4, net_arch=(32, 32))
    optimizer = th.optim.Adam(encoder.parameters(), lr=3e-3)
    for _ in range(400):
        loss = encoder.loss(turned(directions(6.3 * th.rand(16)), 16)).total
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    encoder.eval()
    candidates = directions(th.arange(100) * 2 * th.pi / 100)
    with th.no_grad():
        memory = map_memory(lambda columns: columns[:, 15], encoder.prefixes(turned(candidates, 15).transitions))
        found = encoder.log_task_likelihood(memory, candidates.expand(100, 100, 2)).softmax(dim=-1)
    assert (1 / found.square().sum(dim=-1)).median() < 12  # how many of the 100 are likely
    assert (found.diagonal() > 0.05).float().mean() > 0.9


@pytest.mark.parametrize("process", [KernelGaussian(2), KernelStudentT(2, df=30.0)])
@pytest.mark.parametrize("var", [1e-4, 0.3])
def test_the_slack_becomes_the_variance_of_the_weights_given_the_task(process, var):
    """psi is held at 0, so that the slack of a weight is the weight's own variance: known of the first alone."""
    th.manual_seed(0)
    task_map = TaskMap(1, 2)
    for parameter in task_map.psi.parameters():
        parameter.data.zero_()
    for _ in range(int(12 / RATE)):
        w = var**0.5 * th.randn(64, 1, 1)
        phi = th.zeros(64, 30, 1, 2)
        phi[..., 0] = 1.0
        noise_var = th.full((64, 30, 1), 1e-5)
        z = w + noise_var.sqrt() * th.randn(64, 30, 1)
        statistics = process.statistics(Features(th.zeros(64, 30, 1), phi, noise_var), z)
        task_map.update(process, statistics, th.randn(64, 1))
    known, unknown = task_map.slack.tolist()
    assert known == pytest.approx(var, rel=0.2) and unknown == pytest.approx(1.0, rel=0.2)

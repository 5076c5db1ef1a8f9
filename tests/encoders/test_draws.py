"""What a loss scores of a batch: prefixes and targets that count, each as often as it should."""

import torch as th

from sb3_bruno.encoders.draws import N_PREFIXES, N_TARGETS, draw

WEIGHTS = th.tensor([[1.0, 0.0, 1.0], [0.0, 0.0, 0.0], [3.0, 1.0, 0.0]])


def drawn_often(n=400):
    th.manual_seed(0)
    return [draw(WEIGHTS) for _ in range(n)]


def shares(drawn, n):
    """How often each of the numbers below n is drawn for each sequence, (3, n)."""
    return th.stack([(drawn == number).flatten(1).double().mean(dim=1) for number in range(n)], dim=1)


def test_prefixes_and_targets_are_drawn_in_proportion_to_the_weights():
    draws = drawn_often()
    prefixes = shares(th.cat([of.prefixes for of in draws], dim=1), 4)
    targets = shares(th.cat([of.targets for of in draws], dim=1), 3)
    known = [[1 / 3, 1 / 3, 0, 1 / 3], [1, 0, 0, 0], [1 / 5, 3 / 5, 1 / 5, 0]]
    th.testing.assert_close(prefixes, th.tensor(known, dtype=th.float64), rtol=0, atol=0.03)
    wanted = th.tensor([[1 / 2, 0, 1 / 2], [3 / 4, 1 / 4, 0]], dtype=th.float64)
    th.testing.assert_close(targets[[0, 2]], wanted, rtol=0, atol=0.02)


def test_from_every_prefix_the_past_and_the_future_are_predicted():
    pairs = {
        (int(prefix), int(target))
        for of in drawn_often(20)
        for prefix, targets in zip(of.prefixes[0], of.targets[0], strict=True)
        for target in targets
    }
    assert pairs == {(prefix, target) for prefix in (0, 1, 3) for target in (0, 2)}


def test_what_is_drawn_is_taken_from_its_own_sequence():
    drawn = draw(WEIGHTS)
    numbers = th.arange(3 * 4).reshape(3, 4, 1)  # 4 * sequence + place
    known, wanted = drawn.known(numbers), drawn.wanted(numbers)
    assert known.shape == (3, N_PREFIXES, 1) and wanted.shape == (3, N_PREFIXES, N_TARGETS, 1)
    assert th.equal(known[..., 0] - drawn.prefixes, 4 * th.arange(3)[:, None].expand(-1, N_PREFIXES))
    assert th.equal(wanted[..., 0] - drawn.targets, 4 * th.arange(3)[:, None, None].expand(drawn.targets.shape))


def test_a_sequence_of_which_nothing_counts_has_no_part_in_the_mean():
    drawn = draw(WEIGHTS)
    scores = th.tensor([1.0, th.pi, 3.0])[:, None, None].expand(drawn.targets.shape)
    assert drawn.mean(scores) == 2
    nothing = draw(th.zeros(2, 3))
    assert nothing.mean(th.ones(nothing.targets.shape)) == 0

"""check_encoder passes what works, and names the promise that an encoder breaks."""

import pytest
import torch as th
from torch.nn import functional as F

from sb3_bruno.encoders import ENCODERS, Loss, TaskEncoder, check_encoder
from support.own_encoders import BayesianLinear, MeanReward


class Sums(TaskEncoder):
    """Believes a learned multiple of the sum of the rewards: a sound encoder to break."""

    belief_dim = 1
    learns_from = "critic"

    def __init__(self, observation_dim, action_dim):
        super().__init__()
        self.factor = th.nn.Parameter(th.ones(1))

    def empty(self, batch_shape=()):
        return (self.factor.new_zeros(*batch_shape, 1),)

    def absorb(self, memory, transitions):
        return (memory[0] + transitions.rewards,)

    def prefixes(self, transitions, weights=None):
        rewards = transitions.rewards if weights is None else weights.unsqueeze(-1) * transitions.rewards
        return (F.pad(rewards.cumsum(dim=-2), (0, 0, 1, 0)),)

    def belief(self, memory):
        return self.factor * memory[0]


class WrongDim(Sums):
    """Says that its belief is larger."""

    belief_dim = 2


class NoPrior(Sums):
    """Forgets the memory of no transitions."""

    def prefixes(self, transitions, weights=None):
        return (super().prefixes(transitions, weights)[0][..., 1:, :],)


class Infinite(Sums):
    """Divides by zero."""

    def belief(self, memory):
        return self.factor / memory[0]


class Disagrees(Sums):
    """Acts on another belief than it is trained on."""

    def absorb(self, memory, transitions):
        return (memory[0] + 2 * transitions.rewards,)


class CountsPadding(Sums):
    """Reads padding."""

    def prefixes(self, transitions, weights=None):
        return super().prefixes(transitions)


class Ordered(Sums):
    """Discounts, and does not say that it reads in order."""

    def absorb(self, memory, transitions):
        return (0.5 * memory[0] + transitions.rewards,)

    def prefixes(self, transitions, weights=None):
        memory = self.empty(transitions.rewards.shape[:-2])
        states = [memory[0]]
        for t in range(transitions.rewards.shape[-2]):
            after = 0.5 * states[-1] + transitions.rewards[..., t, :]
            counts = None if weights is None else weights[..., t, None] > 0
            states.append(after if counts is None else th.where(counts, after, states[-1]))
        return (th.stack(states, dim=-2),)


class Unreached(Sums):
    """Holds a parameter that nothing uses."""

    def __init__(self, observation_dim, action_dim):
        super().__init__(observation_dim, action_dim)
        self.idle = th.nn.Parameter(th.ones(1))


class Untaught(Sums):
    """Says that it learns from a loss of its own, and has none."""

    learns_from = "own"


class Frozen(Sums):
    """Should be taught by the critics, and has nothing to learn."""

    def __init__(self, observation_dim, action_dim):
        super().__init__(observation_dim, action_dim)
        self.factor.requires_grad_(False)


class Single(Sums):
    """Begins in single precision, whatever it is."""

    def empty(self, batch_shape=()):
        return (th.zeros(*batch_shape, 1),)


class Batched(Sums):
    """Takes its input for a batch."""

    def prefixes(self, transitions, weights=None):
        rewards = transitions.rewards if weights is None else weights.unsqueeze(-1) * transitions.rewards
        after = rewards.cumsum(dim=min(1, rewards.ndim - 1))
        return (F.pad(after, (0, 0, 1, 0)),)


class OtherLast(Sums):
    """Has a memory of its own for the last."""

    def last(self, transitions, weights=None):
        return (super().last(transitions, weights)[0] + 1,)


class OtherBeliefs(Sums):
    """Trains on other beliefs than it acts on."""

    def prefix_beliefs(self, transitions, weights, noise):
        return super().prefix_beliefs(transitions, weights, noise) + 1


class VectorLoss(Sums):
    """Forgets the mean."""

    def loss(self, sequences):
        return Loss(self.factor * sequences.transitions.rewards.sum(dim=(1, 2)), {})


@pytest.mark.parametrize("encoder_class", [Sums, MeanReward, BayesianLinear, *ENCODERS.values()])
def test_what_works_passes_and_leaves_torchs_random_state(encoder_class):
    state = th.get_rng_state()
    check_encoder(encoder_class)
    assert th.equal(state, th.get_rng_state())


@pytest.mark.parametrize(
    ("encoder_class", "told"),
    [
        (WrongDim, r"has shape \(1,\): make it \(2,\)"),
        (NoPrior, "the memory of no transitions first"),
        (Infinite, "not finite"),
        (Disagrees, "acting and training would disagree"),
        (CountsPadding, "of weight 0"),
        (Ordered, "set `order = 'time'`"),
        (Unreached, r"no gradient reaches \['idle'\]"),
        (Frozen, r"Frozen has no parameter to learn: give it one, or set `learns_from = 'own'`"),
        (Single, r"`empty` makes torch.float32, while the encoder's `factor` is torch.float64"),
        (Batched, r"a sequence \(time, dim\) differs from that in a batch"),
        (OtherLast, "`last` differs from the last memory of `prefixes`"),
        (OtherBeliefs, "`prefix_beliefs` differs from the beliefs of `prefixes`"),
        (Untaught, r"there is no `loss` that \['factor'\] could learn from: define one, or set `learns_from`"),
        (VectorLoss, r"returns \['total'\] of other shapes"),
    ],
)
def test_a_broken_promise_is_named(encoder_class, told):
    with pytest.raises(ValueError, match=told):
        check_encoder(encoder_class)


def test_an_encoder_that_says_that_it_reads_in_order_passes():
    check_encoder(type("InTime", (Ordered,), {"order": "time"}))


def test_arguments_reach_the_encoder():
    with pytest.raises(ValueError, match="hidden_size"):
        check_encoder(ENCODERS["recurrent"], hidden_size=0)

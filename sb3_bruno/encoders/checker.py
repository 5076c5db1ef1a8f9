"""Checks that an encoder keeps its promises, as SB3's ``check_env`` does for environments."""

from __future__ import annotations

from typing import Any

import torch as th
from torch import Tensor

from sb3_bruno.encoders.base import AnyMemory, TaskEncoder, TaskSequences, Transitions, choose_memory, map_memory

_BATCH, _TIME, _TASK_DIM = 3, 6, 2


def check_encoder(
    encoder_class: type[TaskEncoder], *, observation_dim: int = 3, action_dim: int = 2, **encoder_kwargs: Any
) -> None:
    """Build an encoder and try it on random transitions.

    Args:
        encoder_class: the encoder's class.
        observation_dim: size of the observations.
        action_dim: size of the actions.
        **encoder_kwargs: further arguments of the encoder.

    Raises:
        ValueError: naming the promise that it breaks, and what to look at. Torch's random state is as it was before.
    """
    with th.random.fork_rng([]):
        th.manual_seed(0)
        encoder = encoder_class.build(observation_dim, action_dim, _TASK_DIM, **encoder_kwargs).double()
        transitions = _random_transitions(observation_dim, action_dim)
        _check_precision(encoder)
        _check_shapes(encoder, transitions)
        _check_prefixes(encoder, transitions)
        _check_alike(encoder, transitions)
        _check_weights(encoder, transitions, _random_transitions(observation_dim, action_dim))
        _check_order(encoder, transitions)
        _check_learning(encoder, transitions)


def _random_transitions(observation_dim: int, action_dim: int) -> Transitions:
    dims = (observation_dim, action_dim, 1, observation_dim)
    return Transitions(*(th.randn(_BATCH, _TIME, dim, dtype=th.float64) for dim in dims))


def _check_precision(encoder: TaskEncoder) -> None:
    """The memory of no transitions has the precision of the encoder, if that has one."""
    for name, parameter in encoder.named_parameters():
        floats = [states.dtype for states in encoder.empty() if states.is_floating_point()]
        wrong = [dtype for dtype in floats if dtype != parameter.dtype]
        if wrong:
            raise ValueError(
                f"`empty` makes {wrong[0]}, while the encoder's `{name}` is {parameter.dtype}: make its tensors like a "
                "parameter, as by `next(self.parameters()).new_zeros(shape)`."
            )


def _check_shapes(encoder: TaskEncoder, transitions: Transitions) -> None:
    for batch_shape in ((), (_BATCH,), (2, _BATCH)):
        belief = encoder.belief(encoder.empty(batch_shape))
        wanted = (*batch_shape, encoder.belief_dim)
        if belief.shape != wanted:
            raise ValueError(f"`belief(empty({batch_shape}))` has shape {tuple(belief.shape)}: make it {wanted}.")
    beliefs = encoder.belief(encoder.prefixes(transitions))
    if beliefs.shape != (_BATCH, _TIME + 1, encoder.belief_dim):
        raise ValueError(
            f"`prefixes` of {_TIME} transitions gives beliefs of shape {tuple(beliefs.shape)}: make it "
            f"{(_BATCH, _TIME + 1, encoder.belief_dim)}, with the memory of no transitions first."
        )
    if not beliefs.isfinite().all():
        raise ValueError("`belief` is not finite on standard normal transitions: look for a division or a logarithm.")


def _check_prefixes(encoder: TaskEncoder, transitions: Transitions) -> None:
    prefixes, memory = encoder.prefixes(transitions), encoder.empty((_BATCH,))
    for t in range(_TIME + 1):
        if not _same(encoder, memory, _at(prefixes, t)):
            what = "`empty`" if t == 0 else f"`absorb` of {t} transitions one by one"
            raise ValueError(f"`prefixes` at {t} differs from {what}: acting and training would disagree.")
        if t < _TIME:
            memory = encoder.absorb(memory, Transitions(*(column[:, t] for column in transitions)))


def _check_alike(encoder: TaskEncoder, transitions: Transitions) -> None:
    """What else tells of ``prefixes`` says the same: a sequence by itself, ``last`` and ``prefix_beliefs``."""
    prefixes, alone = encoder.prefixes(transitions), Transitions(*(column[0] for column in transitions))
    if not _same(encoder, encoder.prefixes(alone), map_memory(lambda states: states[0], prefixes)):
        raise ValueError("`prefixes` of a sequence (time, dim) differs from that in a batch: count axes from the end.")
    if not _same(encoder, encoder.last(transitions), _at(prefixes, -1)):
        raise ValueError("`last` differs from the last memory of `prefixes`: make it the same, or leave it out.")
    beliefs = encoder.prefix_beliefs(transitions, None, encoder.empty((_BATCH, 1)))
    if not th.allclose(beliefs.double(), encoder.belief(prefixes).double(), rtol=1e-6, atol=1e-8):
        raise ValueError(
            "`prefix_beliefs` differs from the beliefs of `prefixes`: make them the same, or leave it out."
        )


def _check_weights(encoder: TaskEncoder, transitions: Transitions, others: Transitions) -> None:
    """The transition in the middle and the last one do not count."""
    weights = th.ones(_BATCH, _TIME, dtype=th.float64)
    weights[:, [_TIME // 2, _TIME - 1]] = 0
    prefixes, memory = encoder.prefixes(transitions, weights), encoder.empty((_BATCH,))
    for t in range(_TIME):
        after = encoder.absorb(memory, Transitions(*(column[:, t] for column in transitions)))
        memory = choose_memory(weights[:, t, None] > 0, after, memory)
        if not _same(encoder, memory, _at(prefixes, t + 1)):
            raise ValueError(
                f"`prefixes` at {t + 1} does not leave out transitions of weight 0: let them hold the memory."
            )
    mixed = [th.where(weights[..., None] > 0, a, b) for a, b in zip(transitions, others, strict=True)]
    if not _same(encoder, prefixes, encoder.prefixes(Transitions(*mixed), weights)):
        raise ValueError("`prefixes` depends on transitions of weight 0: they may be padding, so leave them out.")


def _check_order(encoder: TaskEncoder, transitions: Transitions) -> None:
    turned = Transitions(*(column.flip(-2) for column in transitions))
    if encoder.order != "any":
        return
    once = encoder.prefixes(transitions)
    if not _same(encoder, _at(once, -1), _at(encoder.prefixes(turned), -1)):
        raise ValueError(
            "`order = 'any'`, but the belief depends on the order of the transitions: set `order = 'time'`."
        )
    twice = encoder.prefixes(Transitions(*(column.repeat_interleave(2, dim=-2) for column in transitions)))
    weighed = encoder.prefixes(transitions, th.full((_BATCH, _TIME), 2.0, dtype=th.float64))
    if not _same(encoder, map_memory(lambda states: states[:, ::2], twice), weighed):
        raise ValueError("`prefixes` does not take a transition of weight 2 as if there were two: multiply its part.")


def _check_learning(encoder: TaskEncoder, transitions: Transitions) -> None:
    loss = encoder.loss(TaskSequences(transitions, th.randn(_BATCH, _TASK_DIM, dtype=th.float64)))
    total = th.zeros(())
    if loss is not None:
        scalars = {"total": loss.total, **loss.scalars}
        wrong = [name for name, scalar in scalars.items() if scalar.shape != ()]
        if wrong:
            raise ValueError(f"`loss` returns {wrong} of other shapes than (): take their means.")
        total = total + loss.total
    if encoder.learns_from != "own":
        total = total + encoder.belief(encoder.prefixes(transitions)).square().sum()
    check_has_something_to_teach(encoder)
    if total.requires_grad:
        total.backward()
    parameters = dict(encoder.named_parameters())
    unreached = [name for name, parameter in parameters.items() if parameter.requires_grad and parameter.grad is None]
    if unreached and loss is None and encoder.learns_from == "own":
        raise ValueError(
            f"`learns_from = 'own'`, but there is no `loss` that {unreached} could learn from: define one, or set "
            "`learns_from` to 'critic' or 'actor'."
        )
    if unreached:
        raise ValueError(f"no gradient reaches {unreached}: use them in what is learned, or remove them.")


def check_has_something_to_teach(encoder: TaskEncoder) -> None:
    """Refuse an encoder that the critics or the actor should teach, and that has no parameter to learn.

    Raises:
        ValueError: if it is such a one.
    """
    if encoder.learns_from != "own" and encoder.is_frozen:
        raise ValueError(
            f"`learns_from = '{encoder.learns_from}'`, but {type(encoder).__name__} has no parameter to learn: give it "
            "one, or set `learns_from = 'own'` and define no `loss`."
        )


def _at(prefixes: AnyMemory, index: int) -> AnyMemory:
    return map_memory(lambda states: states[:, index], prefixes)


def _same(encoder: TaskEncoder, memory: AnyMemory, other: AnyMemory) -> bool:
    """Whether two memories give the same belief."""
    beliefs: tuple[Tensor, Tensor] = encoder.belief(memory).double(), encoder.belief(other).double()
    return th.allclose(*beliefs, rtol=1e-6, atol=1e-8)

"""A task that switches in mid-episode: noticed by the log Bayes factor, answered by forgetting what came before.

Page's cumulative sum (1954): the log Bayes factors of the prior against the belief add up, never below 0; where the
sum passes a threshold, the task is taken to have switched when the sum last left 0.
"""

from __future__ import annotations

from typing import NamedTuple

import torch as th
from torch import Tensor

from sb3_bruno.encoders import Statistics, TaskEncoder, Transitions


class Suspicion(NamedTuple):
    """How strongly the last transitions speak for another task than the belief's.

    :ivar evidence: the cumulative sum in nats, 0 or more, shape (..., 1)
    :ivar recent: the statistics of the transitions since it last was 0
    """

    evidence: Tensor
    recent: Statistics


def no_suspicion(encoder: TaskEncoder, batch_shape: tuple[int, ...]) -> Suspicion:
    """That of an episode's start."""
    recent = encoder.empty(batch_shape)
    return Suspicion(recent[0].new_zeros(*batch_shape, 1), recent)


def absorb_or_forget(
    encoder: TaskEncoder, statistics: Statistics, suspicion: Suspicion, transitions: Transitions, threshold: float
) -> tuple[Statistics, Suspicion]:
    """Absorb one more transition each; where the evidence passes the threshold, keep the recent ones alone.

    :param threshold: nats; a higher one forgets later and less often without a cause
    """
    evidence = suspicion.evidence + encoder.log_bayes_factor(statistics, transitions).unsqueeze(-1)
    begun = where(suspicion.evidence > 0, suspicion.recent, encoder.empty(tuple(evidence.shape[:-1])))
    recent = encoder.absorb(begun, transitions)
    switched = evidence > threshold
    statistics = where(switched, recent, encoder.absorb(statistics, transitions))
    return statistics, Suspicion(th.where(switched, 0.0, evidence.clamp(min=0)), recent)


def where(mask: Tensor, yes: Statistics, no: Statistics) -> Statistics:
    """Choose statistics. mask: (..., 1)"""
    return tuple(th.where(mask, a, b) for a, b in zip(yes, no, strict=True))

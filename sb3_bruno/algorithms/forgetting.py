"""Notices a task that switches in mid-episode, by the log Bayes factor, and forgets what came before.

Page's cumulative sum (1954): the log Bayes factors of the prior against the belief add up, never below 0. Where the
sum passes a threshold, the task is taken to have switched when the sum last left 0.
"""

from __future__ import annotations

from typing import NamedTuple

import torch as th
from torch import Tensor

from sb3_bruno.encoders import Predicts, TaskEncoder, Transitions
from sb3_bruno.encoders.abilities import check_ability
from sb3_bruno.encoders.base import AnyMemory, choose_memory


class Suspicion(NamedTuple):
    """How strongly the last transitions speak for another task than the belief's.

    Attributes:
        evidence: the cumulative sum in nats, 0 or more, shape (..., 1).
        recent: the memory of the transitions since it last was 0.
    """

    evidence: Tensor
    recent: AnyMemory


def no_suspicion(encoder: TaskEncoder, batch_shape: tuple[int, ...]) -> Suspicion:
    """Make the suspicion of an episode's start."""
    recent = encoder.empty(batch_shape)
    return Suspicion(recent[0].new_zeros(*batch_shape, 1), recent)


def choose_suspicion(mask: Tensor, yes: Suspicion, no: Suspicion) -> Suspicion:
    """Take ``yes`` where the mask, shape (..., 1), is True, and ``no`` elsewhere."""
    return Suspicion(th.where(mask, yes.evidence, no.evidence), choose_memory(mask, yes.recent, no.recent))


def absorb_or_forget(
    encoder: TaskEncoder, memory: AnyMemory, suspicion: Suspicion, transitions: Transitions, threshold: float
) -> tuple[AnyMemory, Suspicion]:
    """Absorb one more transition each; where the evidence passes the threshold, keep the recent ones alone.

    Args:
        encoder: one that ``Predicts``.
        memory: of the transitions so far, shapes (..., anything).
        suspicion: of a switch so far.
        transitions: the next ones, (..., dim).
        threshold: nats; a higher one forgets later and less often without a cause.

    Raises:
        ValueError: if the encoder does not predict.
    """
    predictor: Predicts = check_ability(encoder, Predicts, "`forget_threshold`")
    evidence = suspicion.evidence + predictor.log_bayes_factor(memory, transitions).unsqueeze(-1)
    begun = choose_memory(suspicion.evidence > 0, suspicion.recent, encoder.empty(tuple(evidence.shape[:-1])))
    recent = encoder.absorb(begun, transitions)
    switched = evidence > threshold
    memory = choose_memory(switched, recent, encoder.absorb(memory, transitions))
    return memory, Suspicion(th.where(switched, 0.0, evidence.clamp(min=0)), recent)

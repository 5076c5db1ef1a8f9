"""Task encoders: from transitions to a belief over the hidden task."""

from sb3_bruno.encoders.abilities import (
    HasPosterior,
    InfersTask,
    MeasuresDistance,
    Moments,
    Outcomes,
    Predicts,
    PredictsMoments,
)
from sb3_bruno.encoders.base import Loss, TaskEncoder, TaskSequences, Transitions
from sb3_bruno.encoders.bruno import BrunoEncoder
from sb3_bruno.encoders.checker import check_encoder
from sb3_bruno.encoders.recurrent import RecurrentEncoder
from sb3_bruno.encoders.registry import ENCODERS, find_encoder

__all__ = [
    "ENCODERS",
    "BrunoEncoder",
    "HasPosterior",
    "InfersTask",
    "Loss",
    "MeasuresDistance",
    "Moments",
    "Outcomes",
    "Predicts",
    "PredictsMoments",
    "RecurrentEncoder",
    "TaskEncoder",
    "TaskSequences",
    "Transitions",
    "check_encoder",
    "find_encoder",
]

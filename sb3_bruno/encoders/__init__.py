"""Task encoders: from transitions to a belief over the hidden task."""

from sb3_bruno.encoders.base import Outcomes, Statistics, TaskEncoder, Transitions
from sb3_bruno.encoders.bruno import BrunoEncoder

__all__ = ["BrunoEncoder", "Outcomes", "Statistics", "TaskEncoder", "Transitions"]

"""Figures of learning and adaptation, and a video. Needs the ``plots`` extra."""

from sb3_bruno.evaluation.band import Band
from sb3_bruno.plotting.curves import plot_adaptation, plot_learning_curves

__all__ = ["Band", "plot_adaptation", "plot_learning_curves"]

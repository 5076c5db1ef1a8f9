"""Figures of learning and adaptation, and a video. Needs the ``plots`` extra."""

from sb3_bruno.plotting.curves import plot_adaptation, plot_learning_curves
from sb3_bruno.plotting.style import Band

__all__ = ["Band", "plot_adaptation", "plot_learning_curves"]

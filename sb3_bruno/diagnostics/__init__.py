"""How far an agent's belief can be trusted: measurements, numbers, a figure, a callback. Needs the ``plots`` extra."""

from sb3_bruno.diagnostics.callback import DiagnosticsCallback
from sb3_bruno.diagnostics.diagnose import diagnose
from sb3_bruno.diagnostics.figure import draw_diagnostics, plot_diagnostics
from sb3_bruno.diagnostics.result import Diagnostics

__all__ = ["Diagnostics", "DiagnosticsCallback", "diagnose", "draw_diagnostics", "plot_diagnostics"]

"""Draws the frames of a film: the env's image, how it moves, and what the agent has taken its task for so far."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sb3_bruno.evaluation.floats import Floats
from sb3_bruno.plotting.encode import Frame
from sb3_bruno.plotting.reading import Reading
from sb3_bruno.plotting.style import COLORS, GREY, INK, apart, as_text, style_panel

SIZE = (720, 376)  # pixels: a square for the image, a header above it, a chart beside it
_DPI = 100
_HEADER = 56  # pixels
_MOST_NAMED = 4  # up to so many lines have a label each


class Moment(NamedTuple):
    """What a film shows of one step.

    Attributes:
        image: the env's.
        reading: what the agent takes its task for, before it acts.
        title: what the hidden task is called.
        task: the hidden task, ``(task_dim,)``.
        velocity: m/s along x; None if the env does not tell.
        reward: of the step before, NaN at first.
        is_slow: whether the film is in slow motion here.
    """

    image: Frame
    reading: Reading
    title: str
    task: Floats
    velocity: float | None
    reward: float
    is_slow: bool


class FilmFigure:
    """Draws one moment after another; the lines of what the agent takes its task for grow.

    The figure is made without pyplot.

    Args:
        first: the first moment, for what stays the same.
        n_steps: of the film.
        switches: steps at which the task switches.
        slow: how many times slower slow motion is.
    """

    def __init__(self, first: Moment, n_steps: int, switches: list[int], slow: int) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(figsize=(SIZE[0] / _DPI, SIZE[1] / _DPI), dpi=_DPI)
        self.canvas = FigureCanvasAgg(figure)
        width, height = (SIZE[1] - _HEADER) / SIZE[0], 1.0 - _HEADER / SIZE[1]  # of the image, in shares of the frame
        picture = figure.add_axes((0.0, 0.0, width, height))
        self.header = figure.add_axes((0.0, height, width, 1.0 - height))
        self.chart = figure.add_axes((width + 0.08, 0.14, 0.31, 0.70))
        self._make_picture(picture, first, slow)
        self._make_header()
        self._make_chart(first.reading, n_steps, switches)
        self.moments: list[Moment] = []

    def draw(self, moment: Moment) -> Frame:
        """Draw the next moment."""
        self.moments.append(moment)
        self.image.set_data(moment.image)
        self.slow.set_visible(moment.is_slow)
        self._draw_header(moment)
        self._draw_chart()
        self.canvas.draw()
        return np.asarray(self.canvas.buffer_rgba())[..., :3].copy()

    def _make_picture(self, picture: Any, first: Moment, slow: int) -> None:
        picture.set_axis_off()
        self.image = picture.imshow(first.image)
        box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 2.0}
        look: dict[str, Any] = {"fontsize": 9, "color": INK, "bbox": box, "transform": picture.transAxes}
        self.slow = picture.text(0.02, 0.03, f"slow motion, 1/{slow}", **look)

    def _make_header(self) -> None:
        from matplotlib.patches import FancyArrowPatch

        self.header.axis((-1.0, 1.0, 0.0, 1.0))
        self.header.set_axis_off()
        self.title = self.header.text(-0.96, 0.74, "", va="center", fontsize=12, fontweight="bold", color=INK)
        self.said = self.header.text(0.96, 0.26, "", va="center", ha="right", fontsize=11, color=INK)
        look: dict[str, Any] = {
            "arrowstyle": "simple,head_width=10,head_length=8,tail_width=5",
            "color": COLORS[1],
            "linewidth": 0,
        }
        self.arrow = FancyArrowPatch((0.0, 0.26), (0.1, 0.26), shrinkA=0, shrinkB=0, **look)
        self.header.add_patch(self.arrow)
        self.longest = 1.0  # m/s that the longest arrow stands for

    def _draw_header(self, moment: Moment) -> None:
        """Name the hidden task, and draw the velocity as an arrow; where there is none, tell the reward."""
        self.title.set_text(as_text(f"hidden task: {moment.title}"))
        self.title.set_color(dict(zip(moment.reading.names, self.colors, strict=True)).get(moment.title, INK))
        speed = 0.0 if moment.velocity is None else moment.velocity
        self.longest = max(self.longest, abs(speed))
        tip = 0.55 * speed / self.longest
        self.arrow.set_positions((0.0, 0.26), (tip, 0.26))
        self.arrow.set_visible(abs(tip) > 0.05)
        told = f"reward {moment.reward:.2f}" if moment.velocity is None else f"{abs(speed):.1f} m/s"
        self.said.set_text("" if np.isnan(moment.reward) else told)

    def _make_chart(self, reading: Reading, n_steps: int, switches: list[int]) -> None:
        chart, n = self.chart, len(reading.values)
        style_panel(chart, "")
        chart.set_title(as_text(reading.about), loc="left", fontsize=10, color=INK, pad=14)
        chart.set_xlabel("step", fontsize=9, color=INK)
        chart.tick_params(labelsize=8)
        chart.set_xlim(0, max(n_steps - 1, 1))
        if reading.bounds is not None:
            margin = 0.04 * (reading.bounds[1] - reading.bounds[0])
            chart.set_ylim(reading.bounds[0] - margin, reading.bounds[1] + margin)
        for switch in switches:
            chart.axvline(switch, color=INK, linewidth=1, linestyle=(0, (2, 2)))
            above = chart.get_xaxis_transform()
            chart.text(switch, 1.0, "switch", transform=above, fontsize=8, color=INK, va="bottom", ha="center")
        self.colors = [COLORS[i % len(COLORS)] for i in range(n)]
        self.truths = [chart.plot([], [], color=GREY, linewidth=1.2, linestyle=(0, (4, 2)))[0] for _ in range(n)]
        self.lines = [chart.plot([], [], color=color, linewidth=1.8)[0] for color in self.colors]
        self.bands: list[Any] = []
        names = reading.names if n <= _MOST_NAMED else ("",) * n
        look: dict[str, Any] = {"fontsize": 9, "va": "center", "transform": chart.get_yaxis_transform()}
        self.labels = [
            chart.text(1.02, 0.0, as_text(name), color=color, **look)
            for name, color in zip(names, self.colors, strict=True)
        ]

    def _draw_chart(self) -> None:
        """Draw all readings so far, and name each line beside its end."""
        values = np.array([moment.reading.values for moment in self.moments])  # (steps, n)
        spread = np.array([moment.reading.spread for moment in self.moments])
        steps = np.arange(len(values))
        for band in self.bands:
            band.remove()
        self.bands = [
            self.chart.fill_between(steps, mean - std, mean + std, color=color, alpha=0.2, linewidth=0)
            for mean, std, color in zip(values.T, spread.T, self.colors, strict=True)
            if std.any()
        ]
        for line, mean in zip(self.lines, values.T, strict=True):
            line.set_data(steps, mean)
        if self.moments[0].reading.is_task:
            for truth, entries in zip(self.truths, np.array([moment.task for moment in self.moments]).T, strict=True):
                truth.set_data(steps, entries)
        if self.moments[0].reading.bounds is None:
            self.chart.relim()
            self.chart.autoscale_view(scalex=False)
        low, high = self.chart.get_ylim()
        for label, place in zip(self.labels, apart(values[-1], gap=0.06 * (high - low)), strict=True):
            label.set_y(place)

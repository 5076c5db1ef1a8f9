"""Tells what goes on in the agent, in words and in charts that scroll: its read-out, its rewards, its surprise."""

from __future__ import annotations

import viser

from sb3_bruno.live.chart import GREY, Chart, Line
from sb3_bruno.live.history import History
from sb3_bruno.live.session import NATS, Moment, Session
from sb3_bruno.live.words import chances, color_of, numbers, page_part, place_of
from sb3_bruno.plotting.style import INK

_MOST_NUMBERS = 4  # of a task in one chart; more cannot be told apart
_EVIDENCE = "#D55E00"


class Readout:
    """A part of the page.

    Args:
        gui: where it is added.
        session: of the agent.
    """

    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._history = session, History()
        self._words = gui.add_html(page_part(session.no_readout))
        self._belief = None if session.no_readout else _belief_chart(gui, session)
        self._reward = Chart(gui, "Reward of each step", [Line(INK)])
        self._surprise: Chart | None = None
        if session.can_forget:
            lines = [Line(INK, 1.0), Line(_EVIDENCE, 2.0), Line(GREY, 1.0, (4, 4))]
            title = "Surprise in nats, and its sum (orange)"
            self._surprise = Chart(gui, title, lines, linear_to=NATS)  # a switch of the task surprises by hundreds

    def add(self, moment: Moment) -> None:
        """Take in one more step."""
        self._history.add(moment)

    def show(self) -> None:
        """Show the last steps."""
        if len(self._history) == 0:
            return
        steps = self._history.steps
        self._reward.show(steps, self._history.rewards())
        if self._surprise is not None:
            self._surprise.show(steps, self._history.surprises(self._session.forget_threshold))
        if self._belief is None:
            return
        estimate, task = self._history.last.estimate, self._history.last.task
        if estimate.probabilities is not None:
            truth = -1 if task is None else place_of(task, estimate.tasks)
            self._words.content = chances(estimate.labels.tasks, estimate.probabilities[0], truth)
            self._belief.show(steps, self._history.probabilities())
        else:
            self._words.content = numbers(estimate, task)
            self._belief.show(steps, self._history.entries(_MOST_NUMBERS))


def _belief_chart(gui: viser.GuiApi, session: Session) -> Chart:
    """Make the chart of the read-out: a probability for each of a few tasks, or a band for each of a task's numbers."""
    if session.estimate.probabilities is not None:
        lines = [Line(color_of(place), 2.0) for place in range(len(session.estimate.tasks))]
        return Chart(gui, "Probability of each task", lines, between=(0.0, 1.0))
    n_shown = min(session.estimate.mean.shape[-1], _MOST_NUMBERS)
    lines, bands = [], []
    for place in range(n_shown):
        colour = color_of(place)
        bands.append((len(lines), len(lines) + 1))
        lines += [Line(colour, 0.0), Line(colour, 0.0), Line(colour, 2.0), Line(colour, 1.0, (4, 4))]
    return Chart(gui, "Read-out with its spread, and the true task (dashed)", lines, bands=bands)

"""Tells what goes on in the agent, in words and in charts that scroll: its read-out, its rewards, its surprise."""

from __future__ import annotations

import viser

from sb3_bruno.algorithms.task_estimate import TaskEstimate
from sb3_bruno.live.chart import GREY, Chart, Line
from sb3_bruno.live.session import NATS, Moment, Session
from sb3_bruno.live.words import chart_row, color_of, page_part, told
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
        self._session, self._n_steps = session, 0
        self._words = gui.add_html(page_part(session.no_readout))
        self._belief = None if session.estimate is None else _belief_chart(gui, session.estimate)
        self._reward = Chart(gui, "Reward of each step", [Line(INK)])
        self._surprise: Chart | None = None
        if session.can_forget:
            lines = [Line(INK, 1.0), Line(_EVIDENCE, 2.0), Line(GREY, 1.0, (4, 4))]
            title = "Surprise in nats, and its sum (orange)"
            self._surprise = Chart(gui, title, lines, linear_to=NATS)  # a switch surprises by hundreds
        self.show()

    def add(self, moment: Moment) -> None:
        """Take in one more step."""
        self._n_steps += 1
        self._reward.add(self._n_steps, [moment.reward])
        if self._surprise is not None:
            threshold = self._session.forget_threshold or 0.0
            self._surprise.add(self._n_steps, [moment.surprise or 0.0, moment.evidence or 0.0, threshold])
        if self._belief is not None and moment.estimate is not None:
            self._belief.add(self._n_steps, chart_row(moment.estimate, moment.task, _MOST_NUMBERS))

    def show(self) -> None:
        """Show the last steps, and what the agent takes for the task that there is now."""
        for chart in (self._belief, self._reward, self._surprise):
            if chart is not None:
                chart.show()
        if self._session.estimate is not None:
            self._words.content = told(self._session.estimate, self._session.task)


def _belief_chart(gui: viser.GuiApi, prior: TaskEstimate) -> Chart:
    """Make the chart of the read-out: a probability for each of a few tasks, or a band for each of a task's numbers."""
    if prior.tasks is not None:
        lines = [Line(color_of(place), 2.0) for place in range(len(prior.tasks))]
        return Chart(gui, "Probability of each task", lines, between=(0.0, 1.0))
    lines, bands = [], []
    for place in range(min(prior.mean.shape[-1], _MOST_NUMBERS)):
        colour = color_of(place)
        bands.append((len(lines), len(lines) + 1))
        lines += [Line(colour, 0.0), Line(colour, 0.0), Line(colour, 2.0), Line(colour, 1.0, (4, 4))]
    return Chart(gui, "Read-out with its spread, and the true task (dashed)", lines, bands=bands)

"""The controls of the hidden task: a button for each of a few tasks, else sliders."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import viser
from numpy.typing import NDArray

from sb3_bruno.live.session import Session
from sb3_bruno.live.sliders import Slider, move, round_step, rounded, value_of
from sb3_bruno.live.task_choice import Direction, Entries, FewTasks, OnlyDrawn, can_draw, find_choice
from sb3_bruno.live.words import place_of

Do = Callable[[Callable[[], None]], None]
"""Takes what is to be done between two steps."""
Task = NDArray[np.float32]
Show = Callable[[Task], None]
"""Lets controls show a task, ``(task_dim,)``."""


def add_task_controls(gui: viser.GuiApi, session: Session, do: Do) -> Show:
    """Add what the hidden task is chosen by, if there is a choice.

    Args:
        gui: where it is added.
        session: whose task is chosen.
        do: takes what is to be done between two steps.
    """
    choice = find_choice(session.env)
    draws = can_draw(session.env)
    if choice is None or session.task is None or (isinstance(choice, OnlyDrawn) and not draws):
        return _show_nothing
    with gui.add_folder("Hidden task"):
        if isinstance(choice, FewTasks):
            return _add_buttons(gui, session, do, choice)
        show: Show = _show_nothing
        if isinstance(choice, Direction):
            show = _add_angle(gui, session, do, choice)
        elif isinstance(choice, Entries):
            show = _add_sliders(gui, session, do, choice)
        if draws:
            gui.add_button("Draw a test task").on_click(lambda event: do(session.draw_task))
    return show


def _show_nothing(task: Task) -> None:
    """Show no task: there is no control that could."""


def _add_buttons(gui: viser.GuiApi, session: Session, do: Do, choice: FewTasks) -> Show:
    """Add a button for each task; that of the task is coloured."""
    buttons = []
    for label, task in zip(choice.labels, choice.tasks, strict=True):
        button = gui.add_button(label, color="gray")
        _on_click(button, do, partial(session.set_task, task))
        buttons.append(button)

    def show(task: Task) -> None:
        now = place_of(task, choice.tasks)
        for place, button in enumerate(buttons):
            button.color = "blue" if place == now else "gray"

    return show


def _add_angle(gui: viser.GuiApi, session: Session, do: Do, choice: Direction) -> Show:
    """Add one slider, in degrees."""
    slider = gui.add_slider("Direction (degrees)", choice.low, choice.high, 1.0, choice.low)
    drags = _Drags([slider], do, lambda values: session.set_task(choice.task(*values)))
    return lambda task: drags.show([choice.degrees(task)])


def _add_sliders(gui: viser.GuiApi, session: Session, do: Do, choice: Entries) -> Show:
    """Add a slider for each number of the task that is not the same in all."""
    sliders, places = [], np.flatnonzero(choice.low < choice.high)
    for place in places:
        label, low, high = choice.labels[place], choice.low[place], choice.high[place]
        step = round_step(high - low)
        bound = rounded(low, step)
        sliders.append(gui.add_slider(label, bound, rounded(high, step), step, bound))

    def obey(values: list[float]) -> None:
        task = choice.low.copy()
        task[places] = values
        session.set_task(np.clip(task, choice.low, choice.high))

    drags = _Drags(sliders, do, obey)
    return lambda task: drags.show(task[places].tolist())


class _Drags:
    """Tells what sliders are dragged to, and moves them to a task that was set elsewhere.

    While a drag is still to be obeyed, the sliders stay where the visitor has them.

    Args:
        sliders: of which every one tells the values of all.
        do: takes what is to be done between two steps.
        obey: is given the values.
    """

    def __init__(self, sliders: Sequence[Slider], do: Do, obey: Callable[[list[float]], None]) -> None:
        self._sliders, self._do, self._obey = sliders, do, obey
        self._n_open, self._lock = 0, threading.Lock()  # viser calls from other threads
        for slider in sliders:
            slider.on_update(lambda event: self._ask() if event.client is not None else None)

    def _ask(self) -> None:
        values = [value_of(slider) for slider in self._sliders]

        def obey() -> None:
            try:
                self._obey(values)
            finally:
                self._count(-1)

        self._count(1)
        self._do(obey)

    def _count(self, change: int) -> None:
        with self._lock:
            self._n_open += change

    def show(self, values: Sequence[float]) -> None:
        """Move the sliders to these values, as near as they can, unless a drag is still to be obeyed."""
        for slider, value in zip(self._sliders, values, strict=True):
            if not self._n_open:
                move(slider, value)


def _on_click(button: viser.GuiButtonHandle, do: Do, then: Callable[[], None]) -> None:
    """Have something done between two steps when somebody clicks a button."""
    button.on_click(lambda event: do(then))

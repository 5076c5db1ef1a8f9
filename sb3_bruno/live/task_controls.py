"""The controls of the hidden task: a button for each of a few tasks, else sliders."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import viser

from sb3_bruno.live.session import Session
from sb3_bruno.live.task_choice import Direction, Entries, FewTasks, find_choice
from sb3_bruno.live.words import place_of

Do = Callable[[Callable[[], None]], None]
"""Takes what is to be done between two steps."""
Show = Callable[[], None]


def add_task_controls(gui: viser.GuiApi, session: Session, do: Do) -> Show:
    """Add what an environment's task is chosen by.

    Args:
        gui: where it is added.
        session: whose task is chosen.
        do: takes what is to be done between two steps.

    Returns:
        A function that makes the controls show the task as it is now.
    """
    choice = find_choice(session.env)
    if choice is None:
        return lambda: None
    with gui.add_folder("Hidden task"):
        if isinstance(choice, FewTasks):
            return _add_buttons(gui, session, do, choice)
        show = (
            _add_angle(gui, session, do, choice)
            if isinstance(choice, Direction)
            else _add_sliders(gui, session, do, choice)
        )
        gui.add_button("Draw a test task").on_click(lambda event: do(session.draw_task))
    return show


def _add_buttons(gui: viser.GuiApi, session: Session, do: Do, choice: FewTasks) -> Show:
    """Add a button for each task; that of the task is coloured."""
    buttons = []
    for label, task in zip(choice.labels, choice.tasks, strict=True):
        button = gui.add_button(label, color="gray")
        button.on_click(lambda event, task=task: do(lambda: session.set_task(task)))
        buttons.append(button)

    def show() -> None:
        now = place_of(session.task, choice.tasks)
        for place, button in enumerate(buttons):
            button.color = "blue" if place == now else "gray"

    return show


def _add_angle(gui: viser.GuiApi, session: Session, do: Do, choice: Direction) -> Show:
    """Add one slider, in degrees."""
    slider = gui.add_slider("Direction (degrees)", choice.low, choice.high, 1.0, choice.degrees(session.task))
    _on_drag(slider, lambda: do(lambda: session.set_task(choice.task(slider.value))))
    return lambda: _move(slider, choice.degrees(session.task))


def _add_sliders(gui: viser.GuiApi, session: Session, do: Do, choice: Entries) -> Show:
    """Add a slider for each number of the task."""
    sliders = []
    for label, low, high, value in zip(choice.labels, choice.low, choice.high, session.task, strict=True):
        step = _step(high - low)
        low, high = (_rounded(bound, step) for bound in (low, high))
        sliders.append(_add_slider(gui, label, low, high, step, float(value)))

    def apply() -> None:
        session.set_task(np.clip([slider.value for slider in sliders], choice.low, choice.high))

    for slider in sliders:
        _on_drag(slider, lambda: do(apply))

    def show() -> None:
        for slider, value in zip(sliders, session.task, strict=True):
            _move(slider, float(value))

    return show


def _add_slider(
    gui: viser.GuiApi, label: str, low: float, high: float, step: float, value: float
) -> viser.GuiSliderHandle[float]:
    """Add a slider."""
    return gui.add_slider(label, low, high, step, _fitting(value, low, high, step))


def _on_drag(slider: viser.GuiSliderHandle[float], then: Callable[[], None]) -> None:
    """Call a function when somebody moves a slider, and not when ``_move`` does."""
    slider.on_update(lambda event: then() if event.client is not None else None)


def _move(slider: viser.GuiSliderHandle[float], value: float) -> None:
    """Move a slider, unless it is there already."""
    fitting = _fitting(value, slider.min, slider.max, slider.step)
    if slider.value != fitting:
        slider.value = fitting


def _step(width: float) -> float:
    """Return a round step that divides a range into a hundred parts or more: 0.01 of a range of 3."""
    return 10.0 ** math.floor(math.log10(width / 100.0)) if width > 0 else 1.0


def _fitting(value: float, low: float, high: float, step: float) -> float:
    """Return the number nearest to a value that a slider can show."""
    return min(max(_rounded(value, step), low), high)


def _rounded(value: float, step: float) -> float:
    """Return a number with as many digits as a step: 0.667 as 0.67 with a step of 0.01."""
    return round(float(value), max(-math.floor(math.log10(step)), 0))

"""The controls of the page. What they are told is done between two steps, by whoever takes it from the queue."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from html import escape

import viser

from sb3_bruno.live.session import NATS, Moment, Session
from sb3_bruno.live.sliders import value_of
from sb3_bruno.live.task_controls import Do, add_task_controls
from sb3_bruno.live.words import page_part


class Panel:
    """The controls of one session.

    Args:
        gui: where they are added.
        session: what they control.
        agents: the names of the agents to choose from.
        chosen: the name of the session's.
        do: takes what is to be done.
        open_agent: opens the agent of a name.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        session: Session,
        agents: Sequence[str],
        chosen: str,
        do: Do,
        open_agent: Callable[[str], None],
    ) -> None:
        self._session = session
        pick = gui.add_dropdown("Agent", list(agents), initial_value=chosen)

        def open_or_stay(name: str) -> None:
            try:
                open_agent(name)
            except ValueError:
                pick.value = chosen  # type: ignore[misc]  # mypy misses viser's setter
                raise

        pick.on_update(lambda event: do(partial(open_or_stay, pick.value)))
        self._status = gui.add_html("")
        self._task = gui.add_html("")
        self._show_task = add_task_controls(gui, session, do)
        self._add_run_controls(gui, do)
        if session.can_forget:
            self._add_forgetting(gui, do)
        self.show(None)

    def _add_run_controls(self, gui: viser.GuiApi, do: Do) -> None:
        session = self._session
        with gui.add_folder("Run"):
            self._pause = gui.add_button("Pause", color="dark", icon=viser.Icon.PLAYER_PAUSE)
            anew = gui.add_button(
                "New episode", color="dark", icon=viser.Icon.REFRESH, hint="the agent starts from its prior"
            )
            speed = gui.add_slider("Speed", 0.05, 1.0, 0.05, 1.0, hint="1: as fast as the environment's own clock")
            exact = gui.add_checkbox("Deterministic", session.deterministic, hint="off: actions are drawn")

        def toggle() -> None:
            session.is_paused = not session.is_paused

        self._pause.on_click(lambda event: do(toggle))
        anew.on_click(lambda event: do(session.reset))
        speed.on_update(lambda event: do(lambda: setattr(session, "speed", value_of(speed))))
        exact.on_update(lambda event: do(lambda: setattr(session, "deterministic", exact.value)))

    def _add_forgetting(self, gui: viser.GuiApi, do: Do) -> None:
        session = self._session
        with gui.add_folder("Forgetting"):
            forgets = gui.add_checkbox("Notice a switch", True, hint="off: the agent never forgets")
            began_with = min(max(session.forget_threshold or NATS, 1.0), 50.0)  # the slider's ends
            nats = gui.add_slider("Evidence, nats", 1.0, 50.0, 0.5, began_with)

        def apply() -> None:
            session.forget_threshold = value_of(nats) if forgets.value else None

        forgets.on_update(lambda event: do(apply))
        nats.on_update(lambda event: do(apply))

    def show(self, moment: Moment | None) -> None:
        """Show where the session is.

        Args:
            moment: the last step; None before the first one of an episode.
        """
        session = self._session
        step, total = (0, 0.0) if moment is None else (moment.step, moment.episode_return)
        self._status.content = page_part(f"Episode {session.n_episodes}, step {step}, return {total:.1f}")
        self._task.content = page_part(f"Hidden task: <b>{escape(session.task_name or _numbers(session))}</b>")
        self._pause.label = "Go on" if session.is_paused else "Pause"
        self._pause.icon = viser.Icon.PLAYER_PLAY if session.is_paused else viser.Icon.PLAYER_PAUSE
        if session.task is not None:
            self._show_task(session.task)


def _numbers(session: Session) -> str:
    """Write a task that has no name."""
    return "none" if session.task is None else ", ".join(f"{number:.3g}" for number in session.task)

"""The page: it shows an agent that acts at its environment's own pace, and does what its visitors ask for."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import viser

from sb3_bruno.live.pace import Pace
from sb3_bruno.live.panel import Panel
from sb3_bruno.live.picture import PictureScene
from sb3_bruno.live.readout import Readout
from sb3_bruno.live.robot import RobotScene, is_robot
from sb3_bruno.live.session import Moment, Session
from sb3_bruno.live.view import View

_FRAME = 1 / 30  # seconds between two images, at least
_CHART = 1 / 8  # seconds between two drawings of the charts, at least
_PATIENCE = 0.5  # seconds that a page waits for visitors before it looks whether it should end


class Scene(Protocol):
    """What an environment is shown in."""

    @property
    def view(self) -> View:
        """Return where to look from."""

    def update(self, *, jumps: bool) -> None:
        """Note where the environment is after a step, or where it jumped to at a reset."""

    def draw(self, progress: float) -> None:
        """Show it on its way there, from 0 to 1."""


class Page:
    """Serves a page on which an agent acts.

    Args:
        agents: the names of the agents to choose from.
        open_session: opens the agent of a name.
        chosen: the agent to begin with.
        host: the address to listen at.
        port: its port; the next free one is taken if it is in use.

    Attributes:
        session: the agent that acts.
        server: viser's.
    """

    _moment: Moment | None  # the last step of the episode, if there is one
    _scene: Scene | None
    _panel: Panel
    _readout: Readout
    _drawn: float  # when the picture was drawn
    _charted: float  # when the charts were

    def __init__(
        self,
        agents: Sequence[str],
        open_session: Callable[[str], Session],
        chosen: str,
        *,
        host: str = "127.0.0.1",
        port: int = 8080,
    ) -> None:
        self._agents, self._open_session = agents, open_session
        self._chosen, self.session = chosen, open_session(chosen)
        self._asked: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._ends = threading.Event()
        self._pace = Pace()
        self.server = viser.ViserServer(host=host, port=port, label="sb3-bruno live", verbose=False)
        self.server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._build()

    @property
    def url(self) -> str:
        """Return the page's address."""
        host = self.server.get_host()
        return f"http://{'localhost' if host == '0.0.0.0' else host}:{self.server.get_port()}"

    def run(self) -> None:
        """Act, while anybody looks on, until ``end`` is called."""
        try:
            while not self._ends.is_set():
                waits = self.session.is_paused or not self.server.get_clients()
                try:
                    asked = self._asked.get(timeout=_PATIENCE if waits else min(self._pace.wait(), _FRAME))
                except queue.Empty:
                    if not waits:
                        self._try(self._go_on, "The agent cannot go on")
                else:
                    self._obey(asked)
        finally:
            self.session.close()
            self.server.stop()

    def end(self) -> None:
        """End ``run``; any thread may call it."""
        self._ends.set()
        self._asked.put(lambda: None)

    def _go_on(self) -> None:
        """Take a step if one is due; show the picture and the charts no more often than can be seen."""
        if self._pace.wait() == 0.0:
            self._pace.step(self.session.seconds_per_step)
            moment = self._moment = self.session.step()
            self._readout.add(moment)
            if self._scene is not None:
                self._scene.update(jumps=moment.step == 1)
        now = time.monotonic()
        if self._scene is not None and now - self._drawn >= _FRAME:
            self._scene.draw(self._pace.progress())
            self._drawn = now
        if now - self._charted >= _CHART:
            with self.server.atomic():
                self._panel.show(self._moment)
                self._readout.show()
            self._charted = now

    def _obey(self, asked: Callable[[], None]) -> None:
        """Do what a visitor asked for, and show what it changed."""
        n_episodes = self.session.n_episodes
        self._try(asked, "This cannot be done")
        if self.session.n_episodes != n_episodes:
            self._moment = None
            if self._scene is not None:
                self._scene.update(jumps=True)
                self._scene.draw(1.0)
        self._panel.show(self._moment)
        self._readout.show()

    def _try(self, act: Callable[[], None], failure: str) -> None:
        """Do something. If it fails, tell all visitors why; an agent that cannot go on pauses."""
        try:
            act()
        except Exception as error:  # an environment of the user's own may raise anything
            self.session.is_paused |= act == self._go_on
            self._panel.show(self._moment)
            for client in self.server.get_clients().values():
                client.add_notification(failure, str(error), auto_close_seconds=10.0, color="red")

    def _open(self, name: str) -> None:
        """Show another agent.

        Raises:
            Exception: whatever keeps it from being loaded or shown; the page then stays as it is.
        """
        if name == self._chosen:
            return
        before = self._chosen, self.session
        session = self._open_session(name)
        self._chosen, self.session = name, session
        try:
            self._build()
        except Exception:
            self.session.close()
            self._chosen, self.session = before
            self._build()
            raise
        before[1].close()

    def _build(self) -> None:
        """Build the page for its session."""
        gui = self.server.gui
        gui.reset()
        self.server.scene.reset()
        self._moment = None
        self._drawn = self._charted = 0.0
        self._scene = make_scene(self.server, self.session.env)
        self._look(View((0.0, -3.0, 1.0), (0.0, 0.0, 0.0)) if self._scene is None else self._scene.view)
        self._panel = Panel(gui, self.session, self._agents, self._chosen, self._asked.put, self._open)
        beside = gui.add_panel()
        with beside.add_tab("What the agent believes"):
            self._readout = Readout(gui, self.session)
        gui.main_panel.dock_left()
        gui.main_panel.set_width(290)
        beside.dock_right()
        beside.set_width(380)

    def _look(self, view: View) -> None:
        """Move the cameras of all visitors, also of those who come later."""
        self.server.initial_camera.position, self.server.initial_camera.look_at = view
        for client in self.server.get_clients().values():
            client.camera.position, client.camera.look_at = view


def make_scene(server: viser.ViserServer, env: Any) -> Scene | None:
    """Make the scene of an environment; None if it can be neither shown in 3-D nor painted."""
    if is_robot(env):
        return RobotScene(server, env)
    return PictureScene(server, env) if env.render_mode == "rgb_array" else None

"""The page stays as it is where another agent cannot be shown, and says what is no picture."""

import re
from contextlib import contextmanager
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
import viser
from stable_baselines3 import SAC

from sb3_bruno import BrunoSAC
from sb3_bruno.live.page import Page
from sb3_bruno.live.picture import PictureScene
from sb3_bruno.live.session import Session
from support.tiny_models import POINT, tiny

ODD = {
    "nothing": None,
    "one of several": [np.zeros((4, 4, 3), np.uint8)],
    "grey": np.zeros((4, 4), np.uint8),
    "floats": np.zeros((4, 4, 3)),
    "empty": np.zeros((0, 4, 3), np.uint8),
    "two colours": np.zeros((4, 4, 2), np.uint8),
}


class Painting(gym.Wrapper):
    """Paints what it is told, and notes that it was closed."""

    def __init__(self, image):
        super().__init__(gym.make("Pendulum-v1", render_mode="rgb_array"))
        self.image, self.is_closed = image, False

    def render(self):
        return self.image

    def close(self):
        self.is_closed = True
        super().close()


@pytest.fixture(scope="module")
def model():
    return SAC("MlpPolicy", "Pendulum-v1", buffer_size=10, policy_kwargs={"net_arch": [4]})


@contextmanager
def served():
    server = viser.ViserServer(port=8431, verbose=False)
    try:
        yield server
    finally:
        server.stop()


def test_an_agent_that_cannot_be_shown_leaves_the_page_as_it_is(model):
    envs = {"good": Painting(np.zeros((4, 4, 3), np.uint8)), "odd": Painting(None)}
    page = Page(list(envs), lambda name: Session(model, envs[name]), "good", port=8431)
    try:
        shown = page.session
        with pytest.raises(ValueError, match="painted nothing"):
            page._open("odd")
        assert page.session is shown and envs["odd"].is_closed and not envs["good"].is_closed
        page._go_on()  # and acts on
        page._open("good")  # which it shows already
        assert page.session is shown
    finally:
        page.server.stop()


def test_a_page_that_is_paused_shows_what_there_is_now():
    session = Session(BrunoSAC("MlpPolicy", POINT, **tiny(BrunoSAC)), gym.make(POINT))
    page = Page(["point"], lambda name: session, "point", port=8431)
    try:
        session.set_task([1.0, 0.0])
        for _ in range(5):
            page._readout.add(session.step())
        page._obey(partial(setattr, session, "is_paused", True))
        assert re.search(r"right [\d.]+ ◂ true", page._readout._words.content)
        page._obey(partial(session.set_task, [-1.0, 0.0]))
        assert "left" in page._panel._task.content
        assert re.search(r"left [\d.]+ ◂ true", page._readout._words.content)
        before = page._readout._words.content
        page._obey(session.reset)
        prior = dict(zip(session.estimate.labels.tasks, session.estimate.probabilities[0], strict=True))
        assert f"left {prior['left']:.2f} ◂ true" in page._readout._words.content != before
    finally:
        page.server.stop()


def test_what_is_no_picture_is_named():
    with served() as server:
        for image in ODD.values():
            with pytest.raises(ValueError, match=r"painted (nothing|an array of shape .*): have `render` return"):
                PictureScene(server, Painting(image))

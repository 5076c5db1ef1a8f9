"""A bar is for people: it is on a terminal or nowhere."""

import sys

import pytest

from sb3_bruno.evaluation.progress import progress


class Terminal:
    """A stderr that may be a terminal."""

    def __init__(self, is_terminal):
        self.text, self._is_terminal = "", is_terminal

    def write(self, text):
        self.text += text

    def flush(self):
        pass

    def isatty(self):
        return self._is_terminal


@pytest.mark.parametrize(
    ("is_terminal", "shown", "draws"), [(True, True, True), (True, False, False), (False, True, False)]
)
def test_it_is_silent_where_nobody_watches(monkeypatch, is_terminal, shown, draws):
    stderr = Terminal(is_terminal)
    monkeypatch.setattr(sys, "stderr", stderr)
    assert list(progress(range(3), shown=shown, about="episodes")) == [0, 1, 2]
    assert ("episodes" in stderr.text) == (is_terminal and shown)

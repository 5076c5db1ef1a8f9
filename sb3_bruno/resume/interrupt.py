"""Ctrl-C and SIGTERM end a training with a checkpoint at the start of the next rollout, so that nothing is lost."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from sb3_bruno.resume.callback import ResumeCallback

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_ASKED = b"\nInterrupted: a checkpoint is saved when this rollout ends. Interrupt again to stop at once.\n"


class InterruptibleResumeCallback(ResumeCallback):
    """Saves checkpoints as ResumeCallback does, and one more when the training is interrupted.

    Inside ``listening()``, the first Ctrl-C or SIGTERM has a checkpoint saved at the start of the next rollout, which
    then raises KeyboardInterrupt: the run can be resumed exactly. If it cannot be written, it raises NotWritten.
    A second signal raises KeyboardInterrupt at once.
    """

    _is_interrupted = False

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Handle the two signals for the block; in the main thread, for no other may."""
        self._is_interrupted = False
        with _handled(self._interrupt, _SIGNALS):
            yield

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self._is_interrupted:
            raise KeyboardInterrupt
        self._is_interrupted = True
        os.write(2, _ASKED)  # print may be what was interrupted, and is not reentrant

    def _on_rollout_start(self) -> None:
        if self._is_interrupted:
            self.save()
            raise KeyboardInterrupt
        super()._on_rollout_start()


@contextmanager
def deaf_children() -> Iterator[None]:
    """Let processes that start in the block ignore Ctrl-C: a terminal sends it to all, and the parent handles it."""
    with _handled(signal.SIG_IGN, (signal.SIGINT,)):
        yield


@contextmanager
def _handled(handler: Any, numbers: tuple[signal.Signals, ...]) -> Iterator[None]:
    """Handle signals for the block, in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        numbers = ()
    before = {number: signal.getsignal(number) for number in numbers}
    before = {number: handled for number, handled in before.items() if handled != signal.SIG_IGN}  # as nohup has it
    for number in before:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number, handled in before.items():
            signal.signal(number, signal.SIG_DFL if handled is None else handled)

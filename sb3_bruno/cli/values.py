"""Converts what flags are given, and says what else to give where that cannot be. Imports no library at the start."""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

LARGEST_SEED = 2**32 - 1  # NumPy's


def whole_number(
    least: int | None = None, most: int | None = None, *, also: tuple[int, ...] = ()
) -> Callable[[str], int]:
    """Make a converter to whole numbers, which may be written as ``1e5``.

    Args:
        least: the least number; None for any.
        most: the largest; None for any.
        also: numbers outside that are taken too.
    """
    bounds = {(True, False): f" of {least} or more", (True, True): f" from {least} to {most}"}
    allowed = "a whole number" + bounds.get((least is not None, most is not None), "")
    allowed += "".join(f", or {number}" for number in also)

    def convert(text: str) -> int:
        value = _as_whole(text)
        outside = value is None or (least is not None and value < least) or (most is not None and value > most)
        if value is None or (outside and value not in also):
            raise argparse.ArgumentTypeError(f"{text!r} is not {allowed}")
        return value

    return convert


def _as_whole(text: str) -> int | None:
    """Read a whole number; None if it is none."""
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return int(float(text)) if float(text).is_integer() else None
    except ValueError:
        return None


at_least_one = whole_number(1)
seed = whole_number(0, LARGEST_SEED)


def device(text: str) -> str:
    """Check that torch has a device here.

    Raises:
        argparse.ArgumentTypeError: if it has not.
    """
    import torch as th

    if text == "auto":
        return text
    try:
        chosen = th.device(text)
    except RuntimeError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no device of torch: give auto, cpu or cuda") from error
    if chosen.type == "cuda" and (chosen.index or 0) >= th.cuda.device_count():
        raise argparse.ArgumentTypeError(f"there is no {text!r} here: give auto or cpu")
    return text


def writable_folder(text: str) -> Path:
    """Check that a folder can be made, or written to, by making another beside it for a moment.

    Raises:
        argparse.ArgumentTypeError: if it cannot.
    """
    if not text:
        raise argparse.ArgumentTypeError("'' is no folder: give its name, . for this one")
    nearest = _nearest(text)
    if not nearest.is_dir():
        raise argparse.ArgumentTypeError(f"{text!r} cannot be written, for {nearest} is no folder: give another")
    try:
        with TemporaryDirectory(prefix=".sb3-bruno-", dir=nearest):  # root may write everywhere, says os.access
            pass
    except OSError as error:
        problem = f"{text!r} cannot be written, for nothing can be made in {nearest} ({error.strerror})"
        raise argparse.ArgumentTypeError(f"{problem}: give another") from error
    return Path(text)


def _nearest(text: str) -> Path:
    """Find the first that exists of a path and the folders that it is in.

    Raises:
        argparse.ArgumentTypeError: if it is too long, or in a folder that nobody may look into.
    """
    path = Path(text)
    try:
        return next(place for place in (path, *path.absolute().parents) if place.exists())
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{text[:100]!r} cannot be written: {error.strerror}: give another") from error


def writable_file(text: str) -> Path:
    """Check that a file can be written, without writing it.

    Raises:
        argparse.ArgumentTypeError: if it cannot.
    """
    if _nearest(text) == Path(text) and Path(text).is_dir():
        raise argparse.ArgumentTypeError(f"{text!r} is a folder: give a file in it")
    writable_folder(str(Path(text).parent))
    return Path(text)


def agent_file(text: str) -> str:
    """Check that there is a zip file to train on; "" is rl_zoo3's default, for none.

    Raises:
        argparse.ArgumentTypeError: if there is none.
    """
    if text and not (text.endswith(".zip") and Path(text).is_file()):
        raise argparse.ArgumentTypeError(f"{text!r} is no file of an agent: give the .zip that a training saved")
    return text


def tensorboard_folder(text: str) -> str:
    """Check that TensorBoard is there to write to the folder; "" is rl_zoo3's default, for none.

    Raises:
        argparse.ArgumentTypeError: if it is not installed, or the folder cannot be written.
    """
    if not text:
        return text
    if importlib.util.find_spec("tensorboard") is None:
        raise argparse.ArgumentTypeError("tensorboard is not installed: pip install tensorboard")
    return str(writable_folder(text))

"""An error's message as part of another message."""

from sb3_bruno.files.shown import printable


def in_one_line(error: Exception) -> str:
    """Return the message on one line, with the kind of error if the message alone is seldom a sentence."""
    speaks = isinstance(error, ValueError | TypeError | AssertionError | OSError | ImportError)
    line = printable(" ".join(str(error).split()))
    return line if speaks else f"{type(error).__name__}: {line}"

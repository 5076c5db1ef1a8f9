"""An error's message as part of another message."""


def in_one_line(error: Exception) -> str:
    """Return the message on one line, with the kind of error if the message alone is seldom a sentence."""
    speaks = isinstance(error, ValueError | TypeError | AssertionError | OSError | ImportError)
    line = " ".join(str(error).split())
    return line if speaks else f"{type(error).__name__}: {line}"

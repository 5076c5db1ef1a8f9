"""What the user can mend."""


class Mistake(Exception):
    """A mistake in the command, said in one line."""


def mistake_of(error: Exception) -> Mistake:
    """What was raised over a command, as a line; where the message is seldom a sentence, with its kind."""
    named = isinstance(error, ValueError | TypeError | AssertionError | OSError | ImportError)
    line = " ".join(str(error).split())
    return Mistake(line if named else f"{type(error).__name__}: {line}")

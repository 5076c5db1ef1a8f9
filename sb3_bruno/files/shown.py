"""Shows what a file of somebody else's says, in an error on one line: nothing in it commands a terminal."""

from __future__ import annotations

import reprlib

_LONGEST = 60
_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxlong = _SHORT.maxother = _LONGEST


def shown(value: object) -> str:
    """Write a name or a value as Python does, with what cannot be printed escaped, and cut to about 60 characters."""
    text = _SHORT.repr(value)
    return text if len(text) <= _LONGEST + 2 else f"{text[:_LONGEST]}..."


def printable(message: str) -> str:
    """Escape what cannot be printed in a message, which foreign code may have made of what a file says."""
    return "".join(char if char.isprintable() else ascii(char)[1:-1] for char in message)

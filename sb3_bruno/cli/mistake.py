"""A mistake in a command, told in one line instead of a traceback."""

import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from sb3_bruno.zoo.one_line import in_one_line


class Mistake(Exception):
    """A mistake in the command, with its remedy, in one line."""


@contextmanager
def told_as_mistake(kind: type[Exception] = ValueError, unless: Callable[[], bool] = lambda: False) -> Iterator[None]:
    """Turn an error of the block into a Mistake, whose message the command prints.

    Args:
        kind: the errors that a mistake of the user's can cause there; others keep their traceback.
        unless: asked when an error is raised. If true, the error keeps its traceback.

    Raises:
        Mistake: if the block raises an error of ``kind``.
    """
    try:
        yield
    except Mistake:
        raise
    except kind as error:
        if unless():
            raise
        raise Mistake(in_one_line(error)) from error


def check_installed(*libraries: str, extra: str = "zoo") -> None:
    """Refuse to begin what a library that is missing would end.

    Args:
        *libraries: by the names that they are imported by.
        extra: of this package, which brings them.

    Raises:
        Mistake: if one is not installed.
    """
    for library in libraries:
        if importlib.util.find_spec(library) is None:
            raise Mistake(f"{library} is not installed: pip install 'sb3_bruno[{extra}]'")

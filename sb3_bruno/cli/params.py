"""Reads ``-params NAME:VALUE ...`` as rl_zoo3 does: a VALUE is Python. Text needs no quotes here."""

from __future__ import annotations

import argparse
import re
from typing import Any

from sb3_bruno.cli.mistake import Mistake
from sb3_bruno.zoo.one_line import in_one_line

BARE_WORD = re.compile(r"[A-Za-z_][\w.+-]*")
YAMLS_WORDS = {"true": True, "false": False, "null": None, "none": None}


class StoreParams(argparse.Action):
    """Stores the values by their names. A flag that is given twice adds to what it stored."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option_string: Any = None
    ) -> None:
        """Read each word.

        Raises:
            Mistake: if one cannot be read, or a name is given twice.
        """
        params = dict(getattr(namespace, self.dest) or {})
        for word in values:
            name, value = read_param(word, str(option_string))
            if name in params:
                raise Mistake(f"{option_string} {word}: {name} is given twice, leave one out")
            params[name] = value
        setattr(namespace, self.dest, params)


def read_param(word: str, flag: str) -> tuple[str, Any]:
    """Read one ``NAME:VALUE``.

    Raises:
        Mistake: if it is none.
    """
    name, colon, text = word.partition(":")
    if not colon or not name.isidentifier():
        left, equals, right = word.partition("=")
        remedy = f"write {left}:{right}" if equals and left.isidentifier() else "give NAME:VALUE"
        raise Mistake(f"{flag} {word}: {remedy}")
    if text.lower() in YAMLS_WORDS:
        return name, YAMLS_WORDS[text.lower()]
    try:
        return name, _evaluated(text)
    except Exception as error:  # Python may raise anything
        if isinstance(error, NameError | SyntaxError) and BARE_WORD.fullmatch(text):
            return name, text
        raise Mistake(
            f"{flag} {word}: {in_one_line(error)}: give NAME:VALUE, a VALUE that is text in quotes"
        ) from error


def _evaluated(text: str) -> Any:
    """Evaluate a value as rl_zoo3 does, which knows ``nn``, ``th`` and ``gym``."""
    from rl_zoo3.utils import StoreDict

    store, found = StoreDict([], "params"), argparse.Namespace()  # type: ignore[no-untyped-call]  # rl_zoo3's
    store(argparse.ArgumentParser(), found, [f"value:{text}"])
    return found.params["value"]

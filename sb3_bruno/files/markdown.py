"""Writes what a record or a file says into Markdown, which shows it as it is and makes nothing else of it."""

from __future__ import annotations

import html
import re

from sb3_bruno.files.shown import printable


def as_text(said: str) -> str:
    """Write text on one line, in which no letter makes a link, code, HTML or the column of a table."""
    line = printable(" ".join(said.split()))
    return re.sub(r"[\\`*|~]|\](?=[(\[:])", r"\\\g<0>", html.escape(line, quote=False))


def as_code(text: str, language: str) -> str:
    """Write a block of code, or of text that keeps its lines, which no backticks in it can end."""
    lines = "\n".join(map(printable, text.strip().splitlines()))
    longest = max(map(len, re.findall("`+", lines)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}{language}\n{lines}\n{fence}"

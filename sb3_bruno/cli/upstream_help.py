"""Prints our flags and those of a script of rl_zoo3, read from its source: to import it would take seconds."""

from __future__ import annotations

import argparse
import ast
import importlib.util
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from sb3_bruno.cli.mistake import check_installed
from sb3_bruno.cli.parser import Parser
from sb3_bruno.cli.upstream import DEFAULTS


def exit_with_help(parser: Parser, rest: Sequence[str], script: str) -> None:
    """Print our flags and those of rl_zoo3's script, and exit, if ``--help`` is among the rest of the flags."""
    if {"-h", "--help"} & set(rest):
        parser.print_help()
        print(f"\nand the flags of rl_zoo3 (with our defaults: {DEFAULTS}):\n\n{_flags_of(script)}")
        sys.exit(0)


def _flags_of(script: str) -> str:
    """Describe the flags of ``rl_zoo3/SCRIPT.py``, without the names of algorithms, which it has to import."""
    check_installed("rl_zoo3")
    package = importlib.util.find_spec("rl_zoo3")
    assert package is not None and package.origin is not None  # for mypy: it is installed
    source = Path(package.origin).with_name(f"{script}.py").read_text(encoding="utf-8")
    parser = argparse.ArgumentParser(usage=argparse.SUPPRESS)
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "parser.add_argument":
            parser.add_argument(*map(ast.literal_eval, node.args), **_literals(node.keywords))
    return parser.format_help()


def _literals(keywords: list[ast.keyword]) -> dict[str, Any]:
    """Read the keywords whose values are literals: not the converters, and not what imported names say."""
    found = {}
    for keyword in keywords:
        with suppress(ValueError):
            found[str(keyword.arg)] = ast.literal_eval(keyword.value)
    return found

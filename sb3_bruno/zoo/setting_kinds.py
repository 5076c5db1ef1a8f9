"""Refuses settings of a run that are of other kinds than `sb3-bruno train` saves: somebody may have written them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from sb3_bruno.files.shown import shown


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_text_or_none(value: Any) -> bool:
    return value is None or isinstance(value, str)


def _are_texts(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(entry, str) for entry in value)


def _are_named(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(name, str) for name in value)


def _are_named_or_none(value: Any) -> bool:
    return value is None or _are_named(value)


def _is_switch(value: Any) -> bool:
    return value is None or isinstance(value, bool | str) or _are_named(value)


def _are_wrappers(value: Any) -> bool:
    """Tell whether rl_zoo3 can read wrappers: one or a list, each a name, or a dict of a name and its arguments."""
    return value is None or all(_is_wrapper(entry) for entry in (value if isinstance(value, list) else [value]))


def _is_wrapper(value: Any) -> bool:
    return isinstance(value, str) or (_are_named(value) and len(value) == 1 and all(map(_are_named, value.values())))


KINDS: Mapping[str, tuple[Callable[[Any], bool], str]] = {
    "algo": (_is_text, "a text"),
    "conf_file": (_is_text_or_none, "a text"),
    "gym_packages": (_are_texts, "a list of texts"),
    "hyperparams": (_are_named_or_none, "values by name"),
    "env_kwargs": (_are_named_or_none, "values by name"),
    "env_wrapper": (_are_wrappers, "a wrapper's name, with its arguments or alone, or a list of them"),
    "vec_env_wrapper": (_are_wrappers, "a wrapper's name, with its arguments or alone, or a list of them"),
    "normalize": (_is_switch, "true, false, or arguments by name"),
}
"""What each setting that is read must be, and how to say so."""


def check_settings_kinds(saved: Mapping[str, Any], path: Path) -> None:
    """Refuse settings of a wrong kind.

    Args:
        saved: the settings of ``args.yml`` or ``config.yml``, by name.
        path: the file, for the error.

    Raises:
        ValueError: naming file, setting and value.
    """
    for name, value in saved.items():
        if not isinstance(name, str):
            raise ValueError(f"{path} cannot be read: it has the setting {shown(name)}, which is no name: train again")
        is_right, words = KINDS.get(name, (None, ""))
        if is_right is not None and not is_right(value):
            raise ValueError(f"{path} cannot be read: its {name} is {shown(value)}, and not {words}: train again")

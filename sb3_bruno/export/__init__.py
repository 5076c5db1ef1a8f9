"""Agents as files: one that this package loads without running code, and one that acts without this package."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sb3_bruno.export.agent_file import load_agent, save_agent
    from sb3_bruno.export.classes import register_agent_class
    from sb3_bruno.export.controller import Controller
    from sb3_bruno.export.write_step import export_agent

__all__ = ["Controller", "export_agent", "load_agent", "register_agent_class", "save_agent"]

_HOMES = {
    "Controller": "controller",
    "export_agent": "write_step",
    "load_agent": "agent_file",
    "register_agent_class": "classes",
    "save_agent": "agent_file",
}
"""The module of every name above."""


def __getattr__(name: str) -> Any:
    """Import what is asked for only then: to run an exported agent takes neither torch nor Stable-Baselines3."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

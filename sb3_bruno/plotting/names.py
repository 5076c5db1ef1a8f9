"""What people call a method: "BrunoSAC", "told the task", "no memory", and what differs from its config."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

ORACLE = "told the task"
"""What SAC is called that observes the task."""

_CONFIGS = {"oracle": ORACLE, "markov": "no memory"}
_WRITTEN = {"crossq": "CrossQ"}


def method_name(config: Mapping[str, Any], left_out: Collection[str] = ()) -> str:
    """Name a method by the settings of its runs, as ``RunRecord`` keeps them.

    Example: ``sac`` with the config ``oracle`` is ``"told the task"``; ``bruno_tqc`` with the parameter
    ``encoder_kwargs.belief`` of ``mean`` is ``"BrunoTQC, belief=mean"``.

    Args:
        config: ``algo``, and if there are such ``conf``, ``params`` and ``deterministic``.
        left_out: choices, as ``choices`` says them, that go without saying.
    """
    algo, conf = str(config["algo"]), str(config.get("conf") or "")
    name = _algorithm(algo)
    if conf:
        called = _CONFIGS.get(conf, conf)
        name = called if algo == "sac" and conf in _CONFIGS else f"{name}, {called}"
    said = [choice for choice in choices(config) if choice not in left_out]
    return ", ".join([name, *said])


def choices(config: Mapping[str, Any]) -> list[str]:
    """List what the runs of a method do differently from its config: ``"belief=mean"``, ``"stochastic"``."""
    changed = [f"{name.rpartition('.')[2]}={value}" for name, value in config.get("params", {}).items()]
    return changed + ([] if config.get("deterministic", True) else ["stochastic"])


def _algorithm(algo: str) -> str:
    """Write RL Zoo's name of an algorithm as its class: ``"bruno_sac"`` gives ``"BrunoSAC"``."""
    if not algo.replace("_", "").isalnum() or not algo.islower():
        return algo
    *mixin, base = algo.split("_")
    return "".join([*(word.capitalize() for word in mixin), _WRITTEN.get(base, base.upper())])

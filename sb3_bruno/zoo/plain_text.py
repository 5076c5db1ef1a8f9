"""Checks that the Python in a study's settings only says values: RL Zoo evaluates it, on every worker's machine."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Mapping
from typing import Any

import gymnasium as gym
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnvWrapper

EVALUATED = ("policy_kwargs", "replay_buffer_class", "replay_buffer_kwargs", "monitor_kwargs", "normalize")
NAMES = ("dict", "nn", "HerReplayBuffer", "RMSpropTFLike")  # what RL Zoo's own configs use
VALUES = (ast.Constant, ast.List, ast.Tuple, ast.Set, ast.Dict, ast.UnaryOp, ast.USub, ast.keyword, ast.Load)
CALLED = {"env_wrapper": gym.Wrapper, "vec_env_wrapper": VecEnvWrapper, "callback": BaseCallback}  # named, then made


def check_texts(config: Mapping[str, Any]) -> None:
    """Check every text of a config that RL Zoo evaluates, or looks up and calls.

    Raises:
        ValueError: if one is more than plain values, ``dict(...)`` and layers of ``nn``; or names what is no wrapper or
            callback.
    """
    for name in EVALUATED:
        text = config.get(name)
        if isinstance(text, str) and not _is_plain(text):
            raise ValueError(f"{name}={text!r} is more than plain values, dict(...) and nn.ReLU: write it with these")
    for name, kind in CALLED.items():
        given = config.get(name)
        for entry in given if isinstance(given, list) else [given] if given else []:
            path = next(iter(entry), "") if isinstance(entry, dict) else entry
            if not names_a(kind, path):
                raise ValueError(f"{name}={path!r} is no {kind.__name__} that can be imported: name another")


def _is_plain(text: str) -> bool:
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return False
    return all(_is_plain_node(node) for node in ast.walk(tree))


def _is_plain_node(node: ast.AST) -> bool:
    """Tell whether a part of an expression is a value, a known name, a layer, or calls ``dict`` or a layer."""
    if isinstance(node, ast.Name):
        return node.id in NAMES
    if isinstance(node, ast.Attribute):
        return isinstance(node.value, ast.Name) and node.value.id == "nn" and not node.attr.startswith("_")
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Attribute) or (isinstance(node.func, ast.Name) and node.func.id == "dict")
    if isinstance(node, ast.Lambda):  # lambda: nn.LeakyReLU(0.2)
        return not ast.unparse(node.args)
    return isinstance(node, (*VALUES, ast.arguments))


def names_a(kind: type, path: Any) -> bool:
    """Tell whether "package.module.Class" is a class of a kind."""
    module, _, name = str(path).rpartition(".")
    try:
        found = getattr(importlib.import_module(module), name)
    except Exception:  # importing runs a module, which may raise anything
        return False
    return isinstance(found, type) and issubclass(found, kind)

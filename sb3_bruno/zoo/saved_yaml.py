"""Reads the YAML that RL Zoo saves with a run as data: nothing in it is called, and no module imported."""

from __future__ import annotations

import sys
from collections import OrderedDict
from pathlib import Path
from typing import Any

import torch as th
import yaml
from stable_baselines3.common.buffers import BaseBuffer

from sb3_bruno.zoo.one_line import in_one_line

LARGEST = 200_000  # bytes
MOST_ALIASES = 20
MOST_VALUES = 100_000  # each counted as often as aliases repeat it
NAMED = (th.nn.Module, th.optim.Optimizer, BaseBuffer)  # what a hyperparameter may name a class of


class SavedLoader(yaml.SafeLoader):  # type: ignore[misc]  # yaml has no types
    """Load plain values, tuples, the OrderedDict that RL Zoo saves, and the names of known kinds of classes."""

    n_aliases = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node:
        """Compose a node. RL Zoo writes few aliases; a page of them can stand for more than memory holds."""
        if self.check_event(yaml.AliasEvent):
            self.n_aliases += 1
            if self.n_aliases > MOST_ALIASES:
                mark = self.peek_event().start_mark
                raise yaml.composer.ComposerError(None, None, f"it has more than {MOST_ALIASES} aliases", mark)
        return super().compose_node(parent, index)

    def ordered_dict(self, node: yaml.Node) -> OrderedDict[str, Any]:
        """Construct what ``yaml.dump`` writes for an OrderedDict: a sequence that holds its items."""
        items = self.construct_sequence(node, deep=True) if isinstance(node, yaml.SequenceNode) else []
        return OrderedDict(*items)

    def python_tuple(self, node: yaml.Node) -> tuple[Any, ...]:
        """Construct a tuple."""
        return tuple(self.construct_sequence(node, deep=True))

    def named_class(self, name: str, node: yaml.Node) -> type:
        """Look up a class that has been imported.

        Raises:
            yaml.constructor.ConstructorError: if there is none of a kind that a hyperparameter may name.
        """
        module, _, attribute = name.rpartition(".")
        found = getattr(sys.modules.get(module), attribute, None)
        if not (isinstance(found, type) and issubclass(found, NAMED)):
            problem = f"{name} is no network, optimiser or buffer that is imported"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
        return found


SavedLoader.add_constructor("tag:yaml.org,2002:python/object/apply:collections.OrderedDict", SavedLoader.ordered_dict)
SavedLoader.add_constructor("tag:yaml.org,2002:python/tuple", SavedLoader.python_tuple)
SavedLoader.add_multi_constructor("tag:yaml.org,2002:python/name:", SavedLoader.named_class)


def read_saved(path: Path) -> dict[str, Any]:
    """Read ``args.yml`` or ``config.yml`` of a run.

    Raises:
        ValueError: if there is no such file, or it does not hold a mapping of plain values.
    """
    if not path.is_file():
        raise ValueError(f"{path.parent} has no {path.name}, which `sb3-bruno train` writes: train there")
    if path.stat().st_size > LARGEST:
        raise ValueError(f"{path} cannot be read: it has more than {LARGEST:,} bytes, as no settings have: train again")
    try:
        saved = yaml.load(path.read_text(encoding="utf-8"), Loader=SavedLoader)  # a SafeLoader
    except Exception as error:  # a damaged or hostile file may raise anything
        raise ValueError(f"{path} cannot be read: {in_one_line(error)}: train again") from error
    if not _is_small(saved):
        raise ValueError(f"{path} cannot be read: it holds more than {MOST_VALUES:,} values, or itself: train again")
    if not isinstance(saved, dict):
        raise ValueError(f"{path} cannot be read: it holds no settings by name: train again")
    return dict(saved)


def _is_small(saved: Any) -> bool:
    """Tell whether a value holds few others, however aliases nest it."""
    rest, n_values = [saved], 0
    while rest and n_values <= MOST_VALUES:
        value = rest.pop()
        n_values += 1
        if isinstance(value, dict):
            rest += [*value, *value.values()]
        elif isinstance(value, list | tuple | set):
            rest += value
    return n_values <= MOST_VALUES

"""Builds a flow from arguments by name, and names those that neither it nor what it passes them on to takes."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from typing import Any

from zuko.flows import ElementWiseTransform, GeneralCouplingTransform, MaskedAutoregressiveTransform
from zuko.lazy import Flow
from zuko.nn import MLP

PASSED_ON = (MaskedAutoregressiveTransform, GeneralCouplingTransform, ElementWiseTransform, MLP)
"""Where zuko's flows pass on arguments that are not their own."""
FILLED = {"self", "features", "context", "in_features", "out_features", "args", "kwargs"}
"""Names that nobody gives in ``flow_kwargs``."""


def build_flow(
    flow_class: Callable[..., Flow], features: int, context: int, flow_kwargs: Mapping[str, Any] | None
) -> Flow:
    """Build a flow.

    Args:
        flow_class: builds it.
        features: dimension of y and z.
        context: dimension of x.
        flow_kwargs: further arguments of ``flow_class``.

    Raises:
        TypeError: if ``flow_kwargs`` is no dict.
        ValueError: if a name in it is unknown, with the nearest right one, or a value cannot be.
    """
    if not flow_kwargs:
        return flow_class(features, context)
    if not isinstance(flow_kwargs, Mapping):
        raise TypeError(f"`flow_kwargs={flow_kwargs!r}` is no dict: give the arguments by name.")
    try:
        return flow_class(features, context, **flow_kwargs)
    except Exception as error:  # of foreign code, at a value of any kind
        unknown = re.search(r"unexpected keyword argument '(\w+)'", str(error))
        if unknown is None:
            raise ValueError(f"`flow_kwargs={flow_kwargs!r}` cannot be: {error!r}. Correct the value.") from error
        name, known = unknown[1], _names(flow_class)
        nearest = get_close_matches(name, known, n=1)
        remedy = f"did you mean `{nearest[0]}`?" if nearest else f"it takes {', '.join(known) or 'nothing'}."
        raise ValueError(f"`flow_kwargs` has no `{name}`: {remedy}") from error


def _names(flow_class: Callable[..., Flow]) -> list[str]:
    """List the arguments of a flow, and of what it passes them on to."""
    if not isinstance(flow_class, type):
        builders: list[Callable[..., Any]] = [flow_class]
    else:
        flows = [cls for cls in flow_class.__mro__ if issubclass(cls, Flow) and cls is not Flow]
        builders = [vars(cls)["__init__"] for cls in (*flows, *PASSED_ON) if "__init__" in vars(cls)]
    names = [name for builder in builders for name in inspect.signature(builder).parameters]
    return [name for name in dict.fromkeys(names) if name not in FILLED]

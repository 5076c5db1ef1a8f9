"""Refuses ``policy_kwargs`` that a policy, its optimiser or its networks do not take. Knows no algorithm."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from typing import Any

import torch as th

from sb3_bruno.algorithms.arguments import check_known, check_names
from sb3_bruno.algorithms.values import check_values, check_whole


def check_policy_kwargs(
    policy_class: type, given: Mapping[str, Any] | None, inference: Mapping[str, Any], *, use_sde: bool
) -> None:
    """Refuse arguments that a policy or its optimiser does not take, and networks that cannot be built.

    Args:
        policy_class: the policy.
        given: its arguments by name, as the user gave them.
        inference: those that the algorithm gives.
        use_sde: the algorithm's own, which SB3 writes into the dict that it was given.

    Raises:
        TypeError: if a value is of a wrong kind.
        ValueError: if a name is unknown, with the nearest right one; or a number is too small.
    """
    given = given or {}
    own = {"self", "args", "kwargs", "observation_space", "action_space", "lr_schedule", "task_space", *inference}
    known = [
        name
        for cls in policy_class.__mro__
        if "__init__" in vars(cls) and cls is not object
        for name in inspect.signature(vars(cls)["__init__"]).parameters
        if name not in own
    ]
    check_known("policy_kwargs", given, list(dict.fromkeys(known)))
    if given.get("use_sde", use_sde) != use_sde:  # SB3 would overwrite it
        raise ValueError("`policy_kwargs` has ['use_sde']: pass `use_sde=...` to the algorithm itself.")
    check_values(given)
    optimizer = given.get("optimizer_class", th.optim.Adam)
    for name, value in (("optimizer_class", optimizer), ("activation_fn", given.get("activation_fn", th.nn.ReLU))):
        if not callable(value):
            raise TypeError(f"`{name}={value!r}` is no class: give one of torch's, such as `torch.nn.ReLU`.")
    check_values({"policy_kwargs": given.get("optimizer_kwargs")})
    check_names("optimizer_kwargs", given.get("optimizer_kwargs"), optimizer, {"params", "lr"})
    _check_net_arch(given.get("net_arch"))


def _check_net_arch(net_arch: Any) -> None:
    nets = {"": net_arch} if not isinstance(net_arch, Mapping) else net_arch
    if isinstance(net_arch, Mapping) and len(nets) < 2:
        raise ValueError(f"`net_arch={net_arch!r}` lacks a net: give the layers of the actor, 'pi', and critics, 'qf'.")
    for key, sizes in nets.items():
        name = f"net_arch[{key!r}]" if key else "net_arch"
        if isinstance(net_arch, Mapping) and key not in ("pi", "qf"):
            raise ValueError(f"`{name}` is unknown: give the layers of the actor as 'pi', and of the critics as 'qf'.")
        if sizes is None:
            continue
        if not isinstance(sizes, list | tuple):
            raise TypeError(f"`{name}={sizes!r}` is no list: give the size of each layer, such as [256, 256].")
        for size in sizes:
            check_whole(name, size, 1)

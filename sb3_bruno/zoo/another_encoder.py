"""Lets a user choose another encoder than a config's: what the config says for its own is left out."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

from sb3_bruno.encoders import TaskEncoder
from sb3_bruno.zoo.configs import flat, merged
from sb3_bruno.zoo.registry import ALGORITHMS, encoder_of
from sb3_bruno.zoo.tried import encoder_or_class, try_encoder

OF_ENCODER = ("encoder_kwargs", "encoder_learning_rate")
OF_ITS_UPDATES = ("encoder_batch_size", "encoder_update_ratio", "encoder_learning_starts")


def fitted_to_encoder(algo: str, config: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Fit a config to the encoder that the user chooses, and print what was left out of it or changed.

    Example: bruno_sac.yml has ``encoder_kwargs: {modelled: rewards}`` and ``encoder_batch_size: 16`` for BRUNO. With
    ``-params encoder_class:recurrent``, which takes neither, both are left out.

    Args:
        algo: rl_zoo3's name of the algorithm.
        config: the config's hyperparameters.
        given: the user's own, such as those of ``-params``. They are never left out: if wrong, they are refused later.

    Returns:
        The config's hyperparameters, for the user's to be merged into.

    Raises:
        ValueError: if there is no encoder of that name.
    """
    if algo not in ALGORITHMS or not given.keys() & {"encoder_class", "encoder_kwargs"}:
        return dict(config)
    fitted = _with_arguments_of_the_encoder(algo, config, given)
    before, after = (_encoder(algo, hyperparams) for hyperparams in (config, merged(fitted, given)))
    if before.learns_from == "own" and after.learns_from != "own":
        fitted = _without(fitted, OF_ITS_UPDATES)
    if (
        before.learns_from != "critic"
        and after.learns_from == "critic"
        and fitted.get("critic_input") in (None, "task")
    ):
        fitted["critic_input"] = "belief"  # else their loss would teach it nothing
    buffer = fitted.get("replay_buffer_kwargs")
    if before.order != "time" and after.order == "time" and isinstance(buffer, Mapping) and "context" in buffer:
        fitted["replay_buffer_kwargs"] = {**buffer, "context": "episode"}  # the others shuffle transitions
    _tell(merged(config, given), merged(fitted, given))
    return fitted


def _with_arguments_of_the_encoder(algo: str, config: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Leave out the arguments of a config's encoder: all for another class, else those refused beside the user's."""
    chosen = encoder_of(algo, {**config, **given})
    if chosen is not encoder_of(algo, config):
        return _without(config, OF_ENCODER)
    ours, theirs = config.get("encoder_kwargs"), given.get("encoder_kwargs")
    if not isinstance(ours, Mapping) or not isinstance(theirs, Mapping):
        return dict(config)
    return {**config, "encoder_kwargs": _without(ours, _refused(chosen, ours, theirs))}


def _refused(encoder_class: type[TaskEncoder], ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> tuple[str, ...]:
    """Name the fewest of our arguments that have to go for an encoder to take the rest beside theirs.

    None have to go if it does not take theirs alone: then its error is about theirs.
    """
    if try_encoder(encoder_class, theirs) is None:
        return ()
    names = [name for name in ours if name not in theirs]
    sets = (some for size in range(len(names) + 1) for some in combinations(names, size))
    return next(some for some in sets if try_encoder(encoder_class, {**_without(ours, some), **theirs}) is not None)


def _encoder(algo: str, hyperparams: Mapping[str, Any]) -> TaskEncoder | type[TaskEncoder]:
    return encoder_or_class(encoder_of(algo, hyperparams), hyperparams.get("encoder_kwargs"))


def _without(settings: Mapping[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if name not in names}


def _tell(before: Mapping[str, Any], after: Mapping[str, Any]) -> None:
    """Print in one line how hyperparameters have changed, if they have."""
    old, new = flat(before), flat(after)
    left_out = [f"{name}={value!r}" for name, value in old.items() if name not in new]
    taken = [f"{name}={value!r}" for name, value in new.items() if name not in old or old[name] != value]
    told = [f"leaving out {', '.join(left_out)}"] if left_out else []
    told += [f"taking {', '.join(taken)}"] if taken else []
    if told:
        print(f"The config is for another encoder: {'; '.join(told)}")

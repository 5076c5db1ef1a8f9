"""What a trial of a search drew, to train with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import optuna

from sb3_bruno.zoo.journal import open_journal
from sb3_bruno.zoo.plain_text import check_texts
from sb3_bruno.zoo.registry import converter_of
from sb3_bruno.zoo.storage import is_journal, is_missing


def drawn_in_trial(
    storage: str | None, study_name: str | None, trial_id: int, algo: str, config: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what a trial of RL Zoo's search or of our sweep drew, as constructor arguments.

    Args:
        storage: the journal or database of the search.
        study_name: the study's name in it.
        trial_id: the trial's number in the study.
        algo: rl_zoo3's name of the algorithm.
        config: the hyperparameters that were not drawn.

    Raises:
        ValueError: if the trial cannot be found, or has not drawn all that the algorithm needs.
    """
    if storage is None or study_name is None:
        raise ValueError(f"--trial-id {trial_id} is of a study: give its --storage and --study-name")
    if is_missing(storage):
        raise ValueError(f"--storage {storage} is no file: give the one of the search")
    try:
        kept = open_journal(Path(storage)) if is_journal(storage) else storage
        drawn = optuna.load_study(study_name=study_name, storage=kept).trials[trial_id].params
        converted = converter_of(algo, config)({**drawn, "n_envs": config.get("n_envs", 1)})
    except (KeyError, IndexError) as error:
        study = f"{study_name} in {storage}"
        raise ValueError(
            f"--trial-id {trial_id}: {study} has no such trial with all its draws: give one that `sb3-bruno sweep "
            "export` lists"
        ) from error
    check_texts(converted)  # RL Zoo evaluates the text in it
    return converted

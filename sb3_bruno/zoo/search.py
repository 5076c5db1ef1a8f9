"""A study of RL Zoo's own search: it is gone on with only by what began it."""

from __future__ import annotations

from pathlib import Path

import optuna

from sb3_bruno.zoo.journal import open_journal
from sb3_bruno.zoo.storage import is_journal, without_password
from sb3_bruno.zoo.study import SETTINGS

SEARCHED = "searched"  # user attribute of a study: the algorithm and environment that it searches for


def begin_or_join(storage: str, name: str, algo: str, env_id: str) -> None:
    """Make a study for RL Zoo's search, or check that one of that name searches for the same.

    Args:
        storage: a journal file, or the address of a database.
        name: the study's name in it.
        algo: rl_zoo3's name of the algorithm.
        env_id: id of the environment.

    Raises:
        ValueError: if another search began the study, whose trials would mix with these.
    """
    if is_journal(storage):
        Path(storage).parent.mkdir(parents=True, exist_ok=True)
    kept = open_journal(Path(storage)) if is_journal(storage) else storage
    study = optuna.create_study(study_name=name, storage=kept, direction="maximize", load_if_exists=True)
    given = f"--study-name {name} in {without_password(storage)}"
    if SETTINGS in study.user_attrs:
        raise ValueError(f"{given} is a sweep: go on with sb3-bruno sweep run, or name another")
    searched, asked = study.user_attrs.get(SEARCHED), {"algo": algo, "env": env_id}
    if searched is None:
        study.set_user_attr(SEARCHED, asked)
    elif searched != asked:
        theirs = " on ".join(map(str, searched.values())) if isinstance(searched, dict) else searched
        raise ValueError(f"{given} searches for {theirs}, not {algo} on {env_id}: name another")

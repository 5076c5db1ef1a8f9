"""Writes the card of an agent, a README with what it is, how well it does and how it was made, from its record."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping, Sequence

from huggingface_sb3 import EnvironmentName

from sb3_bruno.files.markdown import as_code, as_text
from sb3_bruno.runs.folder import AGENT_FILE
from sb3_bruno.runs.record import RunRecord

PICTURE = "adaptation.png"
_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_.-]*-v[0-9]+")  # what YAML reads as a text without quotes
_TAGS = ("sb3_bruno", "stable-baselines3", "reinforcement-learning", "meta-reinforcement-learning")


def write_card(
    record: RunRecord,
    command: Sequence[str],
    *,
    class_name: str,
    has_picture: bool,
    diagnosed: str = "",
) -> str:
    """Write a card in Markdown.

    Args:
        record: of the agent's run and its final test.
        command: the arguments of ``sb3-bruno train`` that started the run; none if nobody knows.
        class_name: of its algorithm.
        has_picture: whether ``PICTURE`` lies beside the card.
        diagnosed: what ``sb3-bruno diagnose`` found; "" if it was not asked.
    """
    config = record.about["config"]
    algo, env = config["algo"], config["env"]
    file = f"{EnvironmentName(env)}{AGENT_FILE}"
    parts = [
        _front_matter(env),
        f"# {as_text(f'{record.method} on {env}')}",
        f"An agent that works out which task it is in while it acts: `{class_name}` of sb3_bruno, trained for "
        f"{config['env_steps']:,} env steps{_seed(config)}.",
        _returns(record),
        *([f"![Reward in an episode]({PICTURE})"] if has_picture else []),
        "## Use",
        as_code(shlex.join(["sb3-bruno", "enjoy", "-f", "agents", "--algo", algo, "--env", env]), "bash"),
        as_code(f"from sb3_bruno.export import load_agent\n\nagent = load_agent({json.dumps(file)})", "python"),
        "The file holds JSON and tensors alone, so that loading it runs no code of its author.",
        *(["## How far its belief can be trusted", as_code(diagnosed, "text")] if diagnosed else []),
        "## How it was made",
        _made(record, command),
        "`sb3-bruno pack` wrote this card from the record of the run.",
    ]
    return "\n\n".join(parts) + "\n"


def _front_matter(env: str) -> str:
    """Write what the Hugging Face hub reads."""
    tags = "\n".join(f"- {tag}" for tag in (*_TAGS, env if _PLAIN.fullmatch(env) else json.dumps(env)))
    return f"---\nlibrary_name: sb3_bruno\npipeline_tag: reinforcement-learning\ntags:\n{tags}\n---"


def _seed(config: Mapping[str, object]) -> str:
    return "" if config.get("seed") is None else f", seed {as_text(str(config['seed']))}"


def _returns(record: RunRecord) -> str:
    """Tabulate the mean of every measure of the final test, a row per task, or per group of them if there are many."""
    config, measures = record.about["config"], record.measures
    labels = record.episodes["task"].unique().tolist()
    groups = record.parts() or {f"all {len(labels)}": labels}
    scores = {measure: record.scores(measure) for measure in measures}
    lines = [
        "| test tasks | " + " | ".join(as_text(_heading(measure)) for measure in measures) + " |",
        "|---" * (1 + len(measures)) + "|",
    ]
    for name, tasks in groups.items():
        if len(tasks) == 0:
            continue  # as between training tasks, where all tests lie outside
        means = [f"{scores[measure][tasks].mean():,.1f}" for measure in measures]
        lines.append("| " + " | ".join([as_text(str(name)), *means]) + " |")
    n_episodes = record.episodes.groupby("task").size().max()
    actions = "the most likely actions" if config.get("deterministic", True) else "drawn actions"
    return "\n".join(lines) + f"\n\nMeans over {n_episodes} episodes of each task, with {actions}."


def _heading(measure: str) -> str:
    """Say a measure in words: ``return_200`` is the return of 200 steps."""
    kind, _, number = measure.partition("_")
    words = {"return": f"return of {number} steps", "episode": f"return of episode {number}", "success": "success in %"}
    return words.get(kind, measure)


def _made(record: RunRecord, command: Sequence[str]) -> str:
    """Tell the command, the commits and the versions."""
    found = []
    if command:
        found.append(as_code(shlex.join(["sb3-bruno", "train", *command]), "bash"))
    commits = record.about["config"].get("trained_at")
    if isinstance(commits, list) and commits:
        found.append(f"Trained at commit {as_text(', '.join(map(str, commits)))} of sb3_bruno.")
    versions = ", ".join(f"{name} {version}" for name, version in record.about["versions"].items())
    found.append(f"Tested with {as_text(versions)}.")
    return "\n\n".join(found)

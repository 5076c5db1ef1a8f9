"""A card shows what a record says, whoever wrote that, and does nothing else with it."""

import pandas as pd
import pytest
import yaml

from sb3_bruno.export.card import write_card
from sb3_bruno.runs.record import RunRecord

HOSTILE = "a|b <img src=x onerror=alert(1)> ](javascript:alert(1)) `x`\n\n# Heading"
SHOWN = r"a\|b &lt;img src=x onerror=alert(1)&gt; \](javascript:alert(1)) \`x\` # Heading"


def record(name, **config):
    """A record of two tasks, of which one has this name."""
    about = {"algo": "bruno_sac", "env": "PointDir-v0", "env_steps": 64, "seed": 1, **config}
    episodes = pd.DataFrame({"task": [name, "right"], "episode": [0, 0], "return_200": [1.0, 2.0]})
    said = {"config": about, "versions": {"torch": name}, "steps_to_90": {}}
    return RunRecord(said, pd.DataFrame(), episodes, pd.DataFrame())


def card(record, command=(), diagnosed=""):
    return write_card(record, command, class_name="BrunoSAC", has_picture=False, diagnosed=diagnosed)


def test_names_are_text_and_nothing_else():
    hostile = card(record(HOSTILE, params={"x": HOSTILE}, seed=HOSTILE, trained_at=[HOSTILE]))
    assert hostile.count(SHOWN) == 5
    assert "<" not in hostile and "\n# Heading" not in hostile
    plain = card(record("left", params={"x": "y"}, seed="2", trained_at=["z"]))
    assert len(hostile.splitlines()) == len(plain.splitlines())


def test_a_task_takes_one_cell():
    row = next(line for line in card(record(HOSTILE)).splitlines() if line.startswith("| a"))
    assert row == f"| {SHOWN} | 1.0 |"


@pytest.mark.parametrize(
    ("part", "written"),
    [
        ("x", "```bash\nsb3-bruno train --env x\n```"),
        ("```", "````bash\nsb3-bruno train --env '```'\n````"),
        ("$(rm -rf /)", "```bash\nsb3-bruno train --env '$(rm -rf /)'\n```"),
        ("\x1b[31m", "```bash\nsb3-bruno train --env '\\x1b[31m'\n```"),
    ],
)
def test_a_command_stays_in_its_block(part, written):
    assert f"\n\n{written}\n\n" in card(record("left"), ["--env", part])


def test_what_was_diagnosed_stays_in_its_block():
    written = card(record("left"), diagnosed="a ``` b\n# Heading\n")
    assert "\n\n````text\na ``` b\n# Heading\n````\n" in written


@pytest.mark.parametrize("env", ["PointDir-v0", "my/Env: [x]-v0", 'a"b\nc: d', "null", "- x"])
def test_an_env_is_one_tag(env):
    front = card(record("left", env=env)).split("---\n")[1]
    assert yaml.safe_load(front)["tags"][-1] == env


def test_a_file_is_called_as_pack_calls_it():
    assert 'load_agent("my-Env-v0.agent")' in card(record("left", env="my/Env-v0"))

"""Any encoder goes into any config, by the commands that the docs tell."""

import shlex
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
CHOICES_OF_ENCODERS = [
    line
    for page in ("encoders.md", "zoo.md")
    for line in (DOCS / page).read_text().splitlines()
    if line.strip().startswith("sb3-bruno train") and "-params" in line
]


@pytest.mark.parametrize("command", CHOICES_OF_ENCODERS)
def test_an_encoder_is_chosen_as_the_docs_say(run, command):
    printed, mistake = run(*shlex.split(command)[1:], "-n", 40, "--eval-freq", -1)
    assert mistake == "" and "The config is for another encoder: leaving out" in printed


def test_the_docs_choose_encoders():
    assert len(CHOICES_OF_ENCODERS) == 3

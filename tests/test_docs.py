"""The code in the documentation runs as it stands."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = {path.name: path.read_text() for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]}
BLOCK = re.compile(r"^```python(?: needs=(\w+))?\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)
CODE = {(name, needs): "" for name, text in PAGES.items() for needs, _ in BLOCK.findall(text)}
for page, text in PAGES.items():
    for package, block in BLOCK.findall(text):
        CODE[page, package] += block + "\n"


@pytest.mark.parametrize(("name", "needs"), CODE)
def test_python_blocks_run_in_order(name, needs, tmp_path, monkeypatch):
    if needs:  # other people's package, which our own environment lacks
        pytest.importorskip(needs)
    monkeypatch.chdir(tmp_path)
    exec(compile(CODE[name, needs], name, "exec"), {"__name__": "__main__"})


def test_the_target_in_panda_gyms_picture_is_the_task():
    pytest.importorskip("panda_gym")
    recipe = {"__name__": "__main__"}
    exec(compile(CODE["other-envs.md", "panda_gym"], "other-envs.md", "exec"), recipe)
    env = recipe["hide_goal"](recipe["panda"], [[0.1, 0.05, 0.2]], set_goal=recipe["set_goal"])
    env.reset(seed=0)
    assert env.unwrapped.sim.get_base_position("target") == pytest.approx([0.1, 0.05, 0.2])


@pytest.mark.parametrize("name", PAGES)
def test_links_and_pictures_exist(name):
    folder = ROOT if name == "README.md" else ROOT / "docs"
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", PAGES[name]):
        assert (folder / target).exists(), target

"""The code in the documentation runs as it stands."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = {path.name: path.read_text() for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]}
WITH_CODE = [name for name, text in PAGES.items() if "```python" in text]


@pytest.mark.parametrize("name", WITH_CODE)
def test_python_blocks_run_in_order(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```", PAGES[name], flags=re.MULTILINE | re.DOTALL)
    exec(compile("\n".join(blocks), name, "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize("name", PAGES)
def test_links_and_pictures_exist(name):
    folder = ROOT if name == "README.md" else ROOT / "docs"
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", PAGES[name]):
        assert (folder / target).exists(), target

"""The origin of a run outlives kills, and one that is damaged blocks nothing that can do without it."""

import json

import pytest

from sb3_bruno.runs.origin import ORIGIN, load_command, save_origin, trained_at
from support.dying import dies_at

COMMAND = ["--env", "PointDir-v0", "--seed", "1"]


def test_a_kill_while_a_resumed_run_adds_its_versions_leaves_the_command(tmp_path):
    save_origin(tmp_path, COMMAND)
    for moment in ("fsync", "replace"):
        dies_at(moment, lambda: save_origin(tmp_path, []))
        assert load_command(tmp_path) == COMMAND and len(trained_at(tmp_path)) == 1


@pytest.mark.parametrize(
    "content", [b"", b'{"command": ["--env", "Poi', b"\xff\xfe", b"[1]", b"{}", b'{"command": 3}', b"[" * 9_999]
)
@pytest.mark.filterwarnings("ignore:.*cannot be read")
def test_a_damaged_origin_is_named_where_it_is_needed_and_else_told_by_the_way(tmp_path, content):
    (tmp_path / ORIGIN).write_bytes(content)
    assert trained_at(tmp_path) == []
    with pytest.raises(ValueError, match=rf"{ORIGIN} does not tell the command .*copy it there from a backup"):
        load_command(tmp_path)


@pytest.mark.parametrize("versions", ["x", ["x", 3], {"a": 1}, None, [{"commit": [1]}], [{"commit": 5}]])
def test_versions_that_are_none_are_left_out(tmp_path, versions):
    (tmp_path / ORIGIN).write_text(json.dumps({"command": COMMAND, "versions": versions}))
    assert trained_at(tmp_path) == []
    save_origin(tmp_path, [])
    assert load_command(tmp_path) == COMMAND and len(trained_at(tmp_path)) == 1

"""``export`` writes the agent of a run, or says in one line why it does not."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch as th

from sb3_bruno.cli.main import main

AGENTS = Path(__file__).parents[2] / "agents"


@pytest.mark.mujoco
def test_the_agent_of_a_run_is_exported(run, tmp_path):
    chosen = ["--algo", "bruno_sac", "--env", "CheetahDir-v0", "-f", AGENTS, "--exp-id", 1]
    printed, mistake = run("export", *chosen, "--out", "cheetah.pt")
    assert not mistake and printed.endswith("Saved cheetah.pt\n")
    about = {"sb3_bruno": ""}
    with pytest.warns(DeprecationWarning, match="jit"):
        step = th.jit.load(tmp_path / "cheetah.pt", _extra_files=about)
    inputs = json.loads(about["sb3_bruno"])["inputs"]
    action, *_ = step(*(th.full(size, float(name == "episode_start")) for name, size in inputs.items()))
    assert action.isfinite().all() and action.shape == (1, 6)


@pytest.mark.parametrize(
    ("flags", "line"),
    [
        (["--out", "agent.zip"], "--out: 'agent.zip' ends neither in .onnx nor in .pt: give one"),
        (["--out", "agent"], "--out: 'agent' ends neither"),
        (["--out", "folder.onnx"], "--out: 'folder.onnx' is a folder"),
        (["--out", "file/agent.onnx"], "--out: 'file' cannot be written"),
        (["--steps", "3"], "--steps is unknown"),
        (["--algo", "bruno_sca"], "bruno_sca"),
        (["--algo", "bruno_sac", "-f", "nowhere"], "nowhere"),
    ],
)
def test_a_mistake_is_told_in_one_line(tmp_path, monkeypatch, capsys, flags, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.onnx").mkdir()
    (tmp_path / "file").write_text("")
    with pytest.raises(SystemExit) as end:
        main(["export", *flags])
    printed = capsys.readouterr().err.strip()
    told = printed if end.value.code == 2 else str(end.value.code)
    assert told.startswith("sb3-bruno export: ") and line in told and "\n" not in told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder.onnx"]


def test_an_agent_without_a_belief_is_refused(run, monkeypatch):
    monkeypatch.setattr("sb3_bruno.cli.export.load_agent", lambda options: SimpleNamespace(model="sac"))
    assert "--algo bruno_sac infers no task" in run("export")[1]

"""``report`` takes what a record says for data: it names no file outside ``--out``, and no table breaks."""

import json

import numpy as np
import pytest

from sb3_bruno.evaluation.adaptation_result import AdaptationResult


def make_run(folder, **config):
    """Write what ``report`` reads of a run that ``evaluate`` tested."""
    folder.mkdir(parents=True)
    about = {"algo": "bruno_sac", "env": "PointDir-v0", "env_steps": 400, "seed": 1, **config}
    AdaptationResult([[1.0], [2.0]], np.ones((2, 1, 10)), about).save(folder / "adaptation.json")
    np.savez(folder / "evaluations.npz", timesteps=[200], results=[[1.0, 2.0]], ep_lengths=[[10, 10]])
    np.savez(folder / "evaluation_tasks.npz", tasks=np.float32([[[1.0], [2.0]]]))
    return folder


@pytest.fixture
def no_page(monkeypatch):
    """Let ``report`` save records alone, for figures take seconds."""
    monkeypatch.setattr("sb3_bruno.report.page.write_page", lambda records, out: "")


@pytest.mark.parametrize(
    "config",
    [
        {"seed": "../../x"},
        {"seed": "/x"},
        {"algo": ".."},
        {"algo": "/"},
        {"algo": "../x"},
        {"algo": "a" * 400},
        {"conf": "../../x"},
        {"params": {"..": "/x"}},
    ],
    ids=str,
)
def test_no_record_names_a_file_outside_the_page(run, tmp_path, config, no_page):
    new = make_run(tmp_path / "run", **config)
    before = set(tmp_path.rglob("*"))
    assert run("report", new, "--out", tmp_path / "deep" / "page")[1] == ""
    made = set(tmp_path.rglob("*")) - before
    page = tmp_path / "deep" / "page"
    assert made and all(path == page.parent or path == page or page in path.parents for path in made)
    assert len(list(page.glob("*/*/run.json"))) == 1


def test_what_a_record_says_breaks_neither_table_nor_figure(run, tmp_path):
    new = make_run(tmp_path / "run", algo="_x|y $x^{ <b>\nz", seed="1 | 2")
    printed, mistake = run("report", new)
    assert mistake == ""
    rows = [line for line in printed.splitlines() if line.startswith("|")]
    assert "_x\\|y $x^{ &lt;b&gt; z" in printed and len(rows) == 6
    assert (tmp_path / "results" / "learning_curves.png").stat().st_size > 10_000


def test_a_record_never_replaces_another_methods(run, tmp_path, no_page):
    assert run("report", make_run(tmp_path / "a", algo="x y"))[1] == ""
    mistake = run("report", make_run(tmp_path / "b", algo="x/y"))[1]
    assert "holds x y: give x/y an --out of its own" in mistake


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"config": {}, "versions": {}, "steps_to_90": {}}'])
def test_a_damaged_record_is_one_line(run, tmp_path, text, no_page):
    assert run("report", make_run(tmp_path / "a"))[1] == ""
    record = tmp_path / "results" / "bruno_sac" / "seed1" / "run.json"
    record.write_text(text)
    mistake = run("report")[1]
    assert str(record.parent.relative_to(tmp_path)) in mistake and "\n" not in mistake


def test_a_test_that_does_not_say_what_it_is_of_is_one_line(run, tmp_path):
    new = make_run(tmp_path / "a")
    kept = json.loads((new / "adaptation.json").read_text())
    (new / "adaptation.json").write_text(json.dumps({**kept, "config": {"algo": 3}}))
    mistake = run("report", new)[1]
    assert "algo=3, env=None, env_steps=None" in mistake and "\n" not in mistake

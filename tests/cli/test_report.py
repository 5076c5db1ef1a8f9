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


@pytest.mark.parametrize("table", ["learning_curve.csv", "episodes.csv", "rewards.csv"])
@pytest.mark.parametrize("text", ["", "task\n", "task,step\n1,2\n", "a,b\n1,2\n", "\0"])
def test_a_damaged_table_of_a_record_is_one_line(run, tmp_path, table, text, no_page):
    assert run("report", make_run(tmp_path / "a"))[1] == ""
    (tmp_path / "results" / "bruno_sac" / "seed1" / table).write_text(text)
    mistake = run("report")[1]
    assert "results/bruno_sac/seed1 holds no record of a run" in mistake and "\n" not in mistake


@pytest.mark.parametrize(
    "damage",
    [
        {"steps_to_90": {"1": "5", "2": 3}},
        {"steps_to_90": []},
        {"versions": {"commit": 3}},
        {"versions": None},
        {"config": []},
    ],
    ids=str,
)
def test_a_record_of_another_kind_is_one_line(run, tmp_path, damage, no_page):
    assert run("report", make_run(tmp_path / "a"))[1] == ""
    path = tmp_path / "results" / "bruno_sac" / "seed1" / "run.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **damage}))
    mistake = run("report")[1]
    assert "results/bruno_sac/seed1" in mistake and "\n" not in mistake


def test_a_test_that_was_cut_short_is_one_line(run, tmp_path):
    kept = make_run(tmp_path / "a") / "adaptation.json"
    whole = kept.read_text()
    for end in range(0, len(whole) - 2, 7):
        kept.write_text(whole[:end])
        mistake = run("report", kept.parent)[1]
        assert "adaptation.json' holds no AdaptationResult" in mistake and "\n" not in mistake


@pytest.mark.parametrize(
    "damage",
    [
        {"tasks": [["1"], ["2"]]},
        {"tasks": "x"},
        {"tasks": [[True], {}]},
        {"tasks": [[1.0], [None]]},
        {"rewards": [[["1"] * 10], [["1"] * 10]]},
        {"rewards": None},
        {"rewards": {"a": 1}},
        {"rewards": [[[1.0] * 10], [[1.0] * 9]]},
        {"seed": "x"},
        {"seed": None},
        {"versions": ["2.0"]},
        {"versions": {"torch": 2}},
        {"config": "x"},
        {"config": ["a"]},
        {"config": None},
    ],
    ids=str,
)
@pytest.mark.parametrize("given", ["folder", "file"])
def test_a_test_of_damaged_types_is_one_line(run, tmp_path, damage, given):
    kept = make_run(tmp_path / "a") / "adaptation.json"
    kept.write_text(json.dumps({**json.loads(kept.read_text()), **damage}))
    mistake = run("report", kept if given == "file" else kept.parent)[1]
    assert "adaptation.json' holds no AdaptationResult" in mistake and "\n" not in mistake
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize("missing", ["tasks", "rewards"])
def test_a_test_without_its_numbers_is_one_line(run, tmp_path, missing):
    kept = make_run(tmp_path / "a") / "adaptation.json"
    kept.write_text(json.dumps({key: value for key, value in json.loads(kept.read_text()).items() if key != missing}))
    mistake = run("report", kept.parent)[1]
    assert "adaptation.json' holds no AdaptationResult" in mistake and "\n" not in mistake


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("env_steps", "400"),
        ("env_steps", None),
        ("env_steps", True),
        ("env_steps", -1),
        ("env", ["x"]),
        ("conf", 3),
        ("deterministic", "yes"),
        ("inside_train_box", [True]),
        ("inside_train_box", "x"),
        ("inside_train_box", [1, 2]),
        ("n_inner_episodes", "2"),
        ("n_inner_episodes", 0),
        ("params", ["a"]),
        ("split", 3),
        ("trained_at", "abc"),
        ("trained_at", [3]),
        ("wall_seconds", "60"),
    ],
)
def test_settings_of_a_wrong_kind_are_one_line(run, tmp_path, name, value, no_page):
    kept = make_run(tmp_path / "a", **{name: value}) / "adaptation.json"
    for given in (kept, kept.parent):
        mistake = run("report", given)[1]
        assert f"the test's config has {name}={value!r}" in mistake and "\n" not in mistake


def test_a_test_that_does_not_say_what_it_is_of_is_one_line(run, tmp_path):
    new = make_run(tmp_path / "a")
    kept = json.loads((new / "adaptation.json").read_text())
    (new / "adaptation.json").write_text(json.dumps({**kept, "config": {"algo": 3}}))
    mistake = run("report", new)[1]
    assert "algo=3, env=None, env_steps=None" in mistake and "\n" not in mistake

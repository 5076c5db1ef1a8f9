"""The benchmarks run and write what they say; how fast anything is, is not tested."""

import json
import runpy
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def run(monkeypatch, capsys):
    """Run a script in this process, which has imported already what takes seconds; return what it prints."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))  # as Python does for a script

    def call(name, *arguments):
        monkeypatch.setattr(sys, "argv", [name, *arguments])
        runpy.run_path(str(BENCHMARKS / name), run_name="__main__")
        return capsys.readouterr().out

    return call


def test_speed_writes_a_table_and_its_rounds(run, tmp_path):
    run("speed.py", "--rounds", "2", "--only", "encoder_updates", "--out", str(tmp_path))
    measured = json.loads((tmp_path / "speed.json").read_text())
    encoder = [f"encoder update, 10 x 100, {which}" for which in ("the paper's", "the default")]
    assert [row["what"] for row in measured["rows"]] == encoder
    assert {len(rounds) for rounds in measured["seconds"]["encoder_updates"].values()} == {2}
    assert "| encoder update, 10 x 100, the default |" in (tmp_path / "speed.md").read_text()


def test_belief_sharpness_prints_shares_of_both_sets(run):
    short = ["--transitions", "2000", "--updates", "20", "--every", "10", "--flow", "reflected_maf"]
    last = run("belief_sharpness.py", *short).splitlines()[-1]
    trained_on, others = last.split("|")
    assert last.split()[0] == "20"
    assert all(0 <= float(share) <= 1 for share in (*trained_on.split()[2:], *others.split()))


def test_belief_choices_writes_a_row_for_every_choice(run, tmp_path):
    for more, n_runs, n_rows in (
        (["--families", "PointGoal-v0", "--seeds", "1"], 8, 1),
        (
            ["--families", "PointGoal-v0", "PointRotation-v0", "--choices", "kernel_student_t", "--seeds", "1", "2"],
            4,
            2,
        ),
    ):
        run("belief_choices.py", "--transitions", "1000", "--updates", "2", "--out", str(tmp_path), *more)
        assert len(json.loads((tmp_path / "belief_choices.json").read_text())["runs"]) == n_runs
        assert (tmp_path / "belief_choices.md").read_text().count("| kernel_student_t |") == n_rows


def test_belief_quality_compares_encoders_and_keeps_its_runs(run, tmp_path):
    short = ["--families", "PointDir-v0", "--encoders", "bruno", "random_features", "--seeds", "1", "2"]
    command = [*short, "--updates", "20", "--episodes", "40", "--out", str(tmp_path)]
    run("belief_quality.py", *command)
    by_seed, untrained = json.loads((tmp_path / "belief_quality.json").read_text())["runs"].values()
    assert all(row["ms per update"] == 0 for row in untrained.values())
    for row in by_seed.values():
        assert abs(row["after 0"]) < 0.05 < row["after 100"] <= 1
        assert row["after 100, shuffled"] == pytest.approx(row["after 100"], abs=0.01)  # whatever their order
    assert "seed" not in run("belief_quality.py", *command)
    assert (tmp_path / "belief_quality.png").exists() and "| PointDir-v0 | bruno |" in (
        tmp_path / "belief_quality.md"
    ).read_text()


def test_untuned_keeps_its_runs_and_takes_none_of_another_length(run, tmp_path):
    command = ["--seeds", "1", "--families", "PointRotation-v0", "--agents", "BrunoSAC", "--out", str(tmp_path / "new")]
    first = run("untuned.py", *command, "--steps", "808")
    assert "seed 1" in first and "seed 1" not in run("untuned.py", *command, "--steps", "808")
    (by_seed,) = json.loads((tmp_path / "new" / "untuned.json").read_text())["runs"].values()
    assert by_seed.keys() == {"1"} and by_seed["1"].keys() == {
        "return",
        "last reward",
        "steps",
        "explained of unseen tasks",
    }
    with pytest.raises(ValueError, match="has steps=808, not 816"):
        run("untuned.py", *command, "--steps", "816")


def test_hidden_angle_keeps_its_runs(run, tmp_path):
    command = ["--agents", "SAC", "--seeds", "1", "--steps", "820", "--out", str(tmp_path)]
    run("hidden_angle.py", *command)
    kept = json.loads((tmp_path / "hidden_angle.json").read_text())
    assert kept["runs"]["SAC"]["1"]["return"] < 0 and kept["commits"]["SAC"].keys() == {"1"}
    assert "seed" not in run("hidden_angle.py", *command).split("|")[0]


def test_task_matters_compares_an_agent_that_is_told_with_one_that_is_not(run, tmp_path):
    run("task_matters.py", "--families", "PointDir-v0", "--divide-steps", "10", "--out", str(tmp_path))
    kept = json.loads((tmp_path / "task_matters.json").read_text())["runs"]
    told, not_told = (kept[f"PointDir-v0 / {agent}"]["1"]["return"] for agent in ("oracle", "markov"))
    assert told > 5 > not_told and kept["PointDir-v0 / standing still"]["0"]["return"] == 0
    assert "| PointDir-v0 | 0.0 | " in (tmp_path / "task_matters.md").read_text()


def test_encoders_in_rl_trains_every_kind_of_agent(run, tmp_path):
    agents = ["oracle", "Markov", "mean_embedding", "product_of_gaussians"]
    family = "PointGoal-v0, dim=2"
    short = ["--families", family, "--seeds", "1", "--agents", *agents, "--divide-steps", "20", "--out", str(tmp_path)]
    run("encoders_in_rl.py", *short)
    kept = json.loads((tmp_path / "encoders_in_rl.json").read_text())["runs"]
    assert list(kept) == [f"{family} / {agent}" for agent in agents]
    assert all(-500 < kept[name]["1"]["return"] < kept[name]["1"]["last reward"] < 0 for name in kept)
    assert f"| {family} | mean_embedding | " in (tmp_path / "encoders_in_rl.md").read_text()


@pytest.mark.parametrize(
    ("still", "markov", "oracle", "told"),
    [
        (0, 3, 28, "| 0.11 |  |"),
        (-47, -53, -2, "| -0.13 |  |"),
        (0, 660, 630, "| 1.05 | hides nothing |"),
        (202, 204, 203, "|  | the oracle has learned nothing |"),
        (202, 150, 100, "|  | the oracle has learned nothing |"),
    ],
)
def test_task_matters_says_nothing_of_a_task_that_no_agent_has_learned(monkeypatch, still, markov, oracle, told):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import task_matters

    returns = {"standing still": still, "at random": -60, "markov": markov, "oracle": oracle}
    rows = {f"X-v0 / {agent}": {"1": {"return": earned}} for agent, earned in returns.items()}
    assert task_matters.table(rows)[-1].endswith(told)


def test_speed_is_measured_in_other_processes_and_beside_a_limit(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from speed_sections.limit import matrix_products
    from speed_sections.race import race, row, table

    seconds = race({"ours": lambda: 4.0, "elsewhere": lambda: 2.0, "products": matrix_products(8, width=16)}, 3, 2)
    assert seconds["ours"] == [4.0] * 3 and len(seconds["products"]) == 3
    entry = row("train", seconds, "ours", "elsewhere", "<= 1", units=8, limit="elsewhere")
    assert entry[1:4] == (2.0, "elsewhere", 2.0) and entry.share == 0.5
    assert "| train | 2 | elsewhere | 2.00 (2.00 to 2.00) | 0.50 | <= 1 |" in table([entry])


def test_a_rival_in_an_environment_of_its_own_tells_its_seconds(monkeypatch, tmp_path, capsys):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from speed_sections.rivals import sbx_training

    (tmp_path / "sbx.py").write_text(
        "class SAC:\n"
        "    def __init__(self, *args, **kwargs): pass\n"
        "    def learn(self, n): self.n = n\n"
        "    def train(self, steps, batch): assert (self.n, steps, batch) == (4_000, 5, 128)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with sbx_training(sys.executable, 5, 128) as train:
        assert 0 <= train() < 1
    with sbx_training(None, 5, 128) as train:
        assert train is None and "--sbx" in capsys.readouterr().out

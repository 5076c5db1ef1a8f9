"""What is read from diagnostics: exact numbers, independent computations, round trips."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest

from sb3_bruno.diagnostics.result import Diagnostics

NAN = np.nan


def diagnostics_of(seed: int = 0, n_outside: int = 2, **changes: Any) -> Diagnostics:
    """Three tasks, four episodes of six steps, two quantities. One episode ends after two steps."""
    rng = np.random.default_rng(seed)
    pit, log_scores, beliefs = rng.random((3, 4, 6, 2)), rng.normal(size=(3, 4, 6)), rng.normal(size=(3, 4, 7, 2))
    pit[1, 2, 2:] = log_scores[1, 2, 2:] = beliefs[1, 2, 3:] = NAN
    found = Diagnostics(
        tasks=rng.normal(size=(3, 1)),
        quantities=np.array(["reward", "change of observation 0"]),
        pit=pit,
        distance_levels=rng.random((3, 4, 3)),
        log_scores=log_scores,
        beliefs=beliefs,
        explained=np.array([0.7, 0.2]),
        real=rng.normal(size=(3, 6)).astype(np.float32),
        predicted=np.sort(rng.normal(size=(3, 3, 6)), axis=0)[[1, 0, 2]],
        outside_tasks=rng.normal(size=(n_outside, 1)) if n_outside else None,
        outside_log_scores=rng.normal(size=(n_outside, 4, 9)) if n_outside else None,
    )
    return replace(found, **changes)


def test_distances_from_uniform_are_scipys_without_the_steps_that_were_not() -> None:
    found = diagnostics_of()
    for i, distance in enumerate(found.pit_ks()):
        values = np.concatenate(
            [found.pit[t, e, : 2 if (t, e) == (1, 2) else 6, i] for t in range(3) for e in range(4)]
        )
        assert len(values) == 12 * 6 - 4
        assert distance == pytest.approx(kstest(values, "uniform").statistic)
    always_half = replace(found, pit=np.full((1, 1, 5, 1), 0.5), distance_levels=np.full((1, 3, 1), 1.0))
    assert always_half.pit_ks().tolist() == [0.5]
    assert always_half.distance_ks().tolist() == [1.0]


def test_coverage_counts_what_lies_in_the_central_interval() -> None:
    pit = np.array([[0.01, 0.3], [0.26, NAN], [0.74, 0.5], [0.96, NAN]]).reshape(1, 1, 4, 2)
    found = diagnostics_of(pit=pit)
    np.testing.assert_array_equal(found.coverage(0.5), [0.5, 1.0])
    np.testing.assert_array_equal(found.coverage(0.9), [0.5, 1.0])
    np.testing.assert_array_equal(found.coverage(0.95), [0.75, 1.0])


def test_auroc_is_the_share_of_pairs_in_the_right_order() -> None:
    found = diagnostics_of()
    inside, outside = found.scores(), found.outside_scores()
    assert inside[1, 2] == pytest.approx(-found.log_scores[1, 2, :2].mean())  # of the steps that were
    pairs = outside.ravel()[:, None] - inside.ravel()[None]
    assert found.auroc() == pytest.approx((pairs > 0).mean())
    assert found.outside_log_scores is not None
    assert replace(found, outside_log_scores=found.outside_log_scores - 100).auroc() == 1.0
    tied = replace(found, log_scores=np.zeros((1, 2, 3)), outside_log_scores=np.zeros((1, 2, 3)))
    assert tied.auroc() == 0.5


def test_numbers_are_flat_and_tell_the_worst() -> None:
    log_scores = np.array([[[1.0, 2.0, 4.0, 6.0], [3.0, 2.0, 5.0, NAN]]])
    found = diagnostics_of(log_scores=log_scores)
    numbers = found.numbers()
    assert all(type(value) is float for value in numbers.values())
    assert numbers["pit_ks_worst"] == found.pit_ks().max() > numbers["pit_ks"] == pytest.approx(found.pit_ks().mean())
    assert numbers["distance_ks_worst"] == found.distance_ks().max() > numbers["distance_ks"]
    assert numbers["log_score"] == pytest.approx(23 / 7)
    assert (numbers["log_score_first_step"], numbers["log_score_second_half"]) == (2.0, 5.0)
    assert numbers["auroc"] == found.auroc()
    assert "auroc" not in diagnostics_of(n_outside=0).numbers()


def test_summary_shows_each_quantity() -> None:
    found = diagnostics_of()
    lines = found.summary().splitlines()
    assert lines[0] == "3 tasks, 4 episodes each, up to 6 steps"
    assert [line[:23].strip() for line in lines[1:4]] == ["quantity", "reward", "change of observation 0"]
    assert lines[2].split()[1] == f"{found.pit_ks()[0]:.3f}"
    assert len({len(line) for line in lines[1:4]}) == 1
    assert lines[-2] == f"outside tasks: 2, told from these with AUROC {found.auroc():.3f}"
    assert lines[-1].startswith("Verdict: intervals right")
    assert "AUROC" not in diagnostics_of(n_outside=0).summary()


@pytest.mark.parametrize("n_outside", [0, 2])
def test_save_and_load_keep_every_bit(tmp_path: Path, n_outside: int) -> None:
    found = diagnostics_of(n_outside=n_outside)
    found.save(tmp_path / "any.name")
    loaded = Diagnostics.load(tmp_path / "any.name")
    for field in fields(Diagnostics):
        stored, read = getattr(found, field.name), getattr(loaded, field.name)
        if stored is None:
            assert read is None
        else:
            np.testing.assert_array_equal(read, stored, strict=True)
    assert loaded.numbers() == found.numbers()


def test_load_refuses_other_files(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("no arrays")
    np.savez(tmp_path / "other.npz", something=np.zeros(3))
    for name in ("text", "other.npz", "missing"):
        with pytest.raises(ValueError, match=rf"{name}' holds no Diagnostics: give a file that save\(\) wrote"):
            Diagnostics.load(tmp_path / name)


def test_errors_name_the_argument_and_the_remedy() -> None:
    with pytest.raises(ValueError, match=r"level=1\.5 is not between 0 and 1: give the interval's probability"):
        diagnostics_of().coverage(1.5)
    with pytest.raises(ValueError, match=r"outside_log_scores is None, .*: pass outside_tasks to diagnose"):
        diagnostics_of(n_outside=0).auroc()
    for name in ("pit", "log_scores"):
        with pytest.raises(ValueError, match=f"{name} holds nothing but NaN: diagnose episodes of one step at least"):
            diagnostics_of(**{name: np.full((3, 4, 6, *([2] if name == "pit" else [])), NAN)})
    with pytest.raises(ValueError, match="outside_tasks is None while the other is not: give both or neither"):
        diagnostics_of(outside_tasks=None)

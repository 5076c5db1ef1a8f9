"""What is read from recorded rewards: exact numbers, independent computations, round trips."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import trim_mean

from sb3_bruno.evaluation.adaptation_result import AdaptationResult

NAN = np.nan


def result_of(*curves: list[float], **kwargs: Any) -> AdaptationResult:
    """Make a result with one task and one episode for each curve."""
    return AdaptationResult(np.arange(len(curves))[:, None], np.array(curves)[:, None], **kwargs)


@pytest.fixture
def result() -> AdaptationResult:
    """Two tasks, two episodes of each, four steps; one episode ends after two steps."""
    rewards = [[[1, 2, 3, 4], [3, 4, NAN, NAN]], [[-1, -1, -1, -1], [-3, -1, -1, -1]]]
    return AdaptationResult(np.array([[1.0, 0.0], [0.0, 1.0]]), np.array(rewards))


def test_returns_of_every_horizon(result: AdaptationResult) -> None:
    assert result.horizon == 4
    np.testing.assert_array_equal(result.returns(), [[10, 7], [-4, -6]])
    np.testing.assert_array_equal(result.returns(1), [[1, 3], [-1, -3]])
    np.testing.assert_array_equal(result.mean_return(3), [6.5, -4])


def test_returns_of_the_episodes_of_trials() -> None:
    rewards = np.arange(24).reshape(2, 2, 6)  # two tasks, two trials, six steps
    result = AdaptationResult(np.zeros((2, 1)), rewards)
    thirds = [[[1, 5, 9], [13, 17, 21]], [[25, 29, 33], [37, 41, 45]]]
    np.testing.assert_array_equal(result.returns_per_episode(3), thirds)
    np.testing.assert_array_equal(result.returns_per_episode(1)[..., 0], result.returns())
    np.testing.assert_array_equal(result.returns_per_episode(6), rewards)


@pytest.mark.parametrize("n_episodes", [0, -1, 3])
def test_trials_that_cannot_be_cut_evenly_are_refused(n_episodes: int) -> None:
    with pytest.raises(ValueError, match=rf"n_episodes={n_episodes} does not cut 4 steps evenly"):
        result_of([1, 2, 3, 4]).returns_per_episode(n_episodes)


def test_trials_that_ended_early_are_not_cut(result: AdaptationResult) -> None:
    with pytest.raises(ValueError, match="n_episodes=2 cannot cut trials that ended early: give them a time limit"):
        result.returns_per_episode(2)


def test_mean_rewards_average_the_episodes_that_run(result: AdaptationResult) -> None:
    np.testing.assert_array_equal(result.mean_rewards(), [[2, 3, 3, 4], [-2, -1, -1, -1]])
    np.testing.assert_array_equal(result_of([1, NAN], [1, 2]).mean_rewards(), [[1, NAN], [1, 2]])


@pytest.mark.parametrize("horizon", [0, -1, 5])
def test_a_horizon_outside_the_record_is_refused(result: AdaptationResult, horizon: int) -> None:
    with pytest.raises(ValueError, match=rf"horizon={horizon} is outside 1 \.\. 4"):
        result.returns(horizon)


@pytest.mark.parametrize(
    ("curve", "window", "steps"),
    [
        ([-4, -4, -1, -1, -1, -1], 1, 2),  # the docstring's example
        ([0, 5, 10, 10, 10, 10], 1, 2),
        ([0, 9, 10, 10], 1, 1),  # exactly 90 %
        ([0, 8, 9, 10, 10, 10, 10, 10], 1, 2),
        ([-4, -5, -8, -8, -8, -8], 1, 2),  # the way down: 90 % is at -7.6
        ([0, 0, 3, -2, 3, 1, 3, 1], 1, 2),  # a single high reward passes for the arrival ...
        ([0, 0, 3, -2, 3, 1, 3, 1], 2, 4),  # ... unless smoothed: 0 1.5 .5 .5 2 2 2 1, and 90 % is at 1.8
        ([3, 3, 3], 5, 0),
        ([7], 5, 0),
        ([0, 5, 10, 10, 10, 10, NAN, NAN], 1, 2),  # what was never run does not count
    ],
)
def test_steps_to_steady(curve: list[float], window: int, steps: int) -> None:
    np.testing.assert_array_equal(result_of(curve).steps_to_steady(window=window), [steps])


def test_steps_to_steady_reads_its_fraction() -> None:
    result = result_of([0, 2, 4, 6, 8, 10, 10, 10, 10, 10], [0, 0, 0, 0, 1, 1, 1, 1, 1, 1])
    for fraction, steps in [(0.15, [1, 4]), (0.5, [3, 4]), (0.79, [4, 4]), (0.99, [5, 4])]:
        np.testing.assert_array_equal(result.steps_to_steady(fraction, window=1), steps)


def test_steps_to_steady_refuses_what_makes_no_sense(result: AdaptationResult) -> None:
    with pytest.raises(ValueError, match=r"fraction=1\.0 is not between 0 and 1"):
        result.steps_to_steady(1.0)
    with pytest.raises(ValueError, match="window=0 is not positive"):
        result.steps_to_steady(window=0)


@pytest.mark.parametrize("n_episodes", [1, 2, 5, 10])
def test_interquartile_mean_is_scipys(n_episodes: int) -> None:
    rewards = np.random.default_rng(0).normal(size=(3, n_episodes, 4))
    result = AdaptationResult(np.zeros((3, 1)), rewards)
    estimate = result.iqm()
    np.testing.assert_allclose(estimate.value, trim_mean(result.returns(), 0.25, axis=None), rtol=1e-12)
    assert estimate.low <= estimate.value <= estimate.high


def test_interval_is_seeded_and_leaves_numpys_state_alone() -> None:
    result = AdaptationResult(np.zeros((2, 1)), np.random.default_rng(0).normal(size=(2, 10, 3)))
    before = np.random.get_state()[1].copy()  # noqa: NPY002  the global state is what is tested
    first = result.iqm()
    np.testing.assert_array_equal(before, np.random.get_state()[1])  # noqa: NPY002
    assert first == result.iqm()
    assert first.low != result.iqm(seed=1).low


def test_interval_is_stratified_by_task() -> None:
    """If the episodes of each task agree, resampling changes nothing, however far apart the tasks are."""
    result = AdaptationResult(np.zeros((2, 1)), np.array([[[1.0]] * 4, [[100.0]] * 4]))
    assert result.iqm() == (50.5, 50.5, 50.5)


def test_summary_shows_each_task_and_its_lowest_episode(result: AdaptationResult) -> None:
    lines = result.summary().splitlines()
    assert lines[0] == "Returns over 4 steps: 2 tasks, 2 episodes each"
    assert lines[1].split() == ["task", "mean", "lowest", "highest", "steps", "to", "90", "%"]
    assert lines[2].split()[:4] == ["1_0", "8.50", "7.00", "10.00"]
    assert lines[3].split()[:4] == ["0_1", "-5.00", "-6.00", "-4.00"]
    assert lines[4].split()[:4] == ["all", "1.75", "-6.00", "10.00"]
    assert lines[5].startswith("interquartile mean 1.50, 95 % interval ")
    assert len({len(line) for line in lines[1:5]}) == 1
    assert "over 2 steps" in result.summary(2)


def test_save_and_load_keep_every_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rewards = (rng.normal(size=(3, 4, 50)) * 10.0 ** rng.integers(-30, 30, size=(3, 4, 50))).astype(np.float32)
    rewards[1, 2, 20:] = NAN
    saved = AdaptationResult(
        rng.normal(size=(3, 2)),
        rewards,
        {"env": "X-v0", "sizes": (1, 2)},
        7,
        {"python": "3.11", "commit": "abc"},
    )
    saved.save(tmp_path / "result.json")
    loaded = AdaptationResult.load(tmp_path / "result.json")
    np.testing.assert_array_equal(loaded.tasks, saved.tasks, strict=True)
    np.testing.assert_array_equal(loaded.rewards, saved.rewards, strict=True)
    assert (loaded.config, loaded.seed, loaded.versions) == (saved.config, saved.seed, saved.versions)
    assert loaded.config["sizes"] == [1, 2]
    assert "NaN" not in (tmp_path / "result.json").read_text()


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"tasks": [[0]], "rewards": [[[1]]], "unknown": 1}'])
def test_load_refuses_other_files(tmp_path: Path, text: str) -> None:
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"other\.json' holds no AdaptationResult"):
        AdaptationResult.load(path)


@pytest.mark.parametrize(
    ("tasks", "rewards"), [((2,), (2, 1, 1)), ((2, 1), (2, 1)), ((2, 1), (3, 1, 1)), ((2, 1), (2, 0, 1))]
)
def test_shapes_are_checked(tasks: tuple[int, ...], rewards: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"tasks have shape .* and rewards .*: give \(n_tasks, task_dim\)"):
        AdaptationResult(np.zeros(tasks), np.zeros(rewards))


@pytest.mark.parametrize("curve", [[NAN, NAN], [1, NAN, 1], [1, np.inf]])
def test_rewards_are_checked(curve: list[float]) -> None:
    with pytest.raises(ValueError, match="rewards must be finite, and NaN only after"):
        result_of(curve)


@pytest.mark.parametrize("value", [NAN, object(), {1, 2}])
def test_config_is_checked(value: object) -> None:
    with pytest.raises(ValueError, match=r"config=.* is not JSON .*: keep strings"):
        result_of([1.0], config={"key": value})


def test_names_and_successes_are_shown_and_kept(tmp_path) -> None:
    successes = np.array([[0.75, 0.25], [np.nan, np.nan]])  # an environment may tell the share that it calls done
    rewards = np.ones((2, 2, 3))
    result = AdaptationResult([[1.0], [2.0]], rewards, names=["slow", "fast"], successes=successes)
    result.save(tmp_path / "result.json")
    read = AdaptationResult.load(tmp_path / "result.json")
    assert read.labels == ["slow", "fast"] and AdaptationResult([[1.0], [2.0]], rewards).labels == ["1", "2"]
    np.testing.assert_array_equal(read.successes, successes)
    np.testing.assert_array_equal(read.success_rates(), [0.5, np.nan])
    assert read.success_rate() == 0.5
    lines = read.summary().splitlines()
    assert lines[1].endswith("success") and lines[2].startswith("slow") and lines[2].endswith("50 %")
    with pytest.raises(ValueError, match="is_success"):
        AdaptationResult([[1.0]], np.ones((1, 1, 3))).success_rate()


@pytest.mark.parametrize(
    ("bad", "named"),
    [
        ({"names": ["slow"]}, "names has 1 entries for 2 tasks"),
        ({"successes": np.ones((2, 1))}, "successes of shape"),
        ({"successes": np.full((2, 2), 1.5)}, "give 0 to 1, or NaN"),
        ({"successes": np.full((2, 2), -1.0)}, "give 0 to 1, or NaN"),
    ],
)
def test_names_and_successes_that_do_not_fit_are_refused(bad, named) -> None:
    with pytest.raises(ValueError, match=named):
        AdaptationResult([[1.0], [2.0]], np.ones((2, 2, 3)), **bad)

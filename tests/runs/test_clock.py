"""The clock of a run counts the steps of all its environments and the seconds of all its parts."""

from pathlib import Path

import numpy as np
import pytest

from sb3_bruno.runs.clock import TrainingClock


def write_monitors(folder: Path, clock: list[float], n_envs: int = 2) -> Path:
    rows = [f"1.0,200,{seconds}" for seconds in clock]
    for env in range(n_envs):
        (folder / f"{env}.monitor.csv").write_text("\n".join(['#{"t_start": 0.0}', "r,l,t", *rows]) + "\n")
    return folder


@pytest.mark.parametrize(
    ("clock", "seconds"),
    [
        ([3.0, 7.5, 9.0], [3.0, 7.5, 9.0]),
        ([3.0, 7.5, 2.0, 4.0], [3.0, 7.5, 9.5, 11.5]),
        ([3.0, 2.0, 1.0, 4.0], [3.0, 5.0, 6.0, 9.0]),
    ],
    ids=["whole", "resumed", "resumed twice"],
)
def test_the_seconds_of_the_parts_of_a_resumed_run_add_up(tmp_path, clock, seconds):
    found = TrainingClock.of_run(write_monitors(tmp_path, clock))
    np.testing.assert_allclose(found.seconds, seconds)
    assert found.env_steps.tolist() == [400 * (1 + episode) for episode in range(len(clock))]


def test_between_episodes_time_is_interpolated(tmp_path):
    clock = TrainingClock.of_run(write_monitors(tmp_path, [3.0, 7.0]))
    np.testing.assert_allclose(clock.at(np.arange(0, 801, 200)), [0.0, 1.5, 3.0, 5.0, 7.0])


def test_without_an_episode_there_is_no_clock(tmp_path):
    assert TrainingClock.of_run(tmp_path) is None
    assert TrainingClock.of_run(write_monitors(tmp_path, [])) is None


@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: "",
        lambda whole: whole.splitlines()[0],
        lambda whole: whole.rstrip().rpartition(",")[0],
        lambda whole: whole + 40 * "\0",
        lambda whole: whole.replace("r,l,t", "a,b,c"),
        lambda whole: whole.replace("7.0", "x"),
    ],
    ids=["empty", "no names", "a torn row", "zeros, as after a power failure", "other names", "no number"],
)
def test_a_damaged_monitor_file_is_no_clock(tmp_path, damage):
    path = write_monitors(tmp_path, [3.0, 7.0]) / "0.monitor.csv"
    path.write_text(damage(path.read_text()))
    with pytest.warns(UserWarning, match=r"0.monitor.csv cannot be read .* how long the run trained"):
        assert TrainingClock.of_run(tmp_path) is None

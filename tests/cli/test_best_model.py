"""The best model of a run is tested and watched with the statistics that it was the best with."""

import shutil

import pytest
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.cli.main import main
from sb3_bruno.export import written_agent
from sb3_bruno.zoo import shown_steps
from support.tiny_runs import tiny

COMMANDS = [
    ["evaluate", "--episodes", 1, "--steps", 2],
    ["enjoy", "--no-render", "-n", 3],
    ["record-video", "-n", 3],
]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A folder with a run whose observations are normalised, and whose best model is of the middle."""
    folder = tmp_path_factory.mktemp("best")
    main([*map(str, tiny("--eval-freq", 160, "-f", folder / "logs", steps=200)), "normalize:True"])
    return folder


@pytest.fixture
def kept(trained, tmp_path):
    """A copy of that run."""
    shutil.copytree(trained / "logs", tmp_path / "logs")
    return tmp_path / "logs" / "bruno_sac" / "PointDir-v0_1"


def forget_agent_files(run_folder):
    """Be a run of an earlier version, which wrote none."""
    for path in run_folder.glob("*.agent"):
        path.unlink()


@pytest.fixture
def counts(monkeypatch):
    """How many observations the statistics that are loaded have seen, from pickles and from agent files."""
    loaded = {"pickle": [], "agent file": []}

    def listed(load, kind):
        def load_and_list(*args):
            statistics = load(*args)
            loaded[kind].append(round(statistics.obs_rms["reward"].count))
            return statistics

        return load_and_list

    monkeypatch.setattr(VecNormalize, "load", staticmethod(listed(VecNormalize.load, "pickle")))
    monkeypatch.setattr(written_agent, "normalized", listed(written_agent.normalized, "agent file"))
    return loaded


@pytest.mark.parametrize("kind", ["pickle", "agent file"])
@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command[0])
def test_the_statistics_are_those_of_the_model(run, kept, counts, command, kind):
    if kind == "pickle":
        forget_agent_files(kept)
    for flags, n_seen in (([], 208), (["--load-best"], 168)):
        assert run(*command, "--env", "PointDir-v0", *flags)[1] == ""
        assert {name: set(seen) for name, seen in counts.items()} == {
            "pickle": set(),
            "agent file": set(),
            kind: {n_seen},
        }
        counts[kind].clear()


@pytest.mark.parametrize("command", COMMANDS[:2], ids=lambda command: command[0])
def test_a_run_of_an_earlier_version_is_told_that_it_kept_none(run, kept, counts, command):
    forget_agent_files(kept)
    shutil.rmtree(kept / "best_model")
    with pytest.warns(UserWarning, match="PointDir-v0_1 kept no statistics of VecNormalize with its best model"):
        assert run(*command, "--env", "PointDir-v0", "--load-best")[1] == ""
    assert counts == {"pickle": [208], "agent file": []}


def test_a_video_in_the_making_shows_how_far_it_is(run, kept, monkeypatch):
    bars = []

    class Bar:
        def __init__(self, **kwargs):
            bars.append(self)
            self.kwargs, self.n, self.is_closed = kwargs, 0, False

        def update(self):
            self.n += 1

        def close(self):
            self.is_closed = True

    monkeypatch.setattr(shown_steps, "progress", Bar)
    assert run("record-video", "--env", "PointDir-v0", "-n", "1e1")[1] == ""
    (bar,) = bars
    assert bar.kwargs == {"shown": True, "total": 10, "about": "steps"} and bar.n == 10 and bar.is_closed

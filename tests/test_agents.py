"""The trained agents that come with the repository load, and still run as they did when they were tested."""

from pathlib import Path

import pytest

from sb3_bruno.cli.main import main
from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.export.shared import check_names

ROOT = Path(__file__).parents[1]
AGENTS = ROOT / "agents"
LEAST = {"bruno_sac/CheetahDir-v0_1": 1_000, "bruno_sac/CheetahVel-v0_1": -70}
"""The least mean return that each agent must reach on each of its tasks, over the env's own horizon."""
RECORDS = {
    "bruno_sac/CheetahDir-v0_1": "docs/results/cheetah_dir/bruno_sac/seed3",
    "bruno_sac/CheetahVel-v0_1": "docs/results/cheetah_vel/bruno_sac/seed1",
}
"""The record of each agent, from which its card is written."""


def chosen(agent):
    """The flags that choose an agent, without its folder."""
    algo, run = agent.split("/")
    env, number = run.rsplit("_", 1)
    return ["--algo", algo, "--env", env, "--exp-id", number]


def test_every_agent_is_tested():
    assert {str(path.parent.relative_to(AGENTS)) for path in AGENTS.glob("*/*/*.agent")} == set(LEAST) == set(RECORDS)


@pytest.mark.parametrize("agent", LEAST)
def test_an_agent_comes_without_pickles_and_with_its_card(agent):
    files = [path.relative_to(AGENTS / agent).as_posix() for path in (AGENTS / agent).rglob("*") if path.is_file()]
    assert check_names(files, agent) == agent.split("/")[1].rsplit("_", 1)[0]


@pytest.mark.mujoco
@pytest.mark.parametrize("agent", LEAST)
def test_its_card_is_what_pack_writes(agent, tmp_path):
    main(["pack", *chosen(agent), "-f", str(AGENTS), "--record", str(ROOT / RECORDS[agent]), "--out", str(tmp_path)])
    packed = tmp_path / agent
    for name in ("README.md", "adaptation.png"):
        assert (packed / name).read_bytes() == (AGENTS / agent / name).read_bytes()


@pytest.mark.mujoco
@pytest.mark.parametrize("agent", LEAST)
def test_an_agent_still_adapts(agent, tmp_path, capsys):
    flags = [*chosen(agent), "-f", str(AGENTS)]
    main(["evaluate", *flags, "--episodes", "2", "--seed", "7", "--out", str(tmp_path)])
    result = AdaptationResult.load(tmp_path / "adaptation.json")
    assert (result.returns(result.horizon).mean(axis=1) > LEAST[agent]).all()
    main(["enjoy", *flags, "--no-render", "-n", "200"])
    assert "Mean reward" in capsys.readouterr().out

"""The trained agents that come with the repository load, and still run as they did when they were tested."""

from pathlib import Path

import pytest

from sb3_bruno.cli.main import main
from sb3_bruno.evaluation.adaptation_result import AdaptationResult

AGENTS = Path(__file__).parents[1] / "agents"
LEAST = {"bruno_sac/CheetahDir-v0_1": 1_000, "bruno_sac/CheetahVel-v0_1": -70}
"""The least mean return that each agent must reach on each of its tasks, over the env's own horizon."""


def test_every_agent_is_tested():
    assert {str(path.parent.relative_to(AGENTS)) for path in AGENTS.glob("*/*/*.zip")} == set(LEAST)


@pytest.mark.mujoco
@pytest.mark.parametrize("agent", LEAST)
def test_an_agent_still_adapts(agent, tmp_path, capsys):
    algo, run = agent.split("/")
    env, number = run.rsplit("_", 1)
    chosen = ["--algo", algo, "--env", env, "-f", str(AGENTS), "--exp-id", number]
    tested = ["--episodes", "2", "--seed", "7", "--out", str(tmp_path)]
    main(["evaluate", *chosen, *tested])
    result = AdaptationResult.load(tmp_path / "adaptation.json")
    assert (result.returns(result.horizon).mean(axis=1) > LEAST[agent]).all()
    main(["enjoy", *chosen, "--no-render", "-n", "200"])
    assert "Mean reward" in capsys.readouterr().out

"""The trained agents that come with the repository load, and still act as they did when they were tested."""

from pathlib import Path
from typing import NamedTuple

import pytest

from sb3_bruno.cli.main import main
from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.export.shared import check_names

ROOT = Path(__file__).parents[1]
AGENTS = ROOT / "agents" / "bruno_sac"


class Shipped(NamedTuple):
    """What an agent must still be able to do.

    Attributes:
        n_steps: how many are tried, from the start of an episode; None for all of them.
        least: what they return at least, in the mean over the test tasks.
        record: of the run, from which its card is written; None for that of its family's page of agents.
    """

    n_steps: int | None
    least: float
    record: str | None = None


SHIPPED = {
    "AntDir-v0": Shipped(50, 40),
    "AntDir2D-v0": Shipped(50, 30, "agents/ant_dir2d/bruno_sac/seed1"),
    "AntGoal-v0": Shipped(50, -140),
    "CartpoleSwingUp-v0": Shipped(100, 15),
    "CheetahDir-v0": Shipped(None, 1_000, "cheetah_dir/bruno_sac/seed3"),
    "CheetahGravity-v0": Shipped(50, 85),
    "CheetahParams-v0": Shipped(50, 50),
    "CheetahVel-v0": Shipped(None, -25, "cheetah_vel/bruno_sac/seed1"),
    "HopperParams-v0": Shipped(50, 75),
    "HumanoidDir-v0": Shipped(50, 190),
    "PointDir-v0": Shipped(None, 25),
    "PointGoal-v0": Shipped(None, -9),
    "PointRotation-v0": Shipped(None, -4),
    "SparsePointGoal-v0": Shipped(None, 28),
    "WalkerParams-v0": Shipped(50, 45),
    "Wind-v0": Shipped(None, 50),
}


def flags(env):
    return ["--algo", "bruno_sac", "--env", env, "-f", str(AGENTS.parent)]


def test_every_agent_is_tested():
    assert {path.name for path in AGENTS.iterdir()} == {f"{env}_1" for env in SHIPPED}


@pytest.mark.parametrize("env", SHIPPED)
def test_an_agent_comes_without_pickles_and_with_its_card(env):
    folder = AGENTS / f"{env}_1"
    assert check_names([str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()], env) == env


@pytest.mark.mujoco
@pytest.mark.parametrize("env", SHIPPED)
def test_its_card_is_what_pack_writes(env, tmp_path):
    page = "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in env.removesuffix("-v0"))
    record = ROOT / "docs" / "results" / (SHIPPED[env].record or f"agents/{page.lstrip('_')}/bruno_sac/seed1")
    main(["pack", *flags(env), "--record", str(record), "--out", str(tmp_path)])
    for name in ("README.md", "adaptation.png"):
        assert (tmp_path / "bruno_sac" / f"{env}_1" / name).read_bytes() == (AGENTS / f"{env}_1" / name).read_bytes()


@pytest.mark.mujoco
@pytest.mark.parametrize("env", SHIPPED)
def test_an_agent_still_adapts(env, tmp_path):
    n_steps = SHIPPED[env].n_steps
    steps = [] if n_steps is None else ["--steps", str(n_steps)]
    main(["evaluate", *flags(env), "--episodes", "1", *steps, "--seed", "7", "--out", str(tmp_path)])
    result = AdaptationResult.load(tmp_path / "adaptation.json")
    assert result.returns(result.horizon).mean() > SHIPPED[env].least


@pytest.mark.mujoco
def test_an_agent_is_watched(capsys):
    main(["enjoy", *flags("CheetahDir-v0"), "--no-render", "-n", "200"])
    assert "Mean reward" in capsys.readouterr().out

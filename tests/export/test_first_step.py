"""An agent whose first reading of the task is not finite is not loaded, though all its weights are finite."""

import pytest
import torch as th

from sb3_bruno import PearlSAC
from sb3_bruno.export import agent_file, load_agent, save_agent
from support.tiny_models import POINT, tiny


@pytest.fixture(scope="module")
def agents():
    """An agent that tells a density over tasks, and one that tells how probable each of a few is."""
    return {env: PearlSAC("MlpPolicy", env, **tiny(PearlSAC)) for env in ("sb3_bruno_envs:PointGoal-v0", POINT)}


@pytest.mark.parametrize(
    ("env", "weight", "number"),
    [
        ("sb3_bruno_envs:PointGoal-v0", "log_widen", 1e30),
        ("sb3_bruno_envs:PointGoal-v0", "log_widen", 60.0),
        ("sb3_bruno_envs:PointGoal-v0", "head.components.bias", 3e38),
        (POINT, "logits.weight", 3e38),
    ],
)
def test_a_read_out_that_is_not_finite_is_refused(env, weight, number, agents, tmp_path, monkeypatch):
    model = agents[env]
    tensor = dict([*model.policy.readout.named_parameters(), *model.policy.readout.named_buffers()])[weight]
    before = tensor.detach().clone()
    told = "its read-out tells a task that is not finite"
    with th.no_grad():
        tensor.fill_(number)
        with pytest.raises(ValueError, match=f"cannot be saved .* {told}"):
            save_agent(model, tmp_path / "point.agent")
        monkeypatch.setattr(agent_file, "_load_again", lambda *content: None)  # as who is up to no good would
        save_agent(model, tmp_path / "point.agent")
        tensor.copy_(before)
    with pytest.raises(ValueError, match=f"cannot be loaded as an agent: {told}"):
        load_agent(tmp_path / "point.agent", device="cpu")

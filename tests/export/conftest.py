"""A small agent that predicts, forgets and reads the task, exported once for all tests."""

import pytest
import torch as th

from sb3_bruno import BrunoSAC
from sb3_bruno.algorithms.sac import TaskSAC
from support.exported import BARE, disturb
from support.tiny_models import POINT, TINY


@pytest.fixture(scope="session")
def forgetful():
    """An agent that forgets readily, untrained."""
    th.manual_seed(0)
    policy_kwargs = {"net_arch": [16], "forget_threshold": 0.2}
    model = BrunoSAC("MlpPolicy", POINT, **{**TINY, "encoder_kwargs": BARE, "policy_kwargs": policy_kwargs})
    disturb(model)
    return model


@pytest.fixture(scope="session")
def exported(forgetful, tmp_path_factory):
    """The folder of agent.onnx and agent.pt."""
    folder = tmp_path_factory.mktemp("exported")
    for name in ("agent.onnx", "agent.pt"):
        assert forgetful.export(folder / name) == folder / name
    return folder


@pytest.fixture(scope="session")
def plain():
    """An agent with the simplest encoder."""
    return TaskSAC("MlpPolicy", POINT, encoder_class="random_features", **TINY)

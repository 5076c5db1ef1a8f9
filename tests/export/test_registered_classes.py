"""An agent of somebody's own classes is saved and loaded once they are registered."""

import pytest
from torch import nn

from sb3_bruno import BrunoSAC
from sb3_bruno.algorithms.sac import TaskSACPolicy
from sb3_bruno.encoders import RecurrentEncoder
from sb3_bruno.export import classes, load_agent, register_agent_class, save_agent
from support.tiny_models import POINT


class Mine(RecurrentEncoder):
    """An encoder that only its author knows."""


@pytest.fixture
def forgets_what_is_registered(monkeypatch):
    monkeypatch.setattr(classes, "_REGISTERED", {kind: dict(known) for kind, known in classes._REGISTERED.items()})


@pytest.mark.usefixtures("forgets_what_is_registered")
def test_a_class_of_ones_own_is_saved_once_it_is_registered(tmp_path):
    class MyPolicy(TaskSACPolicy):
        pass

    class MySAC(BrunoSAC):
        def __init__(self, *args, **kwargs):
            super().__init__(*args, **kwargs)

    class MyActivation(nn.Tanh):
        pass

    def make(policy):
        given = {"net_arch": [8], "activation_fn": MyActivation}
        return MySAC(policy, POINT, encoder_class=Mine, device="cpu", buffer_size=100, policy_kwargs=given)

    model, path = make(MyPolicy), tmp_path / "mine.agent"
    for named in (MySAC, MyPolicy, Mine, MyActivation):
        with pytest.raises(ValueError, match=rf"{named.__name__}, which .* register it by"):
            save_agent(model, path)
        assert register_agent_class(named) is named
    save_agent(model, path)
    loaded = load_agent(path, device="cpu")
    assert (type(loaded), type(loaded.policy), type(loaded.encoder)) == (MySAC, MyPolicy, Mine)
    classes._REGISTERED["encoder"].clear()
    with pytest.raises(ValueError, match=r"'Mine', which is no encoder that agent files know.*register"):
        load_agent(path)


@pytest.mark.usefixtures("forgets_what_is_registered")
def test_a_key_is_a_name_and_stands_for_one_class():
    with pytest.raises(ValueError, match=r"stands for .* already"):
        register_agent_class(Mine, "recurrent")
    with pytest.raises(ValueError, match="is no name"):
        register_agent_class(Mine, "os.system")
    with pytest.raises(TypeError, match="neither a class"):
        register_agent_class("Mine")


@pytest.mark.usefixtures("forgets_what_is_registered")
def test_a_class_that_could_not_be_built_again_is_refused(tmp_path):
    class Closed(BrunoSAC):
        def __init__(self, policy, env, buffer_size=100):
            super().__init__(policy, env, buffer_size=buffer_size)

    class Forgetful(BrunoSAC):
        def __init__(self, policy, env, colour="red", **kwargs):
            super().__init__(policy, env, **kwargs)

    for named, message in (
        (Closed, "takes no `critic_input`.* pass"),
        (Forgetful, "takes `colour` and keeps it nowhere"),
    ):
        register_agent_class(named)
        with pytest.raises(ValueError, match=message):
            save_agent(named("MlpPolicy", POINT), tmp_path / "point.agent")

"""Whatever a file says of an encoder, its agent is refused or acts at once: neither loading nor acting takes much."""

import contextlib
import inspect
import resource

import numpy as np
import pytest
import torch as th
import zuko

from sb3_bruno import BrunoSAC
from sb3_bruno.algorithms.sac import TaskSAC
from sb3_bruno.encoders import ENCODERS
from sb3_bruno.export import load_agent, save_agent
from sb3_bruno.export.arguments import check_arguments
from sb3_bruno.export.limits import LARGEST_COUNT, Budget
from sb3_bruno.zoo.stored_agent import write_beside
from support.agent_zips import put, with_json, with_tensors
from support.hostile_files import MOST_MEMORY
from support.tiny_models import TINY, make_point, tiny


def made(encoder, **encoder_kwargs):
    """An agent that has no read-out, which would show when it is made what an encoder's memory costs."""
    options = {"encoder_class": encoder, "encoder_kwargs": encoder_kwargs, "task_readout": False}
    return TaskSAC("MlpPolicy", make_point(), **{**TINY, **options})


def cost(data, path):
    """Bytes that it takes to load an agent, and to act twice where it is not refused."""
    path.write_bytes(data)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with contextlib.suppress(ValueError):
        model = load_agent(path, device="cpu")
        observation = {key: np.zeros(space.shape, space.dtype) for key, space in model.observation_space.items()}
        state = model.predict({**observation, "episode_start": np.ones(1, np.float32)})[1]
        model.predict({key: array[None] for key, array in observation.items()}, state)
    return 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)


@pytest.mark.timeout(60)
@pytest.mark.parametrize("encoder", ENCODERS)
def test_no_number_of_an_encoder_costs_more_than_a_file_is_worth(encoder, tmp_path):
    save_agent(made(encoder), tmp_path / "good.agent")
    good = (tmp_path / "good.agent").read_bytes()
    parameters = inspect.signature(ENCODERS[encoder]).parameters
    counted = [name for name, parameter in parameters.items() if type(parameter.default) is int]
    for name in counted:
        hostile = with_json(good, put("arguments", "encoder_kwargs", name, value=LARGEST_COUNT))
        assert cost(hostile, tmp_path / "hostile.agent") < MOST_MEMORY


@pytest.mark.timeout(60)
def test_a_window_that_fits_its_tensors_is_paid_for_by_them(tmp_path):
    save_agent(made("causal_transformer", hidden_size=256, n_layers=1, n_heads=1), tmp_path / "good.agent")
    good = (tmp_path / "good.agent").read_bytes()

    def widen(tensors):
        names = [name for name in tensors if name.endswith("of_distance")]
        tensors.update({name: th.zeros(1, LARGEST_COUNT) for name in names})

    window = put("arguments", "encoder_kwargs", "window", value=LARGEST_COUNT)
    hostile = with_tensors(with_json(good, window), widen)
    assert cost(hostile, tmp_path / "hostile.agent") < 4 * len(hostile) + MOST_MEMORY


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"hidden_size": 4_097}, "'encoder_kwargs.hidden_size' has 4097, and whole numbers up to 4,096"),
        ({"net_arch": [8, -5_000]}, "'encoder_kwargs.net_arch' has -5000"),
        ({"flow_kwargs": {"degree": 40_000}}, "'encoder_kwargs.flow_kwargs.degree' has 40000, and .* 1,024"),
        ({"flow_kwargs": {"network": {"hidden_features": [2_000]}}}, "flow_kwargs.network.hidden_f.* has 2000"),
        ({"flow_kwargs": {"order": [0] * 2_000}}, "'encoder_kwargs.flow_kwargs.order' has 2,000 entries"),
    ],
)
def test_a_number_that_may_cost_its_cube_is_refused_by_name(arguments, told):
    with pytest.raises(ValueError, match=told):
        check_arguments(TaskSAC, {"policy_kwargs": {}, "encoder_kwargs": arguments, "buffer_size": 1})


def test_a_flow_whose_weights_decide_how_long_it_computes_is_no_encoders():
    with pytest.raises(ValueError, match=r"CNF.* cannot map in inference mode"):
        made("bruno", flow_class=zuko.flows.CNF)


def test_an_agent_whose_memory_is_the_square_of_its_weights_is_loaded(tmp_path):
    model = BrunoSAC("MlpPolicy", make_point(), **{**tiny(BrunoSAC), "encoder_kwargs": {"n_weights": 400}})
    save_agent(model, tmp_path / "point.agent")
    assert load_agent(tmp_path / "point.agent", device="cpu").policy.encoder_kwargs == {"n_weights": 400}


@pytest.fixture(scope="module")
def vast():
    """An agent that takes gigabytes to act."""
    return made("bruno", n_weights=4_000)


def test_what_could_not_be_loaded_again_is_not_saved(vast, tmp_path):
    told = r"cannot be saved as '.*vast\.agent': it could not be loaded again, as its settings ask for more memory .*: "
    with pytest.raises(ValueError, match=told + "make it with other settings.* by `model.save` alone"):
        save_agent(vast, tmp_path / "vast.agent")
    assert list(tmp_path.iterdir()) == []


def test_the_command_line_then_keeps_the_zip_alone(vast, tmp_path):
    path = tmp_path / "vast.agent"
    path.write_text("an older agent")
    with pytest.warns(UserWarning, match=r"is not written, so there is the zip alone\. .*more memory"):
        write_beside(vast, path, path)
    assert list(tmp_path.iterdir()) == []


def test_what_could_not_be_built_again_is_not_saved(plain, tmp_path, monkeypatch):
    def fail(self, memory):
        raise KeyError("belief")

    monkeypatch.setattr(type(plain.policy.encoder), "belief", fail)
    with pytest.raises(ValueError, match=r"could not be loaded again, as KeyError: 'belief': make it with other"):
        save_agent(plain, tmp_path / "plain.agent")


def test_a_budget_counts_memory_as_long_as_it_is_held():
    """Of 8 bytes for each that is kept: here 800, which a tensor of 400 bytes and its views leave half free."""
    with Budget({"kept": th.zeros(25)}, spare=0):
        held = th.zeros(100)
        views = [held.view(10, 10).t() for _ in range(5)]
        for _ in range(10):
            th.zeros(100)  # which is free again at once
        with pytest.raises(ValueError, match="more memory or work"):
            th.zeros(101)
        del held
        with pytest.raises(ValueError, match="more memory or work"):
            th.zeros(101)  # which the views still hold
        del views
        th.zeros(200)


def test_a_budget_ends_where_memory_is_taken_again_and_again():
    with Budget({"kept": th.zeros(25)}, spare=0):
        for _ in range(32):  # 16 times 800 bytes
            th.zeros(100)
        with pytest.raises(ValueError, match="more memory or work"):
            th.zeros(100)

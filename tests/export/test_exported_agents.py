"""A file acts as the agent that it was made of: every encoder, every algorithm, every process."""

import numpy as np
import pytest
import torch as th

from sb3_bruno import BrunoSAC, PearlSAC
from sb3_bruno.algorithms.crossq import TaskCrossQ
from sb3_bruno.algorithms.sac import TaskSAC
from sb3_bruno.algorithms.td3 import TaskTD3
from sb3_bruno.algorithms.tqc import TaskTQC
from sb3_bruno.encoders import ENCODERS, BrunoEncoder, Transitions
from sb3_bruno.export import Controller
from support.exported import BARE, STARTS, Agent, assert_acts_alike, begin, disturb
from support.tiny_models import POINT, TINY, TRIAL, make_pendulum, normalized

SMALL = {"bruno": {**BARE, "flow_class": "spline"}, "causal_transformer": {"window": 4}}
PAPERS = {"modelled": "rewards", "process": "gaussian", "flow_class": "reflected_maf", "extra_dims": 1}
MOMENTS = {"belief": "moments", "head": "mixture"}
CASES = {
    **{name: (TaskSAC, POINT, {"encoder_class": name, "encoder_kwargs": SMALL.get(name)}) for name in ENCODERS},
    "TQC": (TaskTQC, POINT, {"encoder_class": "random_features"}),
    "CrossQ": (TaskCrossQ, POINT, {"encoder_class": "random_features"}),
    "TD3": (TaskTD3, POINT, {"encoder_class": "random_features"}),
    "gSDE": (TaskSAC, POINT, {"encoder_class": "random_features", "use_sde": True}),
    "of both": (BrunoSAC, POINT, {"encoder_kwargs": {**BARE, "modelled": "both"}}),
    "Student-t": (BrunoSAC, POINT, {"encoder_kwargs": {**BARE, "process": "kernel_student_t"}}),
    "the paper's": (
        BrunoSAC,
        POINT,
        {
            "encoder_kwargs": {
                "modelled": "rewards",
                "process": "gaussian",
                "flow_class": "reflected_maf",
                "extra_dims": 1,
            }
        },
    ),
    "Pendulum": (
        TaskSAC,
        make_pendulum,
        {"encoder_class": "supervised_belief", "encoder_kwargs": {"belief": "moments"}},
    ),
    "normalised": (TaskSAC, lambda: normalized(make_pendulum), {"encoder_class": "recurrent"}),
    "many tasks": (TaskSAC, TRIAL, {"encoder_class": "mean_embedding"}),
}


def model_of(case):
    algorithm, env, kwargs = CASES[case]
    model = algorithm("MlpPolicy", env() if callable(env) else env, **{**TINY, **kwargs})
    disturb(model)
    return model


@pytest.mark.parametrize("case", CASES)
def test_an_exported_agent_acts_as_predict_does(case, tmp_path):
    model = model_of(case)
    model.export(tmp_path / "agent.onnx")
    assert_acts_alike(model, Controller(tmp_path / "agent.onnx"))


def test_it_does_so_over_a_thousand_steps_with_ends_of_episodes_and_switches_of_the_task(forgetful, exported):
    controller, agent, generator = Controller(exported / "agent.onnx"), Agent(forgetful), np.random.default_rng(0)
    absorbed = []
    for t in range(1_000):
        start = {0: 1.0, 40: 0.5}.get(t % 80, 0.0)
        begin(controller, start)
        task = 1 if t % 80 < 20 else -1
        observation, reward = generator.normal(size=2), task + 0.3 * generator.normal()
        action = agent.act(observation, reward, start)
        np.testing.assert_allclose(controller.act(observation, reward), action, atol=1e-5, rtol=0)
        absorbed.append(agent.state[0][0, -1])
    assert max(absorbed) > 20
    assert all(np.diff(absorbed)[t : t + 5].min() < 0 for t in range(19, 999, 80))  # the switch was noticed


def test_torchscript_acts_alike_too(forgetful, exported):
    with pytest.warns(DeprecationWarning, match="jit"):
        step = th.jit.load(exported / "agent.pt")
    agent, generator = Agent(forgetful), np.random.default_rng(0)
    action, memory = th.zeros(1, 2), th.zeros(1, Controller(exported / "agent.onnx").metadata["inputs"]["memory"][1])
    for t in range(30):
        start, observation, reward = STARTS.get(t, 0.0), generator.normal(size=2), generator.normal()
        expected = agent.act(observation, reward, start)
        row = th.as_tensor(observation, dtype=th.float32).reshape(1, 2)
        action, memory, surprise, *_ = step(row, action, th.full((1, 1), reward), th.full((1, 1), start), memory)
        np.testing.assert_allclose(action[0], expected, atol=1e-5, rtol=0)
        np.testing.assert_allclose(surprise.item(), agent.surprise(), atol=1e-4)


@pytest.mark.parametrize("case", ["recurrent", "supervised_belief", "causal_transformer", "CrossQ", "Student-t"])
def test_the_exporter_finds_that_torchscript_acts_alike(case, tmp_path):
    model_of(case).export(tmp_path / "agent.pt")


def test_a_threshold_out_of_reach_is_exported_too(tmp_path):
    model = BrunoSAC("MlpPolicy", POINT, **{**TINY, "encoder_kwargs": BARE})
    model.policy.forget_threshold = float("inf")
    model.export(tmp_path / "agent.pt")


def test_an_encoder_that_samples_is_given_its_noise(tmp_path, monkeypatch):
    kwargs = {"belief": "sample", "exploration_episodes": 1}
    model = PearlSAC("MlpPolicy", TRIAL, **{**TINY, "encoder_kwargs": kwargs})
    model.export(tmp_path / "agent.onnx")
    controller = Controller(tmp_path / "agent.onnx", seed=0)
    assert controller.metadata["inputs"]["noise"] == [1, model.encoder.latent_dim]
    monkeypatch.setattr(
        model.encoder, "redraw", lambda memory: memory._replace(noise=th.as_tensor(controller._inputs["noise"]))
    )
    assert_acts_alike(model, controller)
    first, again, other = (Controller(tmp_path / "agent.onnx", seed=seed).act([0.5, 0.5]) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_what_an_agent_is_told_to_do_by_hand_is_what_it_learns_from(forgetful, exported):
    controller, told = Controller(exported / "agent.onnx"), Controller(exported / "agent.onnx")
    for t in range(3):
        controller.act([0.1 * t, 0.2])
        told.act([0.1 * t, 0.2], action=[0.9, -0.9] if t else None)
    assert abs(controller.surprise - told.surprise) > 1e-4


def test_no_export_changes_the_agent(plain, tmp_path):
    before = {name: value.clone() for name, value in plain.policy.state_dict().items()}
    checks = th.distributions.Distribution._validate_args
    plain.export(tmp_path / "agent.pt")
    assert all(th.equal(value, before[name]) for name, value in plain.policy.state_dict().items())
    assert th.distributions.Distribution._validate_args == checks
    assert all(parameter.requires_grad for parameter in plain.policy.actor.parameters())


@pytest.mark.parametrize("modelled", ["rewards", "next_observations", "both"])
def test_only_who_models_rewards_needs_one(modelled):
    encoder = BrunoEncoder(2, 2, modelled=modelled, net_arch=(8,))
    without, rewarded = (
        encoder.absorb(encoder.empty((1,)), Transitions(*(th.ones(1, 2),) * 2, th.full((1, 1), reward), th.ones(1, 2)))
        for reward in (0.0, 1.0)
    )
    assert th.equal(without.high, rewarded.high) == (modelled == "next_observations")

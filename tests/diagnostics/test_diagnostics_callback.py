"""DiagnosticsCallback: numbers and figure reach TensorBoard, and training does not notice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch as th
import zuko
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecNormalize
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sb3_bruno import BrunoSAC, RecurrentSAC
from sb3_bruno.diagnostics.callback import DiagnosticsCallback
from sb3_bruno.diagnostics.diagnose import diagnose
from sb3_bruno.diagnostics.result import Diagnostics
from sb3_bruno_envs import POINT_DIR_TASKS

ENV_ID = "sb3_bruno_envs:PointDir-v0"
TASKS = POINT_DIR_TASKS.tasks("test")
SMALL = {"flow_class": zuko.flows.MAF, "flow_kwargs": {"transforms": 2, "hidden_features": (16,)}}


def make_env() -> gym.Env[Any, Any]:
    return gym.make(ENV_ID)


def run(callback: DiagnosticsCallback | None, log: Path | None = None, learning_starts: int = 40) -> BrunoSAC:
    """Train an agent for 80 env steps in two normalised envs, which are 40 calls of the callback."""
    settings: dict[str, Any] = {"policy_kwargs": {"net_arch": [16]}, "batch_size": 16}
    settings["learning_starts"] = learning_starts
    env = VecNormalize(make_vec_env(ENV_ID, 2, seed=0), norm_reward=False)
    model = BrunoSAC("MlpPolicy", env, encoder_kwargs=SMALL, seed=0, **settings)
    if log is not None:
        model.set_logger(configure(str(log), ["stdout", "log", "csv", "json", "tensorboard"]))
    return model.learn(80, callback, log_interval=10_000)


def test_numbers_and_figure_are_logged_and_saved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    callback = DiagnosticsCallback(
        make_env, TASKS, 20, n_episodes=2, outside_tasks=[[0.0, 1.0]], log_path=tmp_path / "found", verbose=1
    )
    model = run(callback, tmp_path, learning_starts=1_000)  # so that it stays as the last call found it
    events = EventAccumulator(str(tmp_path), size_guidance={"images": 0}).Reload()
    last = Diagnostics.load(tmp_path / "found" / "diagnostics_80.npz")
    for name, value in last.numbers().items():
        logged = events.Scalars(f"diagnostics/{name}")
        assert [event.step for event in logged] == [40, 80]
        assert logged[-1].value == pytest.approx(value, rel=1e-5)
    figures = events.Images("diagnostics/figure")
    assert [figure.step for figure in figures] == [40, 80]
    assert figures[0].encoded_image_string.startswith(b"\x89PNG")
    assert (tmp_path / "found" / "diagnostics_40.png").read_bytes().startswith(b"\x89PNG")
    csv = np.genfromtxt(tmp_path / "progress.csv", delimiter=",", names=True, deletechars="")
    assert "diagnostics/auroc" in csv.dtype.names and "diagnostics/figure" not in csv.dtype.names
    assert "quantity" in capsys.readouterr().out
    assert last.tasks.tolist() == TASKS.tolist() and len(last.outside_scores()) == 1
    again = diagnose(
        model, make_env, TASKS, n_episodes=2, outside_tasks=[[0.0, 1.0]], vec_normalize=model.get_vec_normalize_env()
    )
    assert again.numbers() == last.numbers()


def test_training_is_the_same_with_and_without() -> None:
    watched = run(DiagnosticsCallback(make_env, TASKS, 20, n_episodes=1))
    alone = run(None)
    for weight, expected in zip(watched.policy.parameters(), alone.policy.parameters(), strict=True):
        th.testing.assert_close(weight, expected, rtol=0, atol=0)


def test_errors_name_the_argument_and_the_remedy() -> None:
    with pytest.raises(ValueError, match="freq=0 is not positive: give the number of calls"):
        DiagnosticsCallback(make_env, TASKS, 0)
    model = SAC("MlpPolicy", gym.make(ENV_ID, observe="plain"), learning_starts=100, device="cpu")
    with pytest.raises(ValueError, match="model is of class SAC, which has no belief: use BrunoSAC or a sibling"):
        model.learn(2, DiagnosticsCallback(make_env, TASKS, 1))


def test_an_encoder_that_cannot_be_diagnosed_is_refused_before_training() -> None:
    model = RecurrentSAC("MlpPolicy", make_vec_env(ENV_ID, 2), policy_kwargs={"net_arch": [16]})
    with pytest.raises(ValueError, match="`diagnose` needs an encoder with the ability `HasPosterior`"):
        model.learn(80, DiagnosticsCallback(make_env, TASKS, 1_000))
    assert model.num_timesteps == 0

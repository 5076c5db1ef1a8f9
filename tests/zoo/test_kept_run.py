"""What a training run saves is whole, or as it was, whenever the process dies."""

import argparse
from pathlib import Path

import pytest

from sb3_bruno.zoo.experiment import TaskExperiment
from sb3_bruno.zoo.registry import register
from sb3_bruno.zoo.stored_agent import OF_BEST, STATISTICS
from support.dying import dies_at

PARAMS = {"normalize": True, "learning_starts": 20, "buffer_size": 200, "n_envs": 1}


def files(folder):
    found = (path for path in Path(folder).rglob("*") if path.suffix in (".agent", ".zip", ".pkl") and path.is_file())
    return {path: path.read_bytes() for path in found if ".unfinished" not in str(path)}


@pytest.mark.parametrize("moment", ["fsync", "replace"])
def test_a_kill_leaves_agent_buffer_and_statistics_as_they_were(tmp_path, monkeypatch, moment):
    monkeypatch.chdir(tmp_path)
    register()
    experiment = TaskExperiment(
        argparse.Namespace(),
        "bruno_sac",
        "PointDir-v0",
        "logs",
        hyperparams=PARAMS,
        save_replay_buffer=True,
        verbose=0,
        seed=0,
        device="cpu",
    )
    model, _ = experiment.setup_experiment()
    best = experiment.callbacks[0].callback_on_new_best
    best.init_callback(model)
    experiment.save_trained_model(model)
    before = files(experiment.save_path)
    names = {"PointDir-v0.agent", "PointDir-v0.zip", "replay_buffer.pkl", "vecnormalize.pkl"}
    assert {path.name for path in before} == names
    model.env.obs_rms["observation"].mean += 1.0
    model.num_timesteps = 7
    dies_at(moment, lambda: experiment.save_trained_model(model))
    dies_at(moment, best.on_step)
    assert files(experiment.save_path) == before
    best.on_step()
    statistics = Path(experiment.save_path, OF_BEST, STATISTICS)
    assert statistics.read_bytes() != before[Path(experiment.params_path, STATISTICS)]

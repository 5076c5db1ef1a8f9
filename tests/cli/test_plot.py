"""``plot`` finds the runs of an environment, however its id is written."""

import numpy as np
import pytest


@pytest.fixture
def evaluated(tmp_path):
    """Write the evaluations of a run of each environment, as their folders are named."""
    for name in ("HoldAngle-v0", "mine-HoldAngle-v0"):
        folder = tmp_path / "logs" / "bruno_sac" / f"{name}_1"
        folder.mkdir(parents=True)
        np.savez(folder / "evaluations.npz", timesteps=[200], results=[[1.0, 2.0]], ep_lengths=[[10, 10]])
        np.savez(folder / "evaluation_tasks.npz", tasks=np.float32([[[1.0], [2.0]]]))


@pytest.mark.parametrize(
    "env",
    ["HoldAngle-v0", "my_envs:HoldAngle-v0", "my.envs:HoldAngle-v0", "mine/HoldAngle-v0", "my_envs:mine/HoldAngle-v0"],
)
def test_the_package_and_the_slash_of_an_id_are_no_part_of_a_folders_name(run, evaluated, monkeypatch, env):
    monkeypatch.setattr("sb3_bruno.plotting.curves.plot_learning_curves", lambda curves, out: None)
    assert run("plot", "-e", env) == (
        "bruno_sac: 1 runs, last evaluation 1.5 on average\nSaved curves.png\n",
        "",
    )


def test_an_environment_without_runs_is_named_as_it_was_given(run, evaluated):
    assert "has no evaluated run of my_envs:Other-v0: train with" in run("plot", "-e", "my_envs:Other-v0")[1]

"""The main job, in small: it trains, goes on after an interruption, tests both directions, saves, reports."""

import pytest

from sb3_bruno import BrunoSAC, quickstart
from sb3_bruno.evaluation.adaptation_result import AdaptationResult
from sb3_bruno.evaluation.eval_callback import load_learning_curve
from sb3_bruno.runs.folder import RunFolder
from sb3_bruno.runs.record import RunRecord

pytestmark = pytest.mark.mujoco


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(quickstart, "TEST_STEPS", 210)
    monkeypatch.setattr(quickstart, "TEST_EPISODES", 1)
    monkeypatch.setattr(quickstart, "N_ENVS", 4)
    monkeypatch.setattr(quickstart, "N_EVAL_ENVS", 2)
    monkeypatch.setattr(quickstart, "N_EVALUATIONS", 2)
    monkeypatch.setattr(quickstart, "SAVE_FREQ", 40)
    settings = {"learning_starts": 40, "gradient_steps": 1, "buffer_size": 2_000, "encoder_learning_starts": 20}
    monkeypatch.setattr(quickstart, "HYPERPARAMETERS", {**quickstart.HYPERPARAMETERS, **settings})


def test_it_trains_tests_saves_and_says_so(tmp_path, capsys):
    quickstart.main(["--steps", "80", "--seed", "3", "--out", str(tmp_path)])
    folder = tmp_path / "cheetah_dir_80_seed3"
    printed = capsys.readouterr().out
    assert str(folder) in printed and "backward" in printed and "forward" in printed
    assert BrunoSAC.load(folder / "model.zip").num_timesteps == 80
    assert AdaptationResult.load(folder / "adaptation.json").rewards.shape == (2, 1, 210)
    assert load_learning_curve(folder).timesteps.tolist() == [40, 80]
    for name in ("adaptation.png", "learning_curve.png"):
        assert (folder / name).stat().st_size > 10_000
    assert RunRecord.from_run(folder).about["config"]["seed"] == 3  # what a results page asks for is there


def test_the_same_command_goes_on_where_it_was_interrupted(tmp_path, capsys, monkeypatch):
    def interrupt(*args, **kwargs):
        raise KeyboardInterrupt

    with monkeypatch.context() as broken:
        broken.setattr(quickstart, "evaluate_adaptation", interrupt)
        with pytest.raises(KeyboardInterrupt):
            quickstart.main(["--steps", "80", "--out", str(tmp_path)])
    quickstart.main(["--steps", "80", "--out", str(tmp_path)])
    assert "Going on at 40 env steps" in capsys.readouterr().out
    assert load_learning_curve(tmp_path / "cheetah_dir_80_seed1").timesteps.tolist() == [40, 80]


@pytest.mark.parametrize("steps", ["-5", "0"])
def test_mistakes_are_one_line(steps, capsys, monkeypatch):
    monkeypatch.delattr(quickstart, "run")
    with pytest.raises(SystemExit):
        quickstart.main(["--steps", steps])
    assert f"--steps must be positive, got {steps}" in capsys.readouterr().err


def test_two_processes_do_not_train_the_same_run(tmp_path, capsys, monkeypatch):
    monkeypatch.delattr(quickstart, "run")
    (tmp_path / "cheetah_dir_80_seed1").mkdir()
    held = RunFolder(tmp_path / "cheetah_dir_80_seed1")
    with pytest.raises(SystemExit):
        quickstart.main(["--steps", "80", "--out", str(tmp_path)])
    assert "cheetah_dir_80_seed1 is in use: process" in capsys.readouterr().err
    held.release()

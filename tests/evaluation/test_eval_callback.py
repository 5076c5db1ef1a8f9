"""TaskEvalCallback logs and stores the returns of each task, and still does all that EvalCallback does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box
from numpy.typing import NDArray
from stable_baselines3 import SAC
from stable_baselines3.common.logger import configure
from stable_baselines3.common.monitor import Monitor

from sb3_bruno.evaluation.eval_callback import TaskEvalCallback, load_learning_curve
from sb3_bruno.evaluation.resumable_eval import ResumableEvalCallback
from support.dying import dies_at
from support.full_disk import full_disk


class CycleEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """Pays the task, once; the tasks are 1, 2, 3, 1, 2, ..."""

    observation_space = Box(-1.0, 1.0, (1,))
    action_space = Box(-1.0, 1.0, (1,))

    def __init__(
        self,
        n_tasks: int = 3,
        named: bool = True,
        call: Callable[[float], str] | None = None,
        succeeds: Callable[[float], Any] = lambda task: task > 1.0,
    ) -> None:
        self.resets, self.n_tasks, self.named, self.call, self.succeeds = -1, n_tasks, named, call, succeeds

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        super().reset(seed=seed)
        self.resets += 1
        return np.zeros(1, dtype=np.float32), {}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        task = self.resets % self.n_tasks + 1.0
        info = {"task": np.array([task], dtype=np.float32), "is_success": self.succeeds(task)} if self.named else {}
        return (
            np.zeros(1, dtype=np.float32),
            task,
            True,
            False,
            info | ({"task_name": self.call(task)} if self.call else {}),
        )


def learn(env: gym.Env[Any, Any], folder: Path, **kwargs: Any) -> dict[str, list[float]]:
    """Act at random for 20 steps, with an evaluation every 10; return the logged numbers, by key."""
    model = SAC("MlpPolicy", CycleEnv(), learning_starts=1_000, policy_kwargs={"net_arch": [4]}, device="cpu")
    model.set_logger(configure(str(folder), ["csv"]))
    callback = TaskEvalCallback(env, log_path=str(folder), eval_freq=10, verbose=0, **kwargs)
    model.learn(20, callback=callback, log_interval=1_000)
    logged = np.genfromtxt(folder / "progress.csv", delimiter=",", names=True, deletechars="")
    assert logged.dtype.names is not None
    return {key: np.atleast_1d(logged[key]).tolist() for key in logged.dtype.names}


@pytest.mark.parametrize("monitored", [True, False])
def test_returns_of_each_task_are_logged_with_the_rest(tmp_path: Path, monitored: bool) -> None:
    env: gym.Env[Any, Any] = Monitor(CycleEnv()) if monitored else CycleEnv()
    logged = learn(env, tmp_path, n_eval_episodes=6, warn=False)
    for task in (1, 2, 3):
        assert logged[f"eval/return_task_{task}"] == [task, task]
    assert logged["eval/mean_reward"] == [2, 2]
    np.testing.assert_allclose(logged["eval/success_rate"], 2 / 3, rtol=1e-4)


def test_learning_curve_holds_the_task_of_each_episode(tmp_path: Path) -> None:
    learn(Monitor(CycleEnv()), tmp_path, n_eval_episodes=4)
    curve = load_learning_curve(tmp_path)
    np.testing.assert_array_equal(curve.timesteps, [10, 20])
    # The reset after an evaluation's last episode takes a task, which the next evaluation's reset skips.
    np.testing.assert_array_equal(curve.returns, [[1, 2, 3, 1], [3, 1, 2, 3]])
    np.testing.assert_array_equal(curve.tasks, curve.returns[..., None])


def test_tasks_with_names_are_logged_and_kept_by_them(tmp_path: Path) -> None:
    env = Monitor(CycleEnv(call=lambda task: f"{task} m/s"))
    logged = learn(env, tmp_path, n_eval_episodes=3)
    assert logged["eval/return_task_2.0_m_s"] == [2, 2] and logged["eval/success_task_1.0_m_s"] == [0, 0]
    assert load_learning_curve(tmp_path).names[0].tolist() == ["1.0 m/s", "2.0 m/s", "3.0 m/s"]


def test_tasks_of_one_name_are_logged_apart(tmp_path: Path) -> None:
    logged = learn(Monitor(CycleEnv(call=lambda task: "fast")), tmp_path, n_eval_episodes=3, warn=False)
    assert [np.sum(logged[f"eval/return_task_fast{end}"]) for end in ("", "_2", "_3")] == [2, 4, 6]


def test_successes_that_only_some_episodes_tell_are_kept_in_their_places(tmp_path: Path) -> None:
    """SB3's row would have two numbers in one evaluation and three in the next, which no file can hold."""
    env = Monitor(CycleEnv(succeeds=lambda task: None if task == 1 else np.bool_(task == 3)))
    logged = learn(env, tmp_path, n_eval_episodes=4)
    rows = TaskEvalCallback.read(tmp_path)
    np.testing.assert_array_equal(rows["successes"], [[np.nan, 0, 1, np.nan], [1, np.nan, 0, 1]])
    np.testing.assert_allclose(logged["eval/success_rate"], [1 / 2, 2 / 3], rtol=1e-4)


def test_no_success_is_kept_where_none_is_told(tmp_path: Path) -> None:
    logged = learn(Monitor(CycleEnv(succeeds=lambda task: None)), tmp_path, n_eval_episodes=2)
    assert not any("success" in key for key in [*logged, *TaskEvalCallback.read(tmp_path)])


def test_endless_tasks_do_not_flood_the_log(tmp_path: Path) -> None:
    logged = learn(Monitor(CycleEnv(n_tasks=1_000)), tmp_path, n_eval_episodes=60)
    assert sum(key.startswith("eval/return_task_") for key in logged) == 50
    assert load_learning_curve(tmp_path).tasks.shape == (2, 60, 1)


def test_an_environment_without_task_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="wrap the eval environment in MetaTask"):
        learn(Monitor(CycleEnv(named=False)), tmp_path)


def test_a_second_learn_goes_on_where_the_first_stopped(tmp_path: Path) -> None:
    model = SAC("MlpPolicy", CycleEnv(), learning_starts=1_000, policy_kwargs={"net_arch": [4]}, device="cpu")
    callback = TaskEvalCallback(Monitor(CycleEnv()), log_path=str(tmp_path), eval_freq=10, n_eval_episodes=1, verbose=0)
    model.learn(10, callback=callback)
    model.learn(10, callback=callback, reset_num_timesteps=False)
    curve = load_learning_curve(tmp_path)
    np.testing.assert_array_equal(curve.timesteps, [10, 20])
    np.testing.assert_array_equal(curve.tasks.ravel(), curve.returns.ravel())


def test_an_evaluation_cut_short_between_the_two_files_is_left_out(tmp_path: Path) -> None:
    learn(Monitor(CycleEnv()), tmp_path, n_eval_episodes=2)
    stored = np.load(tmp_path / "evaluation_tasks.npz")["tasks"]
    np.savez(tmp_path / "evaluation_tasks.npz", tasks=stored[:1])  # as an earlier version did, without names
    curve = load_learning_curve(tmp_path)
    assert [len(values) for values in curve[:3]] == [1, 1, 1] and curve.called().shape == (1, 2)


def model_after(steps: int) -> SAC:
    model = SAC("MlpPolicy", CycleEnv(), learning_starts=1_000, policy_kwargs={"net_arch": [4]}, device="cpu")
    model.num_timesteps = steps
    return model


def evaluating(folder: Path, kind: type[ResumableEvalCallback], **kwargs: Any) -> ResumableEvalCallback:
    settings = {"eval_freq": 10, "n_eval_episodes": 2, "verbose": 0, **kwargs}
    return kind(Monitor(CycleEnv()), log_path=str(folder), best_model_save_path=str(folder), **settings)


KINDS = pytest.mark.parametrize("kind", [ResumableEvalCallback, TaskEvalCallback])


@KINDS
def test_a_resumed_run_continues_its_curve_whether_or_not_it_is_told_to(
    tmp_path: Path, kind: type[ResumableEvalCallback]
) -> None:
    model_after(0).learn(30, evaluating(tmp_path, kind))
    rows = kind.read(tmp_path)
    assert rows["timesteps"].tolist() == [10, 20, 30]
    told = evaluating(tmp_path, kind)
    told.restore(model_after(20))
    assert told.evaluations_timesteps == [10, 20] and told.n_calls == 20
    assert told.best_mean_reward == rows["results"][:2].mean(axis=1).max()
    model_after(20).learn(20, evaluating(tmp_path, kind), reset_num_timesteps=False)
    assert kind.read(tmp_path)["timesteps"].tolist() == [10, 20, 30, 40], "and no row twice"
    np.testing.assert_array_equal(kind.read(tmp_path)["results"][:2], rows["results"][:2])
    model_after(0).learn(10, evaluating(tmp_path, kind))
    assert kind.read(tmp_path)["timesteps"].tolist() == [10], "a run that starts anew has a new curve"


@KINDS
@pytest.mark.parametrize("damage", [lambda whole: whole[:200], lambda whole: b"", lambda whole: b"text"])
def test_a_curve_that_cannot_be_read_is_set_aside_and_blocks_nothing(
    tmp_path: Path, kind: type[ResumableEvalCallback], damage: Any
) -> None:
    model_after(0).learn(10, evaluating(tmp_path, kind))
    for name in kind.files:
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(damage(whole))
        with pytest.warns(UserWarning, match="a new learning curve begins"):
            model_after(10).learn(10, evaluating(tmp_path, kind), reset_num_timesteps=False)
        assert (tmp_path / f"{name}.damaged").read_bytes() == damage(whole)
        assert kind.read(tmp_path)["timesteps"].tolist() == [20]


@KINDS
def test_a_kill_in_an_evaluation_leaves_curve_and_best_model_whole(
    tmp_path: Path, kind: type[ResumableEvalCallback]
) -> None:
    model_after(0).learn(10, evaluating(tmp_path, kind))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert before.keys() == {*kind.files, "best_model.zip"}
    for moment in ("fsync", "replace"):
        callback = evaluating(tmp_path, kind)
        callback.best_mean_reward = -np.inf
        dies_at(moment, lambda callback=callback: model_after(10).learn(10, callback, reset_num_timesteps=False))
        assert {name: (tmp_path / name).read_bytes() for name in before} == before


def test_evaluations_of_another_number_of_episodes_are_refused_before_training(tmp_path: Path) -> None:
    model_after(0).learn(10, evaluating(tmp_path, TaskEvalCallback))
    callback = evaluating(tmp_path, TaskEvalCallback, n_eval_episodes=3)
    with pytest.raises(ValueError, match=r"n_eval_episodes=3.* are of 2 episodes"):
        model_after(10).learn(10, callback, reset_num_timesteps=False)


def test_there_is_nothing_to_continue_without_a_folder_or_before_the_first_evaluation(tmp_path: Path) -> None:
    new = evaluating(tmp_path, TaskEvalCallback)
    new.restore(model_after(20))
    assert new.evaluations_timesteps == []
    with pytest.raises(ValueError, match="log_path"):
        TaskEvalCallback(CycleEnv()).restore(model_after(20))


def test_load_names_the_folder_that_lacks_the_files(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds no evaluations with tasks: give a log_path of TaskEvalCallback"):
        load_learning_curve(tmp_path)


@KINDS
def test_evaluations_that_a_full_disk_refuses_are_written_with_the_next(
    tmp_path: Path, kind: type[ResumableEvalCallback]
) -> None:
    callback, model = evaluating(tmp_path, kind), model_after(0)
    model.learn(10, callback)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with full_disk(100), pytest.warns(UserWarning, match=r"at 20 env steps .* \(File too large\): free some space"):
        model.learn(10, callback, reset_num_timesteps=False)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    model.learn(10, callback, reset_num_timesteps=False)
    rows = kind.read(tmp_path)
    assert rows["timesteps"].tolist() == [10, 20, 30] and len(rows["successes"]) == 3
    if kind is TaskEvalCallback:
        np.testing.assert_array_equal(rows["tasks"][..., 0], rows["results"])


@KINDS
def test_another_error_of_the_system_ends_the_training(tmp_path: Path, kind: type[ResumableEvalCallback]) -> None:
    class Died(CycleEnv):
        def step(self, action: Any) -> Any:
            raise BrokenPipeError("the process died")

    callback = kind(Monitor(Died()), log_path=str(tmp_path), eval_freq=10, n_eval_episodes=1, verbose=0)
    with pytest.raises(BrokenPipeError, match="the process died"):
        model_after(0).learn(10, callback)

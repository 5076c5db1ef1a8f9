"""Evaluation on given tasks, by scripted models in environments whose rewards are known."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.wrappers import FrameStackObservation
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno.evaluation import evaluate_adaptation, library_versions, versions
from sb3_bruno_envs import POINT_DIR_TASKS

NAN = np.nan
TASKS = [[1.0, 2.0], [-1.0, 3.0], [0.5, 1.0]]  # gain and length


class GainEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """Pays gain times action for ``length`` steps; gain and length are the task. Shows a number drawn at reset."""

    observation_space = Box(-np.inf, np.inf, (1,))
    action_space = Box(-np.inf, np.inf, (1,))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        super().reset(seed=seed)
        self.task = np.array((options or {}).get("task", [1_000.0, 2.0]), dtype=np.float32)
        self.steps = 0
        self.seen = self.np_random.normal(size=1).astype(np.float32)
        return self.seen, {"task": self.task}

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        self.steps += 1
        reward = float(self.task[0] * action[0])
        return self.seen, reward, self.steps >= self.task[1], False, {"task": self.task}


class DeafEnv(GainEnv):
    """Ignores the task that it is given and draws its own."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        return super().reset(seed=seed)


class Counter:
    """Acts 1, 2, 3, ... from the start of each episode; it counts in its state alone."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[NDArray[Any], tuple[NDArray[Any], ...]]:
        assert episode_start is not None
        assert deterministic
        count = np.zeros(len(observation)) if state is None else state[0]
        count = np.where(episode_start, 0.0, count) + 1.0
        return count[:, None], (count,)


class Echo:
    """Returns what it observes as its action."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[NDArray[Any], None]:
        assert isinstance(observation, np.ndarray)
        return observation, None


@pytest.mark.parametrize("max_envs", [1, 2, 4, 64])
def test_rewards_are_exact_for_any_number_of_environments(max_envs: int) -> None:
    result = evaluate_adaptation(Counter(), GainEnv, TASKS, n_episodes=2, max_envs=max_envs, config={"a": 1}, seed=3)
    expected = [[1, 2, NAN], [-1, -2, -3], [0.5, NAN, NAN]]
    np.testing.assert_array_equal(result.rewards, np.repeat(np.array(expected)[:, None], 2, axis=1))
    np.testing.assert_array_equal(result.tasks, TASKS)
    np.testing.assert_array_equal(result.mean_return(), [3, -6, 0.5])
    assert (result.config, result.seed) == ({"a": 1}, 3)


def test_every_episode_has_its_own_seed_whatever_the_batches() -> None:
    tasks = [[1.0, 1.0], [1.0, 1.0]]  # episodes of one step, whose reward is the number drawn at reset

    def draws(**kwargs: Any) -> NDArray[np.float32]:
        return evaluate_adaptation(Echo(), GainEnv, tasks, n_episodes=5, **kwargs).rewards

    drawn = draws()
    assert len(np.unique(drawn)) == 10
    np.testing.assert_array_equal(drawn, draws(max_envs=3))
    assert not np.isin(drawn, draws(seed=1)).any()


def test_training_statistics_normalise_the_observations_and_stay_as_they_are() -> None:
    training = VecNormalize(DummyVecEnv([GainEnv]), norm_reward=True)
    training.obs_rms.mean, training.obs_rms.var = np.array([2.0]), np.array([4.0])
    before = training.obs_rms.count
    plain = evaluate_adaptation(Echo(), GainEnv, [[1.0, 1.0]], n_episodes=3)
    normalised = evaluate_adaptation(Echo(), GainEnv, [[1.0, 1.0]], n_episodes=3, vec_normalize=training)
    np.testing.assert_allclose(normalised.rewards, (plain.rewards - 2.0) / 2.0, rtol=1e-5)
    assert training.obs_rms.count == before


def test_point_dir() -> None:
    """A point that always moves right earns the cosine of the hidden direction, minus the cost of the action."""
    tasks = POINT_DIR_TASKS.tasks("test")

    class Right:
        """Moves right."""

        def predict(
            self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
        ) -> tuple[NDArray[Any], None]:
            return np.tile([1.0, 0.0], (len(observation["observation"]), 1)), None

    result = evaluate_adaptation(Right(), lambda: gym.make("sb3_bruno_envs:PointDir-v0"), tasks, n_episodes=2)
    assert result.rewards.shape == (2, 2, 30)
    np.testing.assert_allclose(result.mean_return(), 30 * (tasks[:, 0] - 0.05), rtol=1e-5)
    np.testing.assert_array_equal(result.steps_to_steady(), 0)


def test_each_episode_of_a_trial_has_its_return() -> None:
    class Once:
        """Stands still through the first episode of a trial, then moves up to the goal and stays there."""

        def predict(
            self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
        ) -> tuple[NDArray[Any], tuple[NDArray[Any], ...]]:
            began = np.zeros((len(episode_start), 1)) if state is None else state[0]
            began = np.where(episode_start[:, None], 0, began) + observation["episode_start"]  # inner episodes so far
            position = observation["observation"]
            way = np.clip((np.array([0.0, 1.0]) - position) / 0.15, -1.0, 1.0)
            return np.where(began > 1, way, 0.0), (began,)

    make_env = partial(gym.make, "sb3_bruno_envs:SparsePointGoal-v0", n_episodes=4)
    result = evaluate_adaptation(Once(), make_env, [[0.0, 1.0]], n_episodes=2)
    returns = result.returns_per_episode(4)
    assert returns.shape == (1, 2, 4)
    np.testing.assert_array_equal(returns[..., 0], 0.0)
    assert (returns[..., 1:] > 14.0).all()


def test_the_oracle_of_a_trial_is_evaluated() -> None:
    class Oracle:
        """Moves up to the goal that it is told, and stays there."""

        def predict(
            self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
        ) -> tuple[NDArray[Any], None]:
            return np.clip((observation[:, -2:] - observation[:, :2]) / 0.15, -1.0, 1.0), None

    make_env = partial(gym.make, "sb3_bruno_envs:SparsePointGoal-v0", observe="task")
    result = evaluate_adaptation(Oracle(), make_env, [[0.0, 1.0], [1.0, 0.0]], n_episodes=1)
    assert (result.returns_per_episode(3) > 14.0).all()


def test_what_a_wrapper_around_a_trial_has_not_seen_is_told() -> None:
    class Still:
        """Stands still."""

        def predict(
            self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
        ) -> tuple[NDArray[Any], None]:
            return np.zeros((len(observation), 2)), None

    def make_env() -> gym.Env[Any, Any]:
        return FrameStackObservation(gym.make("sb3_bruno_envs:SparsePointGoal-v0", observe="plain"), 2)

    with pytest.raises(ValueError, match=r"shape \(2, 2\), and where .* has shape \(2,\): put wrappers .* inside"):
        evaluate_adaptation(Still(), make_env, [[0.0, 1.0]], n_episodes=1)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"tasks": [1.0, 2.0]}, r"tasks have shape \(2,\): give at least one"),
        ({"tasks": np.zeros((0, 2))}, r"tasks have shape \(0, 2\)"),
        ({"tasks": [[1, 2], [3, 2**24 + 1]]}, r"tasks\[1\]=\[3, 16777217\] becomes \[3\.0, 16777216\.0\] in float32"),
        ({"tasks": "a"}, "tasks='a' are no numbers: give an array"),
        ({"n_episodes": 0}, "n_episodes=0 is not positive"),
        ({"n_episodes": 1.5}, "n_episodes=1.5 is not positive and whole: give at least 1"),
        ({"n_episodes": True}, "n_episodes=True is not positive and whole"),
        ({"make_env": GainEnv()}, "make_env=.* is no function: give one without arguments"),
        ({"max_envs": -1}, "max_envs=-1 is not positive"),
        ({"make_env": DeafEnv}, r"was given task \[1\. 2\.\] and names \[1000\..* takes reset\(options="),
        ({"tasks": [[np.inf, 1.0]]}, "reward at step 0 is not finite"),
    ],
)
def test_errors_name_the_argument_and_the_remedy(kwargs: dict[str, Any], message: str) -> None:
    arguments: dict[str, Any] = {"model": Counter(), "make_env": GainEnv, "tasks": TASKS} | kwargs
    with pytest.raises(ValueError, match=message):
        evaluate_adaptation(**arguments)


def test_environments_are_closed_even_after_an_error() -> None:
    closed = []

    class Closing(DeafEnv):
        """Notes that it is closed."""

        def close(self) -> None:
            closed.append(self)

    with pytest.raises(ValueError, match="was given task"):
        evaluate_adaptation(Counter(), Closing, TASKS, n_episodes=1)
    assert len(closed) == 3


def test_versions_name_the_libraries_and_only_known_ones() -> None:
    versions = library_versions()
    assert {"python", "torch", "stable_baselines3", "gymnasium", "numpy"} <= versions.keys()
    assert all(isinstance(version, str) and version for version in versions.values())


def test_commit_is_that_of_the_clone_that_tracks_the_file(tmp_path: Path) -> None:
    def git(*arguments: str) -> str:
        identity = ["-c", "user.name=x", "-c", "user.email=x@example.org"]
        command = ["git", "-C", str(tmp_path), *identity, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    file = tmp_path / "module.py"
    file.write_text("one\n")
    commit: Callable[[Path], str | None] = versions._git_commit
    git("init")
    assert commit(file) is None  # not tracked: say, installed into a virtual environment inside some clone
    git("add", "module.py")
    git("commit", "-m", "one")
    assert commit(file) == git("rev-parse", "HEAD")
    file.write_text("two\n")
    assert re.fullmatch(r"[0-9a-f]{40}-dirty", commit(file) or "")


def test_names_of_tasks_and_successes_come_from_the_environment() -> None:
    class Telling(GainEnv):
        """Names its task, and calls an episode with a gain of 2 or more a success."""

        def reset(self, **kwargs: Any) -> Any:
            observation, info = super().reset(**kwargs)
            return observation, info | {"task_name": f"gain {info['task'][0]:g}"}

        def step(self, action: NDArray[np.float32]) -> Any:
            *rest, info = super().step(action)
            return *rest, info | {"is_success": bool(self.task[0] >= 2)}

    result = evaluate_adaptation(Counter(), Telling, [[1.0, 2.0], [3.0, 2.0]], n_episodes=3, max_envs=2)
    assert result.labels == ["gain 1", "gain 3"] and result.success_rates().tolist() == [0.0, 1.0]
    silent = evaluate_adaptation(Counter(), GainEnv, [[1.0, 2.0]], n_episodes=1)
    assert silent.names is None and silent.successes is None

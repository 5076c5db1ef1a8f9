"""Whole episodes are returned as they were: where they led, where they ended, nothing of the next episode."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_bruno.evaluation.episodes import pad_episodes, play_episodes


class CountEnv(gym.Env[Any, NDArray[np.float32]]):
    """Shows the step's number and the task, which is the number of steps; pays ten times the step's number."""

    action_space = Box(-np.inf, np.inf, (1,))

    def __init__(self, key: str | None = None, inner_length: int = 1_000) -> None:
        own = Box(-np.inf, np.inf, (2,))
        self.key, self.inner_length = key, inner_length
        self.observation_space = own if key is None else Dict({key: own})

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.task = np.array((options or {}).get("task", [1_000.0]), dtype=np.float32)
        self.steps = self.inner_steps = 0
        return self._observed(), {"task": self.task}

    def step(self, action: NDArray[np.float32]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.steps, self.inner_steps = self.steps + 1, self.inner_steps + 1
        info = {"task": self.task}
        over = self.steps >= self.task[0]
        if self.inner_steps == self.inner_length and not over:  # a trial's next episode begins
            info["trial_final_observation"] = np.array([self.inner_steps, *self.task], dtype=np.float32)
            self.inner_steps = 0
        return self._observed(), 10.0 * self.steps, over, False, info

    def _observed(self) -> Any:
        own = np.array([self.inner_steps, *self.task], dtype=np.float32)
        return own if self.key is None else {self.key: own}


class Double:
    """Returns twice the number of steps that it observes, in an array or a Dict."""

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = False
    ) -> tuple[NDArray[Any], None]:
        seen = next(iter(observation.values())) if isinstance(observation, dict) else observation
        return 2 * seen[:, :1], None


@pytest.mark.parametrize("max_envs", [1, 2, 64])
@pytest.mark.parametrize("key", [None, "observation"])
def test_every_transition_is_recorded_and_no_other(key: str | None, max_envs: int) -> None:
    tasks = [[3.0], [1.0]]
    recorded = play_episodes(Double(), lambda: CountEnv(key), tasks, n_episodes=2, max_envs=max_envs)
    assert [len(of_task) for of_task in recorded] == [2, 2]
    for (length,), of_task in zip(tasks, recorded, strict=True):
        for episode in of_task:
            steps = np.arange(length)
            np.testing.assert_array_equal(episode.observations, np.stack([steps, np.full_like(steps, length)], axis=1))
            np.testing.assert_array_equal(episode.actions, 2 * steps[:, None])
            np.testing.assert_array_equal(episode.rewards, 10 * (steps + 1))
            np.testing.assert_array_equal(episode.next_observations[:, 0], steps + 1)  # the terminal one too


def test_within_a_trial_a_transition_leads_to_where_the_inner_episode_ended() -> None:
    ((episode,),) = play_episodes(Double(), lambda: CountEnv("observation", 2), [[5.0]], n_episodes=1)
    np.testing.assert_array_equal(episode.observations[:, 0], [0, 1, 0, 1, 0])
    np.testing.assert_array_equal(episode.next_observations[:, 0], [1, 2, 1, 2, 1])
    np.testing.assert_array_equal(episode.inner_ends, [False, True, False, True, False])


def test_a_dict_without_an_observation_is_run_all_the_same() -> None:
    ((episode,),) = play_episodes(Double(), lambda: CountEnv("other"), [[4.0]], n_episodes=1)
    assert episode.observations.shape == episode.next_observations.shape == (4, 0)
    np.testing.assert_array_equal(episode.rewards, [10, 20, 30, 40])


def test_the_model_sees_normalised_observations_and_the_record_does_not() -> None:
    training = VecNormalize(DummyVecEnv([CountEnv]))
    training.obs_rms.mean, training.obs_rms.var = np.array([1.0, 0.0]), np.array([4.0, 1.0])
    ((episode,),) = play_episodes(Double(), CountEnv, [[3.0]], n_episodes=1, vec_normalize=training)
    np.testing.assert_array_equal(episode.observations[:, 0], [0, 1, 2])
    np.testing.assert_allclose(episode.actions[:, 0], [-1, 0, 1], atol=1e-6)


def test_short_episodes_are_padded() -> None:
    padded = pad_episodes([np.ones((1, 2), np.float32), np.zeros((3, 2), np.float32)])
    assert padded.dtype == np.float32
    np.testing.assert_array_equal(padded[0], [[1, 1], [np.nan] * 2, [np.nan] * 2])
    np.testing.assert_array_equal(padded[1], np.zeros((3, 2)))

"""Videos are written on a machine without a display."""

import os

import gymnasium as gym
import pytest
from gymnasium.wrappers import RecordVideo

import sb3_bruno_envs  # noqa: F401  # registers the ids


@pytest.mark.parametrize(
    "env_id",
    [
        "PointDir-v0",
        "PointGoal-v0",
        "PointRotation-v0",
        "CartpoleSwingUp-v0",
        "SparsePointGoal-v0",
        "Wind-v0",
        pytest.param("CheetahDir-v0", marks=pytest.mark.mujoco),
    ],
)
def test_an_episode_becomes_a_video(env_id, tmp_path, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", os.environ.get("MUJOCO_GL", "egl"))
    env = RecordVideo(gym.make(env_id, render_mode="rgb_array", max_episode_steps=5), str(tmp_path), lambda _: True)
    env.reset(seed=0)
    for _ in range(5):
        env.step(env.action_space.sample())
    env.close()
    (video,) = tmp_path.glob("*.mp4")
    assert video.stat().st_size > 500

"""A video shows the env under each task, and the belief as it moves."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from moviepy import VideoFileClip

from sb3_bruno import BrunoSAC
from sb3_bruno.plotting.video import film_tasks
from sb3_bruno_envs import POINT_DIR_TASKS


class OddlyNamed(gym.Wrapper):
    """Calls its task by half of a formula, on two lines."""

    def reset(self, **kwargs):
        observation, info = super().reset(**kwargs)
        return observation, info | {"task_name": "$a_{ $\n" + 80 * "x"}


def test_a_video_draws_the_belief_under_each_task(tmp_path):
    model = BrunoSAC("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)
    make_env = partial(gym.make, "PointDir-v0", render_mode="rgb_array")
    tasks = POINT_DIR_TASKS.tasks("test")
    film_tasks(model, make_env, tasks, tmp_path / "two.mp4")
    two = VideoFileClip(tmp_path / "two.mp4")
    film_tasks(model, lambda: OddlyNamed(make_env()), tasks[:1], tmp_path / "one.mp4")
    one = VideoFileClip(tmp_path / "one.mp4")
    assert (two.n_frames, two.fps) == (30, 10) and two.size[0] == 2 * one.size[0]
    first, last = two.get_frame(0).astype(int), two.get_frame(2.8).astype(int)
    height = two.size[1]
    assert np.abs(first - last)[: height // 2].max() > 50  # the point moved
    assert np.abs(first - last)[height // 2 :].max() > 50  # so did the cursor over the belief
    with pytest.raises(ValueError, match="5 tasks"):
        film_tasks(model, make_env, np.zeros((5, 2)), tmp_path / "five.mp4")
    with pytest.raises(ValueError, match="rgb_array"):
        film_tasks(model, partial(gym.make, "PointDir-v0"), tasks, tmp_path / "none.mp4")

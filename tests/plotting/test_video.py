"""A film shows the env, the hidden task, and what the agent takes it for, before and after the task switches."""

from functools import partial
from types import SimpleNamespace

import gymnasium as gym
import imageio_ffmpeg
import numpy as np
import pytest

from sb3_bruno import BrunoSAC, RecurrentSAC
from sb3_bruno.plotting.film import SIZE, FilmFigure, Moment
from sb3_bruno.plotting.reading import Reading, read_task
from sb3_bruno.plotting.video import farthest_pair, film_adaptation, film_length
from sb3_bruno_envs import POINT_DIR_TASKS

TASKS = POINT_DIR_TASKS.tasks("test")
make_env = partial(gym.make, "sb3_bruno_envs:PointDir-v0", render_mode="rgb_array")


@pytest.fixture(scope="module")
def model():
    return BrunoSAC("MlpPolicy", "sb3_bruno_envs:PointDir-v0", seed=0)


class Watched(gym.Wrapper):
    """Remembers the task of every step, and calls it by half of a formula."""

    seen = ()

    def step(self, action):
        *step, info = super().step(action)
        Watched.seen = (*Watched.seen, tuple(info["task"]))
        return *step, info | {"task_name": "$a_{ $"}


def frames_of(path):
    """Decode a film, (n, height, width, 3), and its frames per second."""
    reader = imageio_ffmpeg.read_frames(path)
    about = next(reader)
    return np.stack([np.frombuffer(frame, np.uint8).reshape(*SIZE[::-1], 3) for frame in reader]), about["fps"]


def test_a_film_in_both_formats_switches_the_task_once(model, tmp_path):
    Watched.seen = ()
    files = tmp_path / "two.mp4", tmp_path / "two.gif"
    film_adaptation(model, lambda: Watched(make_env()), TASKS, *files, seconds=3.0)
    assert Watched.seen == (*[tuple(TASKS[0])] * 15, *[tuple(TASKS[1])] * 15)
    for film in files:
        frames, fps = frames_of(film)
        assert (len(frames), fps) == (120, 10)  # 30 steps, all in slow motion
        early, late = frames[20].astype(int), frames[110].astype(int)
        left = slice(0, SIZE[1] - 56)
        assert np.abs(early - late)[60:, left].max() > 100  # the point moved
        assert np.abs(early - late)[60:, SIZE[1] :].max() > 100  # and the lines grew
    assert model.policy.forget_threshold is None


def test_fast_steps_share_a_frame(model, tmp_path):
    env = gym.make("sb3_bruno_envs:CartpoleSwingUp-v0", render_mode="rgb_array", max_episode_steps=24)
    agent = BrunoSAC("MlpPolicy", "sb3_bruno_envs:CartpoleSwingUp-v0", seed=0)
    task = env.get_wrapper_attr("task_distribution").tasks("test")[:1]
    film_adaptation(agent, lambda: env, task, tmp_path / "one.mp4")
    frames, fps = frames_of(tmp_path / "one.mp4")
    assert (len(frames), fps) == (21, 25)  # of 100 steps a second: 20 in slow motion, and 4 more


@pytest.mark.parametrize(("n_tasks", "steps"), [(1, 200), (2, 180), (9, 180)])
def test_a_film_has_as_many_steps_as_its_time_allows(n_tasks, steps):
    env = gym.make("sb3_bruno_envs:PointDir-v0", max_episode_steps=200)
    assert film_length(env, n_tasks, 300) == steps
    with pytest.raises(ValueError, match="201 tasks for an episode of 200 steps"):
        film_length(env, 201, 300)


def test_what_cannot_be_filmed_is_refused(model, tmp_path):
    film = tmp_path / "x.mp4"
    with pytest.raises(ValueError, match="rgb_array"):
        film_adaptation(model, partial(gym.make, "PointDir-v0"), TASKS, film)
    with pytest.raises(ValueError, match=r"shape \(2,\)"):
        film_adaptation(model, make_env, TASKS[0], film)
    for files in ([], [tmp_path / "x.avi"]):
        with pytest.raises(ValueError, match=r"end in \.mp4 or \.gif"):
            film_adaptation(model, make_env, TASKS, *files)
    with pytest.raises(ValueError, match="cannot switch: wrap it in MetaTask, or give 1"):
        film_adaptation(model, partial(gym.make, "Pendulum-v1", render_mode="rgb_array"), TASKS, film)
    with pytest.raises(ValueError, match="read-out"):
        film_adaptation(RecurrentSAC("MlpPolicy", "PointDir-v0", task_readout=False, seed=0), make_env, TASKS, film)
    assert list(tmp_path.iterdir()) == []


def test_the_two_tasks_that_differ_most_are_chosen():
    assert farthest_pair([[3.0], [1.0], [9.0], [4.0]]).tolist() == [[1.0], [9.0]]
    assert farthest_pair([[3.0]]).tolist() == [[3.0]]


def reading_of(probabilities):
    """Read an agent that has a read-out, of two tasks or of any speed."""
    labels = SimpleNamespace(names=("speed",), units=("m/s",), tasks=("forward", "backward") if probabilities else ())
    estimate = SimpleNamespace(
        mean=np.float32([[1.9]]),
        std=np.float32([[0.1]]),
        tasks=np.float32([[0.0], [1.0]]) if probabilities else None,
        probabilities=np.float32([[0.75, 0.25]]) if probabilities else None,
        labels=labels,
    )
    agent = SimpleNamespace(
        policy=SimpleNamespace(readout="a module"),
        task_estimate=lambda state: estimate,
        task_space=gym.spaces.Box(0.0, 3.0, (1,)),
    )
    return read_task(agent, None)


def test_a_readout_is_read_as_probabilities_where_tasks_are_few_else_in_the_tasks_units():
    few, any_speed = reading_of(True), reading_of(False)
    assert few.values.tolist() == [0.75, 0.25] and few.names == ("forward", "backward") and not few.is_task
    assert any_speed.about == "speed, m/s: mean and std" and any_speed.is_task and any_speed.bounds == (0.0, 3.0)
    np.testing.assert_allclose([any_speed.values, any_speed.spread], [[1.9], [0.1]], rtol=1e-6)


def test_lines_grow_and_are_named_where_they_end():
    image, task = np.zeros((8, 8, 3), np.uint8), np.zeros(1)
    reading = Reading(np.array([0.5, 0.5]), np.zeros(2), ("forward", "backward"), "probability", bounds=(0.0, 1.0))
    moments = [
        Moment(image, reading._replace(values=np.array([p, 1 - p])), "forward", task, p, p, True) for p in (0.5, 0.9)
    ]
    figure = FilmFigure(moments[0], 2, [1], 4)
    for n_drawn, moment in enumerate(moments, start=1):
        frame = figure.draw(moment)
        assert all(len(line.get_xdata()) == n_drawn for line in figure.lines)
        heights = [label.get_position()[1] for label in figure.labels]
        assert abs(heights[0] - heights[1]) > 0.05
    assert frame.shape == (*SIZE[::-1], 3)
    assert figure.said.get_text() == "0.9 m/s" and figure.arrow.get_visible()
    assert figure.title.get_color() == figure.colors[0]

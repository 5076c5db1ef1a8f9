"""Films an agent that finds out its hidden task, and finds it out again after the task has switched."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders import Predicts
from sb3_bruno.evaluation.progress import progress
from sb3_bruno.evaluation.told import task_name
from sb3_bruno.plotting.encode import Frame, check_formats, video_files
from sb3_bruno.plotting.film import SIZE, FilmFigure, Moment
from sb3_bruno.plotting.reading import check_readable, read_task
from sb3_bruno.task_names import task_title

SLOW_STEPS = 20
"""So many steps of each task are in slow motion, in which the agent finds it out."""

SLOW = 4
"""How many times slower that is."""

_MOST_FPS = 25  # an env with more steps per second is not shown in all of them


def film_adaptation(
    model: TaskInference,
    make_env: Callable[[], gym.Env[Any, Any]],
    tasks: ArrayLike,
    *paths: str | Path,
    seconds: float = 15.0,
    forget_threshold: float = 10.0,
    seed: int = 0,
    vec_normalize: VecNormalize | None = None,
    progress_bar: bool = False,
) -> None:
    """Film one episode in which the hidden task goes from each of ``tasks`` to the next; the agent is deterministic.

    Every task has as many steps, the first 20 of them in slow motion. Beside the image is drawn what the agent has
    taken the task for so far: its read-out of the task, or its belief if it has none. Frames go to the files as they
    are made.

    Args:
        model: the agent. For the film it forgets, if its encoder can notice that a task switched.
        make_env: makes an environment with ``render_mode="rgb_array"`` that takes its task at reset.
        tasks: ``(n_tasks, task_dim)``. Several need an environment in a MetaTask.
        *paths: the files to write, all of the same film, each .mp4 or .gif.
        seconds: how long the film is, unless the episode ends before.
        forget_threshold: nats; that of an agent that has one is kept.
        seed: of the environment.
        vec_normalize: the VecNormalize of training. Its statistics normalise the observations and stay as they are.
        progress_bar: show one, where stderr is a terminal.

    Raises:
        ValueError: if there are no tasks, a path has another suffix, the environment renders no images or cannot switch
            its task, or the agent has neither a read-out nor a posterior to draw.
    """
    files = [Path(path) for path in paths]
    check_formats(files)
    check_readable(model)
    task_array = np.asarray(tasks, dtype=np.float32)
    if task_array.ndim != 2 or len(task_array) == 0:
        raise ValueError(f"tasks have shape {task_array.shape}: give at least one, as an array (n_tasks, task_dim).")
    env = make_env()
    try:
        _check_env(env, len(task_array))
        env_fps = float(env.metadata.get("render_fps", 30))
        n_steps = film_length(env, len(task_array), seconds * env_fps)
        starts = [n_steps * i // len(task_array) for i in range(len(task_array))]
        with _forgetting(model, forget_threshold):
            moments = _moments(model, env, dict(zip(starts, task_array, strict=True)), n_steps, seed, vec_normalize)
            shown = progress(moments, shown=progress_bar, total=n_steps, about="film")
            _write(shown, files, env_fps, n_steps, starts[1:])
    finally:
        env.close()


def farthest_pair(tasks: ArrayLike) -> NDArray[np.float32]:
    """Choose the two tasks that differ most, ``(2, task_dim)``, in the order of the list; the one if there is one."""
    array = np.asarray(tasks, dtype=np.float32)
    distances = np.linalg.norm(array[:, None] - array[None], axis=-1)
    pair = np.unravel_index(distances.argmax(), distances.shape)
    chosen: NDArray[np.float32] = array[np.unique(pair)]
    return chosen


def _check_env(env: gym.Env[Any, Any], n_tasks: int) -> None:
    """Refuse an environment that cannot be filmed."""
    if env.render_mode != "rgb_array":
        raise ValueError(f"make_env made an env with render_mode={env.render_mode!r}: use 'rgb_array'.")
    if n_tasks > 1 and not env.has_wrapper_attr("switch_task"):
        raise ValueError(f"tasks holds {n_tasks} tasks, and make_env's cannot switch: wrap it in MetaTask, or give 1.")


def film_length(env: gym.Env[Any, Any], n_tasks: int, n_at_full_speed: float) -> int:
    """Count the steps that a film shows: a step in slow motion takes the time of several.

    Raises:
        ValueError: if an episode has fewer steps than there are tasks.
    """
    n_steps = max(int(n_at_full_speed) - n_tasks * SLOW_STEPS * (SLOW - 1), n_tasks * SLOW_STEPS)
    if env.has_wrapper_attr("_max_episode_steps"):  # Gymnasium's TimeLimit
        n_steps = min(n_steps, int(env.get_wrapper_attr("_max_episode_steps")))
    if n_tasks > n_steps:
        raise ValueError(f"tasks holds {n_tasks} tasks for an episode of {n_steps} steps: give fewer.")
    return n_steps


@contextmanager
def _forgetting(model: TaskInference, threshold: float) -> Iterator[None]:
    """Let an agent forget that can and does not, for the length of the block."""
    before = model.policy.forget_threshold
    if before is None and isinstance(model.encoder, Predicts):
        model.policy.forget_threshold = threshold
    try:
        yield
    finally:
        model.policy.forget_threshold = before


def _moments(
    model: TaskInference,
    env: gym.Env[Any, Any],
    tasks: dict[int, NDArray[np.float32]],
    n_steps: int,
    seed: int,
    normalize: VecNormalize | None,
) -> Iterator[Moment]:
    """Play the episode; ``tasks`` holds each task by the step that it begins with."""
    observation, info = env.reset(seed=seed, options={"task": tasks[0]})
    state, reward, over, began = None, float("nan"), False, 0
    for step in range(n_steps):
        if over:
            return
        if step > 0 and step in tasks:
            env.get_wrapper_attr("switch_task")(tasks[step])
        began = step if step in tasks else began
        image = np.asarray(env.render(), dtype=np.uint8)
        seen = observation if normalize is None else normalize.normalize_obs(observation)
        action, state = model.predict(seen, state, deterministic=True)
        assert state is not None  # for mypy: a Dict was given
        velocity = _velocity(info, at_rest=step == 0)
        observation, paid, terminated, truncated, info = env.step(action)
        title = task_name(info) or task_title(tasks[began])
        is_slow = step - began < SLOW_STEPS
        task = tasks[began].astype(float)
        yield Moment(image, read_task(model, state), title, task, velocity, reward, is_slow)
        reward, over = float(paid), terminated or truncated


def _velocity(info: dict[str, Any], *, at_rest: bool) -> float | None:
    """Read the velocity along the only way there is, m/s; None where the env tells none, or one of a plane."""
    if "y_velocity" in info or ("x_velocity" not in info and not at_rest):
        return None
    return float(info.get("x_velocity", 0.0))


def _write(moments: Iterator[Moment], files: list[Path], env_fps: float, n_steps: int, switches: list[int]) -> None:
    """Draw the moments and write them at the env's own pace, or slower where they are in slow motion."""
    fps = min(env_fps, _MOST_FPS)
    figure, due, n_written = None, 0.0, 0  # due: seconds of the film
    with video_files(files, fps, SIZE) as write:
        for moment in moments:
            figure = figure or FilmFigure(moment, n_steps, switches, SLOW)
            frame: Frame = figure.draw(moment)
            due += (SLOW if moment.is_slow else 1) / env_fps
            while n_written < round(due * fps):
                write(frame)
                n_written += 1

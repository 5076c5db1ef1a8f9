"""Makes a video of an agent on several tasks side by side, with its belief drawn under each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray
from stable_baselines3.common.vec_env import VecNormalize

from sb3_bruno.algorithms.beliefs import TaskBelief
from sb3_bruno.algorithms.task_inference import TaskInference
from sb3_bruno.encoders import HasPosterior
from sb3_bruno.encoders.abilities import check_ability
from sb3_bruno.evaluation.progress import progress
from sb3_bruno.evaluation.task_names import FEW_TASKS, task_labels, task_title
from sb3_bruno.evaluation.told import task_name
from sb3_bruno.plotting.style import as_text

Frames = list[NDArray[np.uint8]]

_WIDEST_TITLE = 40  # characters above an image; more take a second line


class Filmed(NamedTuple):
    """One episode: what the environment calls its task, and the image and the belief at each step."""

    name: str
    frames: Frames
    beliefs: list[TaskBelief]


def film_tasks(
    model: TaskInference,
    make_env: Callable[[], gym.Env[Any, Any]],
    tasks: ArrayLike,
    path: str | Path,
    *,
    seed: int = 0,
    vec_normalize: VecNormalize | None = None,
    progress_bar: bool = False,
) -> None:
    """Film one episode of each task; the agent acts deterministically.

    Args:
        model: the agent.
        make_env: makes an environment with ``render_mode="rgb_array"`` that takes its task at reset.
        tasks: one to four tasks, ``(n_tasks, task_dim)``.
        path: the video to write; its suffix chooses the format, such as .mp4.
        seed: of the environments, the same for every task.
        vec_normalize: the VecNormalize of training. Its statistics normalise the observations and stay as they are.
        progress_bar: show one, where stderr is a terminal.

    Raises:
        ValueError: if there are no tasks or more than four, the environment renders no images, or the encoder has no
            posterior to draw.
    """
    from moviepy import ImageSequenceClip

    check_ability(model.encoder, HasPosterior, "A video of beliefs")
    task_array = np.asarray(tasks, dtype=np.float32)
    if not 1 <= len(task_array) <= FEW_TASKS:
        raise ValueError(f"tasks holds {len(task_array)} tasks: give 1 to {FEW_TASKS}.")
    envs = [make_env() for _ in task_array]
    fps = envs[0].metadata.get("render_fps", 30)
    episodes = [_episode(model, env, task, seed, vec_normalize) for env, task in zip(envs, task_array, strict=True)]
    titles = list(map(task_title, task_labels(task_array, [episode.name for episode in episodes])))
    frames = _draw(titles, episodes, progress_bar)
    ImageSequenceClip(frames, fps=fps).write_videofile(str(path), logger=None)


def _episode(
    model: TaskInference, env: gym.Env[Any, Any], task: NDArray[np.float32], seed: int, normalize: VecNormalize | None
) -> Filmed:
    """Play one episode."""
    if env.render_mode != "rgb_array":
        raise ValueError(f"make_env made an env with render_mode={env.render_mode!r}: use 'rgb_array'.")
    frames, beliefs = [], []
    observation, info = env.reset(seed=seed, options={"task": task})
    state, over = None, False
    while not over:
        frames.append(np.asarray(env.render(), dtype=np.uint8))
        seen = observation if normalize is None else normalize.normalize_obs(observation)
        action, state = model.predict(seen, state, deterministic=True)
        assert state is not None  # for mypy: a Dict was given
        beliefs.append(model.belief(state))
        observation, _, terminated, truncated, _ = env.step(action)
        over = terminated or truncated
    env.close()
    return Filmed(task_name(info), frames, beliefs)


def _draw(titles: list[str], episodes: list[Filmed], progress_bar: bool) -> Frames:
    """Draw the episodes side by side, one image per step; an episode that ended early keeps its last image."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    length = max(len(episode.frames) for episode in episodes)
    figure = Figure(figsize=(3.2 * len(episodes), 4.0), dpi=100, layout="tight")
    canvas = FigureCanvasAgg(figure)
    panels = figure.subplots(2, len(episodes), squeeze=False, height_ratios=(3, 2), sharey="row")
    images, cursors = [], []
    for column, (title, (_, frames, beliefs)) in enumerate(zip(titles, episodes, strict=True)):
        picture, chart = panels[0, column], panels[1, column]
        picture.set_axis_off()
        picture.set_title(fill(as_text(title), _WIDEST_TITLE), fontsize=9)
        images.append(picture.imshow(frames[0]))
        mean = np.concatenate([belief.mean for belief in beliefs])  # (steps, latent_dim)
        spread = np.sqrt(np.concatenate([belief.var for belief in beliefs]))
        for line, width in zip(mean.T, spread.T, strict=True):
            (drawn,) = chart.plot(line, linewidth=1)
            chart.fill_between(np.arange(len(line)), line - width, line + width, color=drawn.get_color(), alpha=0.2)
        cursors.append(chart.axvline(0, color="#404040", linewidth=1))
        chart.set_xlim(0, max(length - 1, 1))
        chart.set_xlabel("env step", fontsize=8)
        chart.tick_params(labelsize=7)
        if column == 0:
            chart.set_ylabel("belief, mean and std", fontsize=8)
    drawn_frames: Frames = []
    for step in progress(range(length), shown=progress_bar, about="frames"):
        for image, cursor, (_, frames, _) in zip(images, cursors, episodes, strict=True):
            at = min(step, len(frames) - 1)
            image.set_data(frames[at])
            cursor.set_xdata([at, at])
        canvas.draw()
        drawn_frames.append(np.asarray(canvas.buffer_rgba())[..., :3].copy())
    return drawn_frames

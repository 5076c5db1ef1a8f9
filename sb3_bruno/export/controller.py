"""Runs an exported agent: observation and reward in, action out. Knows NumPy and onnxruntime alone."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import ArrayLike, NDArray

from sb3_bruno.task_words import TaskEstimate, TaskLabels

METADATA = "sb3_bruno"
FORMAT = 1
NEW_TASK, NEW_EPISODE, GOES_ON = 1.0, 0.5, 0.0  # what the step's `episode_start` says
LARGEST = 1e9  # as in ``predict``: the square of more is infinite in float32
GIVE = "give the .onnx file that `model.export` wrote"


class Controller:
    """Carries an exported agent's belief from step to step.

    Args:
        path: the ``.onnx`` file that ``model.export`` wrote.
        seed: of the noise of an encoder that samples, 0 or more. None: a random one; other agents draw nothing.
        n_threads: of onnxruntime, 1 or more. One is fastest for networks of this size, and leaves the others alone.

    Attributes:
        path: the file.
        metadata: what the file says of itself: who made it, shapes and bounds, names and units.
        observation_shape: of what ``act`` takes.
        action_low: the least of each action, in the shape of an action.
        action_high: the greatest, likewise.
        surprise: of the last step, in nats: how much less the belief expected it than one that knows nothing of the
            task. Below 0 where the belief is right, far above where the task is another, 0 where an episode begins;
            None if the agent predicts nothing.

    Raises:
        ValueError: if the file is no agent exported by this package, or by a later version of it; or ``seed`` or
            ``n_threads`` is no such number.

    Example:
        >>> controller = Controller("agent.onnx")
        >>> action = controller.act(observation)  # the first of a task
        >>> action = controller.act(observation, reward)
        >>> print(controller.task_estimate())
    """

    def __init__(self, path: str | Path, *, seed: int | None = None, n_threads: int = 1) -> None:
        if not isinstance(path, str | os.PathLike):
            raise ValueError(f"`path={path!r}` is no path: {GIVE}.")
        if seed is not None and not _is_count(seed, 0):
            raise ValueError(f"`seed={seed!r}` is no whole number of 0 or more: give one, or None for a random one.")
        if not _is_count(n_threads, 1):
            raise ValueError(f"`n_threads={n_threads!r}` is no positive whole number: give 1, or more cores.")
        self.path, self._n_threads = Path(path).absolute(), n_threads
        self._session = _open(self.path, n_threads)
        self.metadata = _read_metadata(self._session, path)
        self._outputs = self.metadata["outputs"]
        try:
            self.observation_shape = tuple(self.metadata["observation"]["shape"])
            shape = self.metadata["action"]["shape"]
            self.action_low = np.array(self.metadata["action"]["low"], np.float32).reshape(shape)
            self.action_high = np.array(self.metadata["action"]["high"], np.float32).reshape(shape)
            self._inputs = {name: np.zeros(size, np.float32) for name, size in self.metadata["inputs"].items()}
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise ValueError(f"`path={str(path)!r}` describes itself wrongly ({error!r}): {GIVE}.") from error
        self.surprise: float | None = None
        self._generator = np.random.default_rng(seed)
        self._told: dict[str, NDArray[np.float32]] = {}
        self.reset()

    def reset(self) -> None:
        """Begin a new task: forget everything. The next ``act`` is its first, and reads no reward."""
        self._begin(NEW_TASK)

    def start_episode(self) -> None:
        """Begin another episode of the same task, as a ``Trial`` does: the next ``act`` absorbs no transition."""
        self._begin(max(NEW_EPISODE, float(self._inputs["episode_start"][0, 0])))

    def act(self, observation: ArrayLike, reward: float = 0.0, action: ArrayLike | None = None) -> NDArray[np.float32]:
        """Choose an action, after learning from what the last one led to.

        Args:
            observation: in the env's own shape or flat, and in its own units. Of a Dict or Tuple, the flat vector that
                ``gymnasium.spaces.flatten`` makes of it.
            reward: what the last action earned.
            action: what was done since the last call, if that was not what the last call returned.

        Returns:
            The action, in the env's shape and units.

        Raises:
            ValueError: if something has another shape, or is not finite.
        """
        inputs = self._inputs
        inputs["observation"] = _read("observation", observation, inputs["observation"].shape, self.observation_shape)
        inputs["reward"] = _read("reward", reward, inputs["reward"].shape, ())
        if action is not None:
            inputs["action"] = _read("action", action, inputs["action"].shape, self.action_low.shape)
        told = dict(zip(self._outputs, self._session.run(self._outputs, inputs), strict=True))
        chosen: NDArray[np.float32] = told["next_action"]
        if not np.isfinite(chosen).all():
            raise ValueError(
                f"The agent's action is {chosen.ravel().tolist()}: `reset` it, and look at what it saw last."
            )
        inputs["action"], inputs["memory"] = chosen, told["next_memory"]
        inputs["episode_start"] = np.full((1, 1), GOES_ON, np.float32)
        self._told = told
        self.surprise = float(told["surprise"][0, 0]) if "surprise" in told else None
        return chosen.reshape(self.action_low.shape).copy()

    def task_estimate(self) -> TaskEstimate:
        """Tell what the agent takes the task for, after the last ``act``: mean and spread, and probabilities of few.

        Raises:
            ValueError: if the agent was exported without a read-out, or has not acted since ``reset``.
        """
        task = self.metadata["task"]
        if task is None:
            raise ValueError("The agent has no read-out of the task: export one that was trained with `task_readout`.")
        if not self._told:
            raise ValueError("The agent has not acted since its reset: call `act` first.")
        probabilities = self._told.get("task_probabilities")
        return TaskEstimate(
            self._told["task_mean"][0],
            self._told["task_std"][0],
            None if task["tasks"] is None else np.array(task["tasks"], np.float32),
            None if probabilities is None else probabilities[0],
            TaskLabels(tuple(task["names"]), tuple(task["units"]), tuple(task["task_names"])),
        )

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the session, which opens the file anew where a copy goes."""
        return {name: value for name, value in vars(self).items() if name != "_session"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._session = _open(self.path, self._n_threads)

    def _begin(self, start: float) -> None:
        inputs = self._inputs
        inputs["episode_start"] = np.full((1, 1), start, np.float32)
        inputs["action"] = np.zeros_like(inputs["action"])
        if "noise" in inputs:
            inputs["noise"] = np.asarray(self._generator.standard_normal(inputs["noise"].shape), np.float32)
        if start == NEW_TASK:
            self.surprise, self._told = None, {}


def _is_count(given: object, least: int) -> bool:
    return isinstance(given, int | np.integer) and not isinstance(given, bool) and int(given) >= least


def _open(path: Path, n_threads: int) -> onnxruntime.InferenceSession:
    if not path.is_file():
        raise ValueError(f"`path={str(path)!r}` {'is no file' if path.exists() else 'does not exist'}: {GIVE}.")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = n_threads
    try:
        return onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own, of a file that is none of its
        raise ValueError(f"`path={str(path)!r}` cannot be run by onnxruntime: {GIVE}. ({error})") from error


def _read_metadata(session: onnxruntime.InferenceSession, path: str | Path) -> dict[str, Any]:
    kept = session.get_modelmeta().custom_metadata_map.get(METADATA)
    if kept is None:
        raise ValueError(
            f"`path={str(path)!r}` is no agent of sb3_bruno: give the .onnx file that `model.export` wrote."
        )
    try:
        metadata: dict[str, Any] = json.loads(kept)
        is_later = metadata["format"] > FORMAT
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"`path={str(path)!r}` describes itself wrongly ({error!r}): {GIVE}.") from error
    if is_later:
        raise ValueError(
            f"`path={str(path)!r}` is of format {metadata['format']}, this version of sb3_bruno reads up to {FORMAT}: "
            "install a later one."
        )
    if metadata.get("outputs") != [output.name for output in session.get_outputs()]:
        raise ValueError(f"`path={str(path)!r}` describes other outputs than it has: {GIVE}.")
    return metadata


def _read(name: str, given: ArrayLike, flat: tuple[int, ...], own: tuple[int, ...]) -> NDArray[np.float32]:
    """Lay what is given out as a row, (1, dim).

    Raises:
        ValueError: if it is neither of the env's own shape nor flat, or a number is none to act on.
    """
    try:
        array = np.asarray(given)
    except (TypeError, ValueError, RuntimeError) as error:
        raise ValueError(f"`{name}` is no array of numbers ({error}): give floats.") from error
    if isinstance(given, dict):
        raise ValueError(f"`{name}` is a dict: give the vector that `gymnasium.spaces.flatten` makes of it.")
    if array.dtype.kind not in "biuf":
        raise ValueError(f"`{name}` is of type {array.dtype}, no array of numbers: give floats.")
    if array.shape not in (own, flat[1:], flat):
        raise ValueError(f"`{name}` has shape {array.shape}, expected {own} or flat, {flat[1:]}.")
    wrong = np.flatnonzero(~(np.abs(array.ravel()) <= LARGEST))
    if len(wrong):
        raise ValueError(f"`{name}` is {array.ravel()[wrong[0]]} at index {wrong[0]}: give finite numbers up to 1e9.")
    return array.reshape(flat).astype(np.float32)

"""Says whether an environment keeps the contract that task inference rests on; knows no algorithm.

The contract: a Dict observation that shows the last transition, and a task in force that ``info`` alone names.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray

from sb3_bruno_envs.task_effect import find_entries_without_effect, find_task_without_effect
from sb3_bruno_envs.task_secrecy import SEEDS, Remark, find_leaks, start

Env: TypeAlias = gym.Env[Any, Any]

_KEYS = ("action", "episode_start", "observation", "reward")
_WRAP = "wrap the environment in TransitionObservation, above any wrapper that changes actions or rewards"


def check_meta_env(env: Env, *, max_steps: int = 1000) -> None:
    """Raise a ValueError that lists everything wrong with ``env``, each with its remedy.

    Runs one episode of random actions, about a hundred resets, and episodes of several tasks in turn. Warns of an entry
    of the task that makes no difference, and of a first observation that tells the task by the physics of the reset.

    Args:
        env: the environment as an agent gets it, with all its wrappers.
        max_steps: leave the episode after this number of steps if it has not ended.

    Raises:
        ValueError: if the environment breaks the contract.

    Example:
        >>> check_meta_env(gym.make("sb3_bruno_envs:PointDir-v0"))
    """
    if not isinstance(env, gym.Env):
        raise ValueError(
            f"env={env!r} is no Gymnasium environment: give one, such as gym.make(id), not an id or a VecEnv."
        )
    checks: dict[str, Callable[[], Iterator[str]]] = {
        "its spaces": lambda: _check_spaces(env),
        "its task space": lambda: _check_task_space(env),
        "an episode": lambda: _check_episode(env, max_steps),
        "episodes of several tasks": lambda: _check_effect(env),
        "resets with the same seed": lambda: _check_seed(env),
        "reset(options={'task': task})": lambda: _check_options(env),
        "resets with many seeds": lambda: find_leaks(env),
    }
    problems: list[str] = []
    for name, check in checks.items():
        try:
            problems.extend(check())
        except Exception as error:  # the environment is foreign code: whatever it raises is a finding
            problems.append(f"{name} raised {error!r}: make that work.")
    for remark in [problem for problem in problems if isinstance(problem, Remark)]:
        problems.remove(remark)
        warnings.warn(remark, stacklevel=2)
    if problems:
        raise ValueError("\n- ".join([f"{env} is not ready for task inference:", *problems]))


def _check_spaces(env: Env) -> Iterator[str]:
    space, actions = env.observation_space, env.action_space
    wanted = {"reward": Box(-np.inf, np.inf, (1,)), "episode_start": Box(0.0, 1.0, (1,))}
    if isinstance(actions, Box) and actions.is_bounded():
        wanted["action"] = Box(-1.0, 1.0, (int(np.prod(actions.shape)),))
    else:
        yield f"the action space is {actions}: make it a Box with finite bounds."
    if not isinstance(space, Dict):
        yield f"the observation space is {space}, no Dict: {_WRAP}."
        return
    for key in sorted(set(_KEYS) - set(space)):
        yield f"the observation has no key {key!r}: {_WRAP}."
    for key in sorted(set(space) - set(_KEYS)):
        yield f"the observation has the unknown key {key!r}: move what it shows into 'observation'."
    for key in sorted(set(space) & set(wanted)):
        if space[key] != wanted[key]:
            yield f"observation_space[{key!r}] is {space[key]}: make it {wanted[key]}."
    inner = space.get("observation", wanted["reward"])
    if not isinstance(inner, Box) or inner.dtype != np.float32:
        yield f"observation_space['observation'] is {inner}: make it a float32 Box."


def _check_task_space(env: Env) -> Iterator[str]:
    if not env.has_wrapper_attr("task_space"):
        yield "the environment has no task_space: wrap it in MetaTask."
        return
    space = env.get_wrapper_attr("task_space")
    if not isinstance(space, Box) or len(space.shape) != 1 or space.dtype != np.float32:
        yield f"task_space is {space}: make it a float32 Box of shape (dim,)."


def _check_episode(env: Env, max_steps: int) -> Iterator[str]:
    """Look at every step of an episode; report each kind of problem once, where it first appears."""
    env.action_space.seed(0)
    observation, info = env.reset(seed=0)
    task, no_action = info.get("task"), np.zeros(env.action_space.shape or ())
    found = {**_in_info(env, info, task), **_in_observation(env, observation, no_action.ravel(), 0.0, 1.0)}
    yield from (f"after the reset, {problem}" for problem in found.values())
    found, absorbs = {}, False
    for step in range(1, max_steps + 1):
        action = _nth_action(env.action_space, step)
        observation, reward, terminated, truncated, info = env.step(action)
        here = _in_info(env, info, task)
        if "trial_final_observation" in info:  # a trial's next episode begins, and what is shown beside that is free
            here |= _in_observation(env, observation, None, None, 0.5)
        else:
            here |= _in_observation(env, observation, _scaled(env.action_space, action), float(reward), 0.0)
        when = f"step {step}" + (", the episode's last" if terminated or truncated else "")
        for kind, problem in here.items():
            found.setdefault(kind, f"after {when}, {problem}")
        absorbs |= not (terminated or truncated or "trial_final_observation" in info)
        if terminated or truncated:
            break
    yield from found.values()
    if not absorbs:
        yield Remark(
            "Every (inner) episode of the one looked at ended after one step, before an action could make use of what "
            "the step showed: nothing is inferred from them, so let them be longer."
        )


def _in_info(env: Env, info: dict[str, Any], task: NDArray[np.float32] | None) -> dict[str, str]:
    """Return problems of an info by kind, in an episode whose reset named ``task``."""
    missing = [key for key in ("task", "task_index") if key not in info]
    found = {f"no {key}": f"info has no {key!r}: wrap the environment in MetaTask." for key in missing}
    if "task" in missing:
        return found
    if env.has_wrapper_attr("task_space") and info["task"] not in env.get_wrapper_attr("task_space"):
        space = env.get_wrapper_attr("task_space")
        found["foreign task"] = f"info['task'] is {info['task']!r}: make it float32 and in {space}."
    if not np.array_equal(info["task"], [] if task is None else task):
        found["changed task"] = f"info['task'] is {info['task']}, at the reset it was {task}: keep it to the last step."
    return found


def _in_observation(
    env: Env, observation: Any, action: NDArray[Any] | None, reward: float | None, start: float
) -> dict[str, str]:
    """Return problems of an observation by kind; it should show this scaled action, reward and episode start.

    An action or a reward of None is not compared.
    """
    if not isinstance(observation, dict):
        return {}  # told already, of the space
    found = {f"not finite {key}": problem for key, problem in _not_finite(observation)}
    if not found and observation not in env.observation_space:  # no space holds a NaN
        found["outside"] = "the observation is outside its space: match its keys, shapes, dtypes, bounds."
    rewards = None if reward is None else [reward]
    for key, value in (("action", action), ("reward", rewards), ("episode_start", [start])):
        shown = observation.get(key)
        if shown is None or value is None:
            continue  # a key that is missing was told already, of the space
        if np.shape(shown) != np.shape(value) or not np.allclose(shown, value, rtol=1e-4, atol=1e-5, equal_nan=True):
            found[key] = f"observation[{key!r}] is {shown} instead of {np.asarray(value)}: {_WRAP}."
    return found


def _not_finite(observation: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for key, shown in observation.items():
        if np.asarray(shown).dtype.kind == "f" and not np.isfinite(shown).all():
            yield key, f"observation[{key!r}] is {shown}, not finite: bound it, or end the episode before."


def _check_effect(env: Env) -> Iterator[str]:
    if not env.has_wrapper_attr("task_space") or "task" not in env.reset(seed=0)[1]:
        return  # told already, of task space and infos
    problem = find_task_without_effect(env)
    if problem is not None:
        yield problem
        return
    for i in find_entries_without_effect(env):
        yield Remark(f"task[{i}] alone made no difference: look whether apply_task writes what the environment reads.")


def _check_seed(env: Env) -> Iterator[str]:
    (task, first), (again, first_again) = start(env, seed=0), start(env, seed=0)
    if not np.array_equal(task, again):
        yield f"seed=0 gave the task {task}, then {again}: draw it from a generator that the reset seeds."
    if not np.array_equal(first, first_again, equal_nan=first.dtype.kind == "f"):
        yield "seed=0 gave two different first observations: draw them from self.np_random alone."


def _check_options(env: Env) -> Iterator[str]:
    """Ask for a task that the seed would not give, if there is one."""
    drawn, _ = start(env, seed=0)
    tasks = (start(env, seed)[0] for seed in SEEDS)
    wanted = next((task for task in tasks if not np.array_equal(task, drawn)), drawn)
    given = env.reset(seed=0, options={"task": wanted})[1].get("task", wanted)
    if not np.array_equal(given, wanted):
        yield f"reset(options={{'task': {wanted}}}) gave the task {given}: obey the option, as MetaTask does."


def _nth_action(space: gym.Space[Any], step: int) -> Any:
    """Return the lowest action, the highest, then random ones."""
    if isinstance(space, Box) and space.is_bounded() and step <= 2:
        return space.low.copy() if step == 1 else space.high.copy()
    return space.sample()


def _scaled(space: gym.Space[Any], action: Any) -> NDArray[np.float64] | None:
    """Scale ``action`` to [-1, 1], flat, ``(action_dim,)``; None if its space has no scale."""
    if not isinstance(space, Box) or not space.is_bounded():
        return None
    middle, half = (space.high + space.low) / 2.0, (space.high - space.low) / 2.0
    return np.ravel((np.asarray(action, dtype=np.float64) - middle) / half)

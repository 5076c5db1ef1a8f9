"""One Gymnasium id per task family, built by a function: environment, MetaTask, observation wrapper.

A function, because ``gym.make`` hands its keyword arguments to the entry point alone. All take the same ones:

- ``split``: ``"train"`` or ``"test"``;
- ``tasks``: whatever MetaTask takes; None is the family's own tasks;
- ``draw``: ``"random"``, ``"cycle"`` or ``"fixed"``, as in MetaTask;
- ``observe``: ``"transition"`` (a Dict, see TransitionObservation), ``"task"`` (the oracle's, see
  TaskObservation) or ``"plain"`` (the bare observation; the task is in ``info`` all the same);
- ``task_space``: the Box that holds every task; None is the family's own, which does not depend on ``tasks``;
- all others go to the environment, ``render_mode`` among them.

Where an episode is a trial of several (see Trial), ``n_episodes`` says of how many.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeAlias, get_args

import gymnasium as gym
from gymnasium.spaces import Box

from sb3_bruno_envs.classic.cartpole import CartpoleSwingUpEnv
from sb3_bruno_envs.classic.point_dir import PointDirEnv
from sb3_bruno_envs.classic.sparse_point_goal import SparsePointGoalEnv
from sb3_bruno_envs.mujoco.cheetah_params import CheetahParamsEnv
from sb3_bruno_envs.mujoco.half_cheetah import CheetahDirEnv, CheetahVelEnv
from sb3_bruno_envs.tasks import (
    CARTPOLE_TASKS,
    CHEETAH_DIR_TASKS,
    CHEETAH_PARAMS_TASKS,
    CHEETAH_VEL_TASKS,
    POINT_DIR_TASKS,
    SPARSE_POINT_GOAL_TASKS,
    Split,
    TaskSet,
)
from sb3_bruno_envs.wrappers.meta_task import Draw, MetaTask
from sb3_bruno_envs.wrappers.observations import TaskObservation, TransitionObservation
from sb3_bruno_envs.wrappers.trial import Trial

Observe: TypeAlias = Literal["transition", "task", "plain"]


def make_cheetah_dir(**kwargs: Any) -> gym.Env[Any, Any]:
    """The half-cheetah that should run in a hidden direction; a task is one-hot, ``(2,)``: back, forward."""
    return _make(CheetahDirEnv, CheetahDirEnv.set_task, CHEETAH_DIR_TASKS, **kwargs)


def make_cheetah_vel(**kwargs: Any) -> gym.Env[Any, Any]:
    """The half-cheetah that should run at a hidden velocity; a task is ``(1,)``, in m/s."""
    return _make(CheetahVelEnv, CheetahVelEnv.set_task, CHEETAH_VEL_TASKS, **kwargs)


def make_cartpole_swing_up(**kwargs: Any) -> gym.Env[Any, Any]:
    """The cart-pole of hidden mass and length that should swing up; a task is ``(2,)``, in kg and m."""
    return _make(CartpoleSwingUpEnv, CartpoleSwingUpEnv.set_task, CARTPOLE_TASKS, **kwargs)


def make_cheetah_params(**kwargs: Any) -> gym.Env[Any, Any]:
    """The half-cheetah of a hidden body that should run forward; a task is ``(4,)``, see CheetahParamsEnv."""
    return _make(CheetahParamsEnv, CheetahParamsEnv.set_task, CHEETAH_PARAMS_TASKS, **kwargs)


def make_point_dir(**kwargs: Any) -> gym.Env[Any, Any]:
    """The point that should move in a hidden direction; a task is ``(2,)``, a unit vector."""
    return _make(PointDirEnv, PointDirEnv.set_task, POINT_DIR_TASKS, **kwargs)


def make_sparse_point_goal(*, n_episodes: int = 3, **kwargs: Any) -> gym.Env[Any, Any]:
    """Trials of the point that should find a hidden goal; a task is ``(2,)``, the goal's position.

    The environment itself truncates an inner episode: rebuilding from a spec would take a TimeLimit for the trial's.
    """

    def make_trial(**env_kwargs: Any) -> gym.Env[Any, Any]:
        return Trial(SparsePointGoalEnv(**env_kwargs), n_episodes)

    return _make(make_trial, SparsePointGoalEnv.set_task, SPARSE_POINT_GOAL_TASKS, **kwargs)


def _make(
    make_env: Callable[..., gym.Env[Any, Any]],
    set_task: Callable[[Any, Any], None],
    family: TaskSet,
    *,
    split: Split = "train",
    tasks: Any = None,
    draw: Draw = "random",
    observe: Observe = "transition",
    task_space: Box | None = None,
    **env_kwargs: Any,
) -> gym.Env[Any, Any]:
    """The environment in MetaTask, in the observation wrapper that ``observe`` names."""
    if observe not in get_args(Observe):
        raise ValueError(f"observe={observe!r} is unknown: use 'transition', 'task' or 'plain'.")
    meta = MetaTask(
        make_env(**env_kwargs),
        set_task,
        family if tasks is None else tasks,
        split=split,
        draw=draw,
        task_space=family.space if task_space is None else task_space,
    )
    if observe == "transition":
        return TransitionObservation(meta)
    return TaskObservation(meta) if observe == "task" else meta


def register_envs() -> None:
    """Register the ids; ``gym.make`` reads the render modes off the function, so each carries them."""
    vars(make_cheetah_dir)["metadata"] = CheetahDirEnv.metadata
    vars(make_cheetah_vel)["metadata"] = CheetahVelEnv.metadata
    vars(make_cartpole_swing_up)["metadata"] = CartpoleSwingUpEnv.metadata
    vars(make_cheetah_params)["metadata"] = CheetahParamsEnv.metadata
    vars(make_point_dir)["metadata"] = PointDirEnv.metadata
    vars(make_sparse_point_goal)["metadata"] = SparsePointGoalEnv.metadata
    gym.register("CheetahDir-v0", f"{__name__}:make_cheetah_dir", max_episode_steps=200)
    gym.register("CheetahVel-v0", f"{__name__}:make_cheetah_vel", max_episode_steps=200)
    gym.register("CartpoleSwingUp-v0", f"{__name__}:make_cartpole_swing_up", max_episode_steps=200)
    gym.register("CheetahParams-v0", f"{__name__}:make_cheetah_params", max_episode_steps=200)
    gym.register("PointDir-v0", f"{__name__}:make_point_dir", max_episode_steps=30)
    gym.register("SparsePointGoal-v0", f"{__name__}:make_sparse_point_goal")  # ends itself, after n_episodes

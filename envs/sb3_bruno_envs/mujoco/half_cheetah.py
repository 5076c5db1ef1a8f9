"""Rewards Gymnasium's half-cheetah for a hidden task: a direction or a target velocity.

The physics are bit-identical to HalfCheetah-v5. The control cost is half of Gymnasium's, as usual in meta-RL.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.envs.mujoco.half_cheetah_v5 import HalfCheetahEnv
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from sb3_bruno_envs.family import Family
from sb3_bruno_envs.mujoco.exact_state import ExactState
from sb3_bruno_envs.read_task import read_numbers, read_one_hot
from sb3_bruno_envs.tasks import TaskSet


class MetaHalfCheetahEnv(ExactState, HalfCheetahEnv):
    """Rewards HalfCheetah-v5 with ``progress(x_velocity) - ctrl_cost_weight * |action|^2``.

    Subclasses say what progress is. Observations ``(17,)``, actions ``(6,)`` in [-1, 1], 0.05 s per step; an
    episode never terminates. Pickling is exact, see ExactState.

    Args:
        ctrl_cost_weight: weight of the squared torques.
        **kwargs: further keyword arguments of Gymnasium's HalfCheetahEnv.
    """

    metadata = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"]}  # noqa: RUF012  # as Gymnasium has it

    def __init__(self, *, ctrl_cost_weight: float = 0.05, **kwargs: Any) -> None:
        super().__init__(ctrl_cost_weight=ctrl_cost_weight, **kwargs)

    def progress(self, x_velocity: float) -> float:
        """Return the reward, in m/s, for running at ``x_velocity`` (m/s) in the current task."""
        raise NotImplementedError

    def _get_rew(self, x_velocity: float, action: NDArray[np.float32]) -> tuple[float, dict[str, float]]:
        forward = self.progress(x_velocity)
        control = self.control_cost(action)  # type: ignore[no-untyped-call]  # untyped in Gymnasium
        return forward - control, {"reward_forward": forward, "reward_ctrl": -control}


class CheetahDirEnv(MetaHalfCheetahEnv):
    """Rewards running in the hidden direction: ``direction * x_velocity - ctrl_cost_weight * |action|^2``."""

    direction = 1.0  # +1 forward, -1 backward

    def read_task(self, task: ArrayLike) -> float:
        """Return the direction of a one-hot task ``(2,)``: -1 of ``[1, 0]``, backward; 1 of ``[0, 1]``, forward.

        Raises:
            ValueError: if it is neither.
        """
        return (-1.0, 1.0)[read_one_hot(task, 2)]

    def set_task(self, task: ArrayLike) -> None:
        """Set the direction from a task (see ``read_task``)."""
        self.direction = self.read_task(task)

    task_entries = (("backward", ""), ("forward", ""))

    @staticmethod
    def name_task(task: ArrayLike) -> str:
        """Return ``"forward"`` or ``"backward"``."""
        backward, forward = np.asarray(task, dtype=np.float64).tolist()
        return "forward" if forward > backward else "backward"

    def progress(self, x_velocity: float) -> float:
        """Return the velocity in the hidden direction, m/s."""
        return self.direction * x_velocity


class CheetahVelEnv(MetaHalfCheetahEnv):
    """Rewards running at the hidden velocity: ``-|x_velocity - velocity| - ctrl_cost_weight * |action|^2``."""

    velocity = 1.0  # m/s

    def read_task(self, task: ArrayLike) -> NDArray[np.float64]:
        """Return the target velocity of a task ``(1,)``, in m/s.

        Raises:
            ValueError: if it is not one finite number.
        """
        return read_numbers(task, 1, "the velocity in m/s")

    def set_task(self, task: ArrayLike) -> None:
        """Set the target velocity from a task (see ``read_task``)."""
        (self.velocity,) = self.read_task(task).tolist()

    task_entries = (("velocity", "m/s"),)

    @staticmethod
    def name_task(task: ArrayLike) -> str:
        """Return the velocity."""
        return f"{np.asarray(task, dtype=np.float64).item():.5g} m/s"

    def progress(self, x_velocity: float) -> float:
        """Return minus the distance to the target velocity, m/s."""
        return -abs(x_velocity - self.velocity)


CHEETAH_DIR_TASKS = TaskSet([[1.0, 0.0], [0.0, 1.0]])
"""One-hot directions: index 0 is backward (-1), index 1 forward (+1); train and test are the same."""

CHEETAH_DIR = Family(CheetahDirEnv, CHEETAH_DIR_TASKS, max_episode_steps=200)

_VELOCITIES = np.random.RandomState(1337).uniform(0.0, 3.0, 130).round(4).reshape(-1, 1)

CHEETAH_VEL_TASKS = TaskSet(_VELOCITIES[:100], _VELOCITIES[100:], space=Box(0.0, 3.0, (1,)))
"""Target velocities in m/s, those of the BrunoSAC paper: 100 to train, 30 to test."""

_ENDS = np.random.RandomState(1337).uniform([[0.0], [3.0]], [[0.5], [3.5]], (2, 50)).reshape(-1, 1)

CHEETAH_VEL_TAVT_TASKS = TaskSet(
    _ENDS, [[0.75], [1.25], [1.75], [2.25], [2.75]], space=Box(0.0, 3.5, (1,)), train_box=Box(0.0, 3.5, (1,))
)
"""Target velocities in m/s with a gap in the middle, ``tasks="tavt"``: 50 from each of [0, 0.5] and [3, 3.5] to train.

The 5 test tasks lie in the gap. ``inside_train_box``, which knows no gaps, calls them inside. Kim et al.: *Task-Aware
Virtual Training: Enhancing Generalization in Meta-Reinforcement Learning for Out-of-Distribution Tasks* (2025), whose
training velocities are other draws from the same ranges.
"""

CHEETAH_VEL = Family(
    CheetahVelEnv, CHEETAH_VEL_TASKS, task_sets={"tavt": CHEETAH_VEL_TAVT_TASKS}, max_episode_steps=200
)

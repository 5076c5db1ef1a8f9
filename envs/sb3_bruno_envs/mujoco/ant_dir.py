"""Pays Gymnasium's ant for walking in a hidden direction: forward or backward, or any in the plane.

The physics are bit-identical to Ant-v5.
"""

from __future__ import annotations

import numpy as np

from sb3_bruno_envs.family import Family
from sb3_bruno_envs.mujoco.ant import MetaAntEnv
from sb3_bruno_envs.mujoco.hidden_direction import ALL_AROUND_TASKS, DIRECTIONS, HiddenDirection
from sb3_bruno_envs.tasks import TaskSet


class AntDirEnv(HiddenDirection, MetaAntEnv):
    """Rewards Ant-v5 with ``direction . velocity + 1 - 0.5 |action|^2 - 5e-4 |contact forces|^2``.

    A task ``(2,)`` is the direction, a unit vector. Observations ``(27,)`` without contact forces, actions ``(8,)`` in
    [-1, 1], 0.05 s per step. The episode ends when the torso leaves heights of 0.2 to 1 m, and that step does not earn
    the 1 for being alive. An ant that stands still returns about 200 in 200 steps: subtract that from any result.

    Published versions differ: "forward or backward" was in most of them two angles of -1 and +1 radians, where walking
    straight ahead earns half of the speed in either task.

    Args:
        **kwargs: keyword arguments of MetaAntEnv, such as ``terminate_when_unhealthy``.
    """


ANT_DIR_TASKS = TaskSet([[1.0, 0.0], [-1.0, 0.0]], space=DIRECTIONS)
"""Forward and backward; train and test are the same."""

_AXES, _DIAGONALS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]]), np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])

ANT_DIR_2D_TASKS = ALL_AROUND_TASKS
"""Unit vectors all around the circle: 100 to train, 30 others to test."""

ANT_DIR_2D_TAVT_4_TASKS = TaskSet(_AXES, _DIAGONALS * np.sqrt(0.5), space=DIRECTIONS)
"""``tasks="tavt-4"``, from Kim et al. (2025): the four axes to train, the four diagonals between them to test."""

ANT_DIR_2D_TAVT_2_TASKS = TaskSet(_AXES[:2], _DIAGONALS[[1, 3]] * np.sqrt(0.5), space=DIRECTIONS)
"""``tasks="tavt-2"``, from Kim et al. (2025): 0 and 90 degrees to train, 135 and 315 to test."""

ANT_DIR = Family(AntDirEnv, ANT_DIR_TASKS, max_episode_steps=200)

ANT_DIR_2D = Family(
    AntDirEnv,
    ANT_DIR_2D_TASKS,
    task_sets={"tavt-2": ANT_DIR_2D_TAVT_2_TASKS, "tavt-4": ANT_DIR_2D_TAVT_4_TASKS},
    max_episode_steps=200,
)

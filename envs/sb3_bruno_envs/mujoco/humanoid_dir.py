"""Pays Gymnasium's humanoid for walking in a hidden direction of the plane.

The physics are bit-identical to Humanoid-v5.
"""

from __future__ import annotations

from typing import Any

from gymnasium.envs.mujoco.humanoid_v5 import HumanoidEnv

from sb3_bruno_envs.family import Family
from sb3_bruno_envs.mujoco.hidden_direction import ALL_AROUND_TASKS, HiddenDirection

_EXTRAS = ("cinert", "cvel", "qfrc_actuator", "cfrc_ext")


class HumanoidDirEnv(HiddenDirection, HumanoidEnv):
    """Rewards Humanoid-v5 with ``1.25 direction . velocity + 5 - 0.1 |control|^2 - contact cost``.

    The velocity is that of the centre of mass, and the contact cost ``5e-7 |contact forces|^2``, at most 10. A task
    ``(2,)`` is the direction, a unit vector. Observations ``(45,)``: positions but for x and y, and velocities. Actions
    ``(17,)`` in [-0.4, 0.4], 0.015 s per step. The episode ends when the torso leaves heights of 1 to 2 m, and that
    step does not earn the 5 for being alive. These dominate the return, so look at ``info["velocity_in_direction"]``
    too. Published versions tell their oracles an angle, which jumps, instead of a unit vector.

    Args:
        full_observation: show inertias, velocities and forces of all bodies too, as Humanoid-v5 does: ``(348,)``.
        **kwargs: further keyword arguments of Gymnasium's HumanoidEnv.
    """

    def __init__(self, *, full_observation: bool = False, **kwargs: Any) -> None:
        shown = {f"include_{extra}_in_observation": full_observation for extra in _EXTRAS}
        super().__init__(**shown, **kwargs)


HUMANOID_DIR_TASKS = ALL_AROUND_TASKS
"""Unit vectors all around the circle: 100 to train, 30 others to test."""

HUMANOID_DIR = Family(HumanoidDirEnv, HUMANOID_DIR_TASKS, max_episode_steps=200)

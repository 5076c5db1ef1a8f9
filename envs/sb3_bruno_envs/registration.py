"""Registers families with Gymnasium; the list of ours has one line for each.

The place of a family is written as a string, ``"module:NAME"``, because Gymnasium can save only such specs as JSON.
"""

from __future__ import annotations

import importlib
from typing import Any

import gymnasium as gym

from sb3_bruno_envs.family import Family

FAMILIES = {
    "CheetahDir-v0": "sb3_bruno_envs.mujoco.half_cheetah:CHEETAH_DIR",
    "CheetahVel-v0": "sb3_bruno_envs.mujoco.half_cheetah:CHEETAH_VEL",
    "CartpoleSwingUp-v0": "sb3_bruno_envs.classic.cartpole:CARTPOLE_SWING_UP",
    "CheetahParams-v0": "sb3_bruno_envs.mujoco.cheetah_params:CHEETAH_PARAMS",
    "CheetahGravity-v0": "sb3_bruno_envs.mujoco.cheetah_gravity:CHEETAH_GRAVITY",
    "AntDir-v0": "sb3_bruno_envs.mujoco.ant_dir:ANT_DIR",
    "AntDir2D-v0": "sb3_bruno_envs.mujoco.ant_dir:ANT_DIR_2D",
    "AntGoal-v0": "sb3_bruno_envs.mujoco.ant_goal:ANT_GOAL",
    "HopperParams-v0": "sb3_bruno_envs.mujoco.hopper_params:HOPPER_PARAMS",
    "WalkerParams-v0": "sb3_bruno_envs.mujoco.walker_params:WALKER_PARAMS",
    "HumanoidDir-v0": "sb3_bruno_envs.mujoco.humanoid_dir:HUMANOID_DIR",
    "PointDir-v0": "sb3_bruno_envs.classic.point_dir:POINT_DIR",
    "PointGoal-v0": "sb3_bruno_envs.classic.point_goal:POINT_GOAL",
    "PointRotation-v0": "sb3_bruno_envs.classic.point_rotation:POINT_ROTATION",
    "SparsePointGoal-v0": "sb3_bruno_envs.classic.sparse_point_goal:SPARSE_POINT_GOAL",
    "Wind-v0": "sb3_bruno_envs.classic.wind:WIND",
}
"""The place of each id's family. A new family is a file of its own and a line here."""


def register_envs() -> None:
    """Register all of ``FAMILIES``."""
    for env_id, place in FAMILIES.items():
        register_family(env_id, place)


def register_family(env_id: str, family: str | Family) -> None:
    """Register a family under an id, so that ``gym.make(env_id)`` makes its environments.

    Args:
        env_id: the id, with its version, such as ``"PointDir-v0"``. New behaviour of an environment is a new version.
        family: the family's place, ``"module:NAME"``; or the family itself, whose specs then cannot become JSON.

    Raises:
        ValueError: if there is no family in that place.

    Example:
        >>> register_family("HoldAngle-v0", "my_envs.hold_angle:HOLD_ANGLE")
    """
    found: Any = family
    if isinstance(family, str):
        module, _, name = family.partition(":")
        found = getattr(importlib.import_module(module), name, None)
    if not isinstance(found, Family):
        raise ValueError(f"family={family!r} is {found!r}: give a Family, or its place as 'module:NAME'.")
    gym.register(env_id, family, max_episode_steps=found.max_episode_steps)

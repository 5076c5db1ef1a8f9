"""Hides the body of Gymnasium's hopper, which should hop forward.

The physics are bit-identical to Hopper-v5 at a task of zeros.
"""

from __future__ import annotations

import numpy as np
from gymnasium.envs.mujoco.hopper_v5 import HopperEnv

from sb3_bruno_envs.mujoco.body_parts import BodyParts
from sb3_bruno_envs.mujoco.body_tasks import DAMPING, FRICTION, MASS, BodyFamily, beyond, body_tasks, mass_gap
from sb3_bruno_envs.mujoco.hidden_body import HiddenBody


class HopperParamsEnv(HiddenBody, HopperEnv):
    """Rewards a hidden body with ``x_velocity + 1 - 1e-3 |action|^2``.

    A task ``(8,)`` holds log factors: of mass of torso, thigh, leg and foot, of damping of thigh, leg and foot joint,
    and of the foot's friction; with ``published=True`` ``(41,)``. Observations ``(11,)``, actions ``(3,)`` in [-1, 1],
    0.016 s per step. The episode ends when the hopper falls: below 0.7 m, or 0.2 rad from upright. It ends, too,
    when an angle or a velocity leaves [-100, 100].

    Args:
        **kwargs: keyword arguments of HiddenBody and of Gymnasium's HopperEnv.
    """

    feet = ("foot_geom",)
    parts = BodyParts(["torso", "thigh", "leg", "foot"], ["thigh", "leg", "foot"], ["foot"])
    task_entries = parts.entries()


_UNIT = np.repeat([MASS, DAMPING, FRICTION], [4, 3, 1])

HOPPER_PARAMS_TASKS = body_tasks(_UNIT, 100, 30)
"""Log factors of masses, dampings and friction, uniform: 100 to train, 30 others to test."""

HOPPER_PARAMS_PUBLISHED_TASKS = body_tasks(np.repeat([MASS, MASS, DAMPING, FRICTION], [5, 15, 6, 15]), 40, 10)
"""Tasks of ``published=True``: a log factor for each of 41 numbers, 40 to train, 10 others to test."""

HOPPER_PARAMS = BodyFamily(
    HopperParamsEnv,
    HOPPER_PARAMS_TASKS,
    task_sets={
        "beyond": beyond(_UNIT, HOPPER_PARAMS_TASKS),
        "pearl": body_tasks(_UNIT, 40, 10),  # as many as in PEARL (Rakelly et al., 2019)
        "tavt": mass_gap(_UNIT, 4),
    },
    published_tasks=HOPPER_PARAMS_PUBLISHED_TASKS,
)

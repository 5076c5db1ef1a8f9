"""Hides the body of Gymnasium's walker, which should walk forward.

The physics are bit-identical to Walker2d-v5 at a task of zeros.
"""

from __future__ import annotations

import numpy as np
from gymnasium.envs.mujoco.walker2d_v5 import Walker2dEnv

from sb3_bruno_envs.mujoco.body_parts import BodyParts
from sb3_bruno_envs.mujoco.body_tasks import DAMPING, FRICTION, MASS, BodyFamily, beyond, body_tasks, mass_gap
from sb3_bruno_envs.mujoco.hidden_body import HiddenBody

_LEGS = ["thigh", "leg", "foot", "left thigh", "left leg", "left foot"]


class WalkerParamsEnv(HiddenBody, Walker2dEnv):
    """Rewards a hidden body with ``x_velocity + 1 - 1e-3 |action|^2``.

    A task ``(15,)`` holds log factors: of mass of torso, thigh, leg and foot, left thigh, left leg and left foot, of
    damping of the six joints in the same order, and of the friction of both feet; with ``published=True`` ``(65,)``.
    Observations ``(17,)``, actions ``(6,)`` in [-1, 1], 0.016 s per step. The episode ends when the walker falls: it
    leaves heights of 0.8 to 2 m, or tilts 1 rad from upright.

    Args:
        **kwargs: keyword arguments of HiddenBody and of Gymnasium's Walker2dEnv.
    """

    feet = ("foot_geom", "foot_left_geom")
    parts = BodyParts(["torso", *_LEGS], _LEGS, ["foot", "left foot"])
    task_entries = parts.entries()


_UNIT = np.repeat([MASS, DAMPING, FRICTION], [7, 6, 2])

WALKER_PARAMS_TASKS = body_tasks(_UNIT, 100, 30)
"""Log factors of masses, dampings and frictions, uniform: 100 to train, 30 others to test."""

WALKER_PARAMS_PUBLISHED_TASKS = body_tasks(np.repeat([MASS, MASS, DAMPING, FRICTION], [8, 24, 9, 24]), 40, 10)
"""Tasks of ``published=True``: a log factor for each of 65 numbers, 40 to train, 10 others to test."""

WALKER_PARAMS = BodyFamily(
    WalkerParamsEnv,
    WALKER_PARAMS_TASKS,
    task_sets={
        "beyond": beyond(_UNIT, WALKER_PARAMS_TASKS),
        "pearl": body_tasks(_UNIT, 40, 10),  # as many as in PEARL (Rakelly et al., 2019)
        "tavt": mass_gap(_UNIT, 7),
    },
    published_tasks=WALKER_PARAMS_PUBLISHED_TASKS,
)

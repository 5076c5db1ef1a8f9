"""Prepares Gymnasium's ant for hidden tasks; knows none of them."""

from __future__ import annotations

from typing import Any

from gymnasium.envs.mujoco.ant_v5 import AntEnv

from sb3_bruno_envs.mujoco.exact_state import ExactState


class MetaAntEnv(ExactState, AntEnv):
    """Is Ant-v5 without contact forces in the observation, whose 78 numbers no task needs.

    Pickling is exact, see ExactState.

    Args:
        include_cfrc_ext_in_observation: show the contact forces too.
        **kwargs: further keyword arguments of Gymnasium's AntEnv.
    """

    def __init__(self, *, include_cfrc_ext_in_observation: bool = False, **kwargs: Any) -> None:
        super().__init__(include_cfrc_ext_in_observation=include_cfrc_ext_in_observation, **kwargs)

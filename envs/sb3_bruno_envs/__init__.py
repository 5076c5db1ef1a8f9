"""Offers Gymnasium environments with a hidden task, for meta-RL; importing the package registers them."""

from sb3_bruno_envs.checker import check_meta_env
from sb3_bruno_envs.classic.cartpole import CARTPOLE_TASKS, CartpoleSwingUpEnv
from sb3_bruno_envs.classic.point_dir import POINT_DIR_TASKS, PointDirEnv
from sb3_bruno_envs.classic.point_goal import PointGoalEnv, point_goal_tasks
from sb3_bruno_envs.classic.point_rotation import POINT_ROTATION_TASKS, PointRotationEnv
from sb3_bruno_envs.classic.sparse_point_goal import SPARSE_POINT_GOAL_TASKS, SparsePointGoalEnv
from sb3_bruno_envs.classic.wind import WIND_TASKS, WindEnv
from sb3_bruno_envs.family import Family
from sb3_bruno_envs.mujoco.ant_dir import ANT_DIR_2D_TASKS, ANT_DIR_TASKS, AntDirEnv
from sb3_bruno_envs.mujoco.ant_goal import ANT_GOAL_TASKS, AntGoalEnv
from sb3_bruno_envs.mujoco.cheetah_gravity import CHEETAH_GRAVITY_TASKS, CheetahGravityEnv
from sb3_bruno_envs.mujoco.cheetah_params import CHEETAH_PARAMS_TASKS, CheetahParamsEnv
from sb3_bruno_envs.mujoco.exact_state import ExactState
from sb3_bruno_envs.mujoco.half_cheetah import (
    CHEETAH_DIR_TASKS,
    CHEETAH_VEL_TASKS,
    CheetahDirEnv,
    CheetahVelEnv,
    MetaHalfCheetahEnv,
)
from sb3_bruno_envs.mujoco.hopper_params import HOPPER_PARAMS_TASKS, HopperParamsEnv
from sb3_bruno_envs.mujoco.humanoid_dir import HUMANOID_DIR_TASKS, HumanoidDirEnv
from sb3_bruno_envs.mujoco.physics import scale_physics
from sb3_bruno_envs.mujoco.walker_params import WALKER_PARAMS_TASKS, WalkerParamsEnv
from sb3_bruno_envs.registration import register_envs, register_family
from sb3_bruno_envs.tasks import TaskSampler, TaskSet, as_task_distribution
from sb3_bruno_envs.wrappers.hidden_goal import goal_tasks, hide_goal
from sb3_bruno_envs.wrappers.meta_task import MetaTask
from sb3_bruno_envs.wrappers.noisy_task import NoisyTaskObservation
from sb3_bruno_envs.wrappers.observations import TaskObservation, TransitionObservation
from sb3_bruno_envs.wrappers.trial import Trial

__all__ = [
    "ANT_DIR_2D_TASKS",
    "ANT_DIR_TASKS",
    "ANT_GOAL_TASKS",
    "CARTPOLE_TASKS",
    "CHEETAH_DIR_TASKS",
    "CHEETAH_GRAVITY_TASKS",
    "CHEETAH_PARAMS_TASKS",
    "CHEETAH_VEL_TASKS",
    "HOPPER_PARAMS_TASKS",
    "HUMANOID_DIR_TASKS",
    "POINT_DIR_TASKS",
    "POINT_ROTATION_TASKS",
    "SPARSE_POINT_GOAL_TASKS",
    "WALKER_PARAMS_TASKS",
    "WIND_TASKS",
    "AntDirEnv",
    "AntGoalEnv",
    "CartpoleSwingUpEnv",
    "CheetahDirEnv",
    "CheetahGravityEnv",
    "CheetahParamsEnv",
    "CheetahVelEnv",
    "ExactState",
    "Family",
    "HopperParamsEnv",
    "HumanoidDirEnv",
    "MetaHalfCheetahEnv",
    "MetaTask",
    "NoisyTaskObservation",
    "PointDirEnv",
    "PointGoalEnv",
    "PointRotationEnv",
    "SparsePointGoalEnv",
    "TaskObservation",
    "TaskSampler",
    "TaskSet",
    "TransitionObservation",
    "Trial",
    "WalkerParamsEnv",
    "WindEnv",
    "as_task_distribution",
    "check_meta_env",
    "goal_tasks",
    "hide_goal",
    "point_goal_tasks",
    "register_family",
    "scale_physics",
]

register_envs()

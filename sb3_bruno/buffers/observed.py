"""How the agent observes transitions: normalised by the VecNormalize of its env, if it has one. The one rule for it.

Rewards and actions are keys of the observation, so VecNormalize's ``norm_obs`` normalises those of its keys.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecNormalize


class TransitionArrays(NamedTuple):
    """Transitions on the host.

    Attributes:
        observations: s, shape (..., *observation_shape).
        actions: a, scaled to [-1, 1], shape (..., action_dim).
        rewards: r, shape (..., 1).
        next_observations: s', shape (..., *observation_shape).
    """

    observations: NDArray[Any]
    actions: NDArray[Any]
    rewards: NDArray[Any]
    next_observations: NDArray[Any]


class Unscaled(RunningMeanStd):
    """Statistics that leave a key of VecNormalize as it is, whatever it sees.

    Args:
        shape: the key's.
        epsilon: what VecNormalize adds to a variance.
    """

    def __init__(self, shape: tuple[int, ...], epsilon: float) -> None:
        super().__init__(shape=shape)
        self.var -= epsilon

    def update(self, arr: NDArray[Any]) -> None:
        """Learn nothing."""


def keep_flag(env: VecEnv) -> None:
    """Have every VecNormalize of an env leave ``episode_start`` as it is: a flag that is scaled says nothing any more.

    The key stays among the statistics, which SB3 copies to the VecNormalize of an evaluation.
    """
    while isinstance(env, VecEnvWrapper):
        statistics = vars(env).get("obs_rms")
        if isinstance(env, VecNormalize) and isinstance(statistics, dict) and "episode_start" in statistics:
            statistics["episode_start"] = Unscaled(statistics["episode_start"].mean.shape, env.epsilon)
        env = env.venv


def normalize(transitions: TransitionArrays, vec_normalize: VecNormalize | None) -> TransitionArrays:
    """Show transitions in the env's own units as the agent observes them; without a VecNormalize, as they are."""
    if vec_normalize is None or not vec_normalize.norm_obs:
        return transitions
    arrival = _as_observation(transitions)
    departure: Any = vec_normalize.normalize_obs({**arrival, "observation": transitions.observations})
    arrival = vec_normalize.normalize_obs(arrival)
    return TransitionArrays(departure["observation"], arrival["action"], arrival["reward"], arrival["observation"])


def unnormalize(
    rewards: NDArray[Any], next_observations: NDArray[Any], vec_normalize: VecNormalize | None
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Take rewards (..., 1) and next observations (..., *observation_shape) back to the env's own units."""
    if vec_normalize is None:
        return rewards, next_observations
    nothing = np.zeros(1)
    arrays: Any = {"observation": next_observations, "reward": rewards, "action": nothing, "episode_start": nothing}
    arrays = vec_normalize.unnormalize_obs(arrays)
    return arrays["reward"], arrays["observation"]


def _as_observation(transitions: TransitionArrays) -> Any:
    """Lay transitions out as the Dict that their ends are observed in."""
    return {
        "observation": transitions.next_observations,
        "action": transitions.actions,
        "reward": transitions.rewards,
        "episode_start": np.zeros_like(transitions.rewards, dtype=np.float32),
    }

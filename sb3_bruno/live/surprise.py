"""Measures how much better than the belief the prior would have expected a transition."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch as th
from numpy.typing import NDArray

from sb3_bruno.algorithms.carried import Carried, State
from sb3_bruno.algorithms.policies import TaskInferencePolicy
from sb3_bruno.encoders import Predicts, Transitions


@th.inference_mode()
def surprise(policy: TaskInferencePolicy, before: State, observation: Mapping[str, NDArray[Any]]) -> float | None:
    """Return the log Bayes factor of the prior against the belief, in nats, of the transition that led here.

    Below 0 where the belief expected the transition better than the prior does, far above where the task is another.
    ``forget_threshold`` is held against its cumulative sum.

    Args:
        policy: the agent's.
        before: the state that ``predict`` returned before the transition, of one environment.
        observation: what ``TransitionObservation`` shows after it, normalised as in training, without a batch.

    Returns:
        None if the encoder does not predict.
    """
    if not isinstance(policy.encoder, Predicts):
        return None
    carried = Carried.unpack(before, policy.encoder, policy.device)
    parts = (observation[key] for key in ("action", "reward", "observation"))
    action, reward, here = (
        th.as_tensor(np.reshape(part, (1, -1)), dtype=th.float32).to(policy.device) for part in parts
    )
    transition = Transitions(carried.observation, action, reward, here)
    return float(policy.encoder.log_bayes_factor(carried.memory, transition).item())

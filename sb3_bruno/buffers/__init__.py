"""Replay buffers grouped by task, whose samples carry the belief."""

from sb3_bruno.buffers.extended_obs import ExtendedObs
from sb3_bruno.buffers.task_buffer import TaskReplayBuffer

__all__ = ["ExtendedObs", "TaskReplayBuffer"]

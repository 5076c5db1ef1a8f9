"""Exact resume: checkpoints from which a training run continues as if it had never stopped."""

from sb3_bruno.resume.callback import ResumeCallback
from sb3_bruno.resume.checkpoint import resume, save_checkpoint

__all__ = ["ResumeCallback", "resume", "save_checkpoint"]

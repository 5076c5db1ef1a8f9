"""Exact resume: checkpoints from which a training run continues as if it had never stopped."""

from sb3_bruno.resume.checkpoint import ResumeCallback, resume, save_checkpoint

__all__ = ["ResumeCallback", "resume", "save_checkpoint"]

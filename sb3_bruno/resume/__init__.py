"""Exact resume: a checkpoint of all that a training run stands on."""

from sb3_bruno.resume.checkpoint import ResumeCallback, resume, save_checkpoint

__all__ = ["ResumeCallback", "resume", "save_checkpoint"]

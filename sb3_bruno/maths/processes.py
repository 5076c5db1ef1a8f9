"""Processes by name, so that a configuration file can choose one."""

from __future__ import annotations

from collections.abc import Callable

from sb3_bruno.maths.exchangeable import ExchangeableGaussian
from sb3_bruno.maths.kernel_process import KernelGaussian
from sb3_bruno.maths.kernel_process_t import KernelStudentT

EXCHANGEABLE: dict[str, Callable[[int], ExchangeableGaussian]] = {"gaussian": ExchangeableGaussian}
"""Processes of so many latent dimensions, independent of each other, whose covariance does not depend on x."""

KERNEL: dict[str, Callable[[int], KernelGaussian]] = {"kernel": KernelGaussian, "kernel_student_t": KernelStudentT}
"""Processes of so many weights."""

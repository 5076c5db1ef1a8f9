"""Exchangeable processes by name, so that a configuration file can choose one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from sb3_bruno.maths.exchangeable import ExchangeableGaussian
from sb3_bruno.maths.exchangeable_t import ExchangeableStudentT

PROCESSES: dict[str, Callable[[int], ExchangeableGaussian]] = {
    "gaussian": ExchangeableGaussian,
    "student_t": ExchangeableStudentT,
    "shared_student_t": partial(ExchangeableStudentT, shared_scale=True),
}

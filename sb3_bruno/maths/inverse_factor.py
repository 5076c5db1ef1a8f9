"""The lower triangular square root of an inverse matrix."""

from __future__ import annotations

import torch as th
from torch import Tensor


def inverse_factor(matrix: Tensor) -> Tensor:
    """Compute the lower triangular A with A A^T = M^-1, for symmetric positive definite M.

    M is factorised from its last row upwards, M = U U^T with U upper triangular, so that A = U^-T is lower triangular.
    The diagonal of A A^T, and x^T A A^T x as the square of x^T A, are sums of squares: a variance is never negative.

    Args:
        matrix: M, ``(..., size, size)``.

    Returns:
        A, ``(..., size, size)``.
    """
    size = matrix.shape[-1]
    if size == 1:
        return matrix.rsqrt()
    turned, _ = th.linalg.cholesky_ex(matrix.flip(-2, -1))  # unlike `cholesky`, it never makes a GPU wait
    identity = th.eye(size, dtype=matrix.dtype, device=matrix.device)
    inverse: Tensor = th.linalg.solve_triangular(turned, identity, upper=False)
    return inverse.flip(-2, -1).mT


def log_det(factor: Tensor) -> Tensor:
    """Return ln det M, ``(..., 1)``, of the matrix whose inverse factor is ``factor``, ``(..., size, size)``."""
    return -2 * factor.diagonal(dim1=-2, dim2=-1).log().sum(dim=-1, keepdim=True)

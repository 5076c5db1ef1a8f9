"""Says in ONNX's own operators what a belief needs and ONNX lacks: triangular factors, and the log of Gamma.

The number of steps is that of a matrix's rows, which is known when a file is written, so they are written out one after
the other. Numbers keep their type: what torch computes in float64 stays in float64.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import onnx_ir
import torch as th
from numpy.typing import NDArray
from onnxscript.onnx_opset import opset18

op: Any = opset18  # whose operators take values of a file that is written, and its types only arrays

SHIFT = 8
"""How far ``lgamma`` steps up before Stirling's series, whose first term left out is below 10^-14 there."""
STIRLING = (1 / 12, -1 / 360, 1 / 1260, -1 / 1680, 1 / 1188, -691 / 360_360)
"""Abramowitz and Stegun (1964), 6.1.41."""
Value = Any
"""A tensor of the file that is written: onnxscript's own, which has no type."""


def translations() -> dict[Callable[..., Any], Callable[..., Any]]:
    """Return how to write each of torch's operations that ONNX lacks; for one file, for it remembers its factors."""
    aten = th.ops.aten
    inverses: dict[Value, Value] = {}

    def cholesky(self: Value, *, upper: bool = False, check_errors: bool = False) -> tuple[Value, Value]:
        if upper:
            raise NotImplementedError("aten.linalg_cholesky_ex with upper=True")
        factor, inverses[factor], failed = _factorise(self)
        return factor, failed

    def solve(A: Value, B: Value, *, upper: bool, left: bool = True, unitriangular: bool = False) -> Value:
        if A not in inverses or upper or not left or unitriangular:
            raise NotImplementedError("aten.linalg_solve_triangular of a matrix that is no Cholesky factor")
        return op.MatMul(inverses[A], B)

    return {
        aten.linalg_cholesky_ex.default: cholesky,
        aten.linalg_solve_triangular.default: solve,
        aten.lgamma.default: _lgamma,
    }


def _factorise(matrix: Value) -> tuple[Value, Value, Value]:
    r"""Factorise M = L L^T by eliminating the columns of [[M, I], [I, 0]] one by one.

    The eliminated rows are sqrt(pivot) [L^T, L^-1], so the inverse comes with the factor: four operators a column.

    Args:
        matrix: M, symmetric and positive definite, (..., size, size) with a batch of one.

    Returns:
        L and L^-1, shapes as of M, and 0 for "no error", (...).
    """
    *batch, size, _ = [int(length) for length in matrix.shape]
    if math.prod(batch) != 1:
        raise NotImplementedError("aten.linalg_cholesky_ex of several matrices")
    dtype = matrix.dtype.numpy()
    identity, zeros = _constant(np.eye(size, dtype=dtype)), _constant(np.zeros((size, size), dtype))
    flat = _reshaped(matrix, [size, size])
    rest = op.Concat(op.Concat(flat, identity, axis=1), op.Concat(identity, zeros, axis=1), axis=0)
    rows, pivots = [], []
    for j in range(size):
        rows.append(_slice(rest, j, j + 1, axis=0))
        pivots.append(_slice(rows[-1], j, j + 1, axis=1))
        if j + 1 < size:
            rest = op.Gemm(op.Div(rows[-1], pivots[-1]), rows[-1], rest, alpha=-1.0, transA=1)
    whole = op.Div(op.Concat(*rows, axis=0), op.Sqrt(op.Concat(*pivots, axis=0)))
    turned = op.Trilu(_slice(whole, 0, size, axis=1), upper=1)  # what was eliminated is 0 up to rounding
    factor, inverse = op.Transpose(turned, perm=[1, 0]), _slice(whole, size, 2 * size, axis=1)
    shape = [*batch, size, size]
    return _reshaped(factor, shape), _reshaped(inverse, shape), _constant(np.zeros(batch, np.int32))


def _lgamma(self: Value) -> Value:
    """Return ln Gamma(x) for x > 0, by Stirling's series at x + 8 and the recurrence Gamma(x + 1) = x Gamma(x)."""
    dtype = self.dtype.numpy()

    def number(value: float) -> Value:
        return _constant(np.asarray(value, dtype))

    product = self
    for k in range(1, SHIFT):
        product = op.Mul(product, op.Add(self, number(k)))
    x = op.Add(self, number(SHIFT))
    inverse = op.Reciprocal(x)
    square = op.Mul(inverse, inverse)
    series = number(STIRLING[-1])
    for coefficient in STIRLING[-2::-1]:
        series = op.Add(op.Mul(series, square), number(coefficient))
    leading = op.Sub(op.Mul(op.Sub(x, number(0.5)), op.Log(x)), op.Sub(x, number(0.5 * math.log(2 * math.pi))))
    return op.Sub(op.Add(leading, op.Mul(series, inverse)), op.Log(product))


def _slice(matrix: Value, start: int, stop: int, axis: int) -> Value:
    return op.Slice(matrix, *(op.Constant(value_ints=[number]) for number in (start, stop, axis)))


def _reshaped(matrix: Value, shape: Sequence[int]) -> Value:
    """Give a matrix a shape, unless it has that."""
    if list(matrix.shape or ()) == list(shape):
        return matrix
    return op.Reshape(matrix, op.Constant(value_ints=list(shape)))


def _constant(array: NDArray[Any]) -> Value:
    return op.Constant(value=onnx_ir.tensor(array))

"""What is written in ONNX's own operators computes what torch does, in float64."""

import numpy as np
import onnxruntime
import pytest
import torch as th

from sb3_bruno.export.onnx_operators import translations

N = 16


class Factors(th.nn.Module):
    """Returns L, its inverse, and whether it failed."""

    def forward(self, matrix):
        factor, failed = th.linalg.cholesky_ex(matrix)
        identity = th.eye(N, dtype=matrix.dtype)
        return factor, th.linalg.solve_triangular(factor, identity, upper=False), failed


class LogGamma(th.nn.Module):
    """Returns ln Gamma."""

    def forward(self, x):
        return x.lgamma()


def written(module, example):
    """A module that onnxruntime runs."""
    program = th.onnx.export(
        module, (example,), custom_translation_table=translations(), verbose=False, dynamo=True, optimize=False
    )
    session = onnxruntime.InferenceSession(program.model_proto.SerializeToString())
    (name,) = (entry.name for entry in session.get_inputs())
    return lambda x: session.run(None, {name: x.numpy()})


@pytest.mark.filterwarnings("ignore")  # torch's own deprecations
def test_a_triangular_factor_and_its_inverse():
    run = written(Factors(), th.eye(N, dtype=th.float64)[None])
    generator = th.Generator().manual_seed(0)
    for scale in (1.0, 1e4, 1e9):  # of the evidence beside the prior, as in long episodes
        root = th.randn(N, 40, generator=generator, dtype=th.float64)
        matrix = (th.eye(N, dtype=th.float64) + scale * root @ root.mT)[None]
        found, expected = run(matrix), Factors()(matrix)
        np.testing.assert_allclose(found[0], expected[0], rtol=1e-9, atol=1e-9 * scale**0.5)
        np.testing.assert_allclose(found[1], expected[1], rtol=1e-9, atol=1e-12)
        assert found[2] == expected[2] == 0


@pytest.mark.filterwarnings("ignore")
def test_the_log_of_gamma():
    x = th.logspace(-6, 6, 2_000, dtype=th.float64)
    (found,) = written(LogGamma(), x)(x)
    np.testing.assert_allclose(found, x.lgamma(), rtol=1e-13, atol=1e-13)

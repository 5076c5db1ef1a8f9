"""The flow adapter is a bijection with the right log-determinant, whichever zuko flow it holds."""

import io
import math
import re
from functools import partial

import pytest
import torch as th
import zuko
from zuko.transforms import MonotonicAffineTransform

from sb3_bruno.maths.flow import ConditionalFlow, paper_maf
from sb3_bruno.maths.reflection import Reflection

FLOWS = {
    "spline": {},
    "paper_maf": {"flow_class": "paper_maf"},
    "reflected_maf": {"flow_class": "reflected_maf"},
    "maf": {"flow_class": zuko.flows.MAF, "flow_kwargs": {"transforms": 2, "hidden_features": (16, 16)}},
    "nsf": {"flow_class": zuko.flows.NSF, "flow_kwargs": {"transforms": 2, "hidden_features": (16,)}},
    "nice": {"flow_class": zuko.flows.NICE, "flow_kwargs": {"transforms": 3, "hidden_features": (16,)}},
}

UNIVARIATE = {"spline", "maf", "nsf"}  # flows that allow a single feature
PARAMS = [(flow, features) for flow in FLOWS for features in (1, 5) if features > 1 or flow in UNIVARIATE]


@pytest.fixture(params=PARAMS)
def flow(request):
    name, features = request.param
    th.manual_seed(0)
    return ConditionalFlow(features, 3, **FLOWS[name]).double(), features


def test_inverse_undoes_forward(flow):
    flow, features = flow
    y, x = th.randn(4, 6, features, dtype=th.float64), th.randn(4, 6, 3, dtype=th.float64)
    th.testing.assert_close(flow.inverse(flow(y, x).z, x), y, rtol=1e-6, atol=1e-6)


def test_log_det_is_that_of_the_jacobian(flow):
    flow, features = flow
    y, x = th.randn(5, features, dtype=th.float64), th.randn(5, 3, dtype=th.float64)
    log_det = flow(y, x).log_det
    assert log_det.shape == (5,)
    for i in range(5):
        jacobian = th.autograd.functional.jacobian(lambda y_i, i=i: flow(y_i, x[i]).z, y[i])
        th.testing.assert_close(log_det[i], jacobian.slogdet().logabsdet, rtol=1e-6, atol=1e-8)


def test_every_parameter_learns(flow):
    flow, features = flow
    latents = flow(th.randn(64, features, dtype=th.float64), th.randn(64, 3, dtype=th.float64))
    (latents.z.square().sum() - latents.log_det.sum()).backward()
    assert all(weight.grad is not None and weight.grad.isfinite().all() for weight in flow.parameters())


def test_state_dict_round_trip(flow):
    flow, features = flow
    file = io.BytesIO()
    th.save(flow.state_dict(), file)
    file.seek(0)
    y, x = th.randn(5, features, dtype=th.float64), th.randn(5, 3, dtype=th.float64)
    before = flow(y, x)
    for weight in flow.parameters():
        th.nn.init.normal_(weight)
    flow.load_state_dict(th.load(file))
    th.testing.assert_close(tuple(flow(y, x)), tuple(before))


def test_paper_maf_bounds_the_log_scale_of_each_of_its_six_layers():
    flow = ConditionalFlow(5, 3, "paper_maf")
    with th.no_grad():
        for weight in flow.parameters():
            weight.mul_(100)
    log_det = flow(th.randn(100, 5), th.randn(100, 3)).log_det
    assert log_det.abs().max() <= 6 * 5
    assert len(paper_maf(5, 3).transform.transforms) == 6


def test_no_flow_is_the_identity():
    flow, y, x = ConditionalFlow(1, 3, flow_class=None), th.randn(5, 1), th.randn(5, 3)
    latents = flow(y, x)
    assert th.equal(latents.z, y) and th.equal(flow.inverse(y, x), y) and th.equal(latents.log_det, th.zeros(5))


def test_a_name_that_is_no_flow_is_refused():
    with pytest.raises(ValueError, match=r"flow_class='nmaf' is unknown: give one of .*reflected_maf"):
        ConditionalFlow(2, 3, flow_class="nmaf")


@pytest.mark.parametrize(
    ("flow_class", "flow_kwargs", "error"),
    [
        (zuko.flows.MAF, {"transform": 2}, "`flow_kwargs` has no `transform`: did you mean `transforms`?"),
        (zuko.flows.MAF, {"hiden_features": (8,)}, "`flow_kwargs` has no `hiden_features`: did you mean `hidden_feat"),
        (zuko.flows.NSF, {"bin": 8}, "`flow_kwargs` has no `bin`: did you mean `bins`?"),
        (zuko.flows.NSF, {"activaton": None}, "`flow_kwargs` has no `activaton`: did you mean `activation`?"),
        (zuko.flows.NICE, {"hiden_features": (8,)}, "did you mean `hidden_features`?"),
        (zuko.flows.MAF, {"xyz": 2}, "`flow_kwargs` has no `xyz`: it takes transforms, randperm, "),
        ("spline", {"bins": 8}, "`flow_kwargs` has no `bins`: it takes nothing."),
        (zuko.flows.MAF, {"transforms": "many"}, "`flow_kwargs={'transforms': 'many'}` cannot be: TypeError"),
        (zuko.flows.MAF, {"hidden_features": 8}, "`flow_kwargs={'hidden_features': 8}` cannot be: TypeError"),
        (zuko.flows.MAF, [("transforms", 2)], "`flow_kwargs=[('transforms', 2)]` is no dict"),
        (None, {"transforms": 2}, "`flow_kwargs={'transforms': 2}` is for a flow, and `flow_class=None`: leave it"),
    ],
    ids=str,
)
def test_what_a_flow_does_not_take_is_named(flow_class, flow_kwargs, error):
    with pytest.raises((TypeError, ValueError), match=re.escape(error)):
        ConditionalFlow(2, 3, flow_class, flow_kwargs)


@pytest.mark.parametrize("flow_class", ["paper_maf", "reflected_maf"])
def test_flows_that_need_two_features_refuse_one(flow_class):
    with pytest.raises(ValueError, match=f"features=1 is too few for `{flow_class}`: set `extra_dims`"):
        ConditionalFlow(1, 3, flow_class=flow_class)


def test_a_reflection_turns_the_sign_of_what_lies_along_its_mirror():
    reflection = Reflection(th.tensor([[3.0, 0.0], [0.0, 0.5]]))
    y = th.tensor([[1.0, 2.0], [1.0, 2.0]])
    th.testing.assert_close(reflection(y), th.tensor([[-1.0, 2.0], [1.0, -2.0]]))
    th.testing.assert_close(reflection(reflection(y)), y)


def test_the_layers_compute_what_zukos_do():
    """Given the same weights, the numbers are those of zuko's own masked autoregressive flow."""
    ours = ConditionalFlow(5, 3, "paper_maf").double()
    univariate = partial(MonotonicAffineTransform, slope=math.exp(-1))
    kwargs = {"transforms": 6, "hidden_features": (128,), "univariate": univariate}
    zukos = ConditionalFlow(5, 3, zuko.flows.MAF, kwargs).double()
    with th.no_grad():
        for weight, zukos_weight in zip(ours.parameters(), zukos.parameters(), strict=True):
            zukos_weight.copy_(weight)
    y, x = th.randn(7, 5, dtype=th.float64), th.randn(7, 3, dtype=th.float64)
    th.testing.assert_close(tuple(ours(y, x)), tuple(zukos(y, x)))
    th.testing.assert_close(ours.inverse(y, x), zukos.inverse(y, x))


def test_what_is_no_flow_is_refused():
    with pytest.raises(TypeError, match=r"flow_class=.*Linear.* no zuko.lazy.Flow"):
        ConditionalFlow(2, 3, flow_class=th.nn.Linear)


@pytest.mark.parametrize("flow_class", [zuko.flows.GF, zuko.flows.NAF, zuko.flows.BPF, zuko.flows.CNF])
def test_a_flow_that_cannot_map_in_inference_mode_is_refused(flow_class):
    with pytest.raises(ValueError, match=r"flow_class=.*cannot map in inference mode.*use another"):
        ConditionalFlow(1, 3, flow_class=flow_class)


@pytest.mark.parametrize("flow_class", [3, 0.5, ("spline",), {}])
def test_what_builds_no_flow_is_refused_by_its_value(flow_class):
    with pytest.raises(TypeError, match=r"flow_class=.* builds no flow: give a zuko flow, one of .*spline"):
        ConditionalFlow(1, 3, flow_class=flow_class)

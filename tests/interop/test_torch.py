"""Programs as functions of PyTorch tensors: values and gradients, vmap and gradcheck, against analytic derivatives."""

from __future__ import annotations

import re
import sys
from typing import Any

import numpy as np
import pytest
from gradients import Case, Late, arm, by_mass_and_place, close
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.interop.torch import operator

torch = Late("torch")
pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="derivatives are of programs")
FORWARD = pytest.mark.filterwarnings("ignore:.*torch.jit.script:DeprecationWarning")  # of PyTorch's own forward mode


@pytest.fixture(scope="module")
def case() -> Case:
    return arm()


def tensors(arrays: Any, grad: bool = False) -> list[Any]:
    return [torch.tensor(np.asarray(x), requires_grad=grad) for x in arrays]


def test_values_are_the_programs_bits_in_every_way(case: Case) -> None:
    k, given = sd.specialize(case.model, sd.aba), tensors(case.given)
    f, wanted = k.to_torch(), k(*case.given)
    np.testing.assert_array_equal(f(*given), wanted)
    np.testing.assert_array_equal(torch.vmap(f)(*given), wanted)
    np.testing.assert_array_equal(f(*(x[0] for x in given)), k(*(x[0] for x in case.given)))
    assert not f(*given).requires_grad


def test_gradcheck(case: Case) -> None:
    f, (q, v, tau) = sd.specialize(case.model, sd.aba).to_torch(), case.given
    assert torch.autograd.gradcheck(f, tensors([q, v[0], tau], grad=True))


def test_jacobians_of_one_and_of_a_batch_are_analytic(case: Case) -> None:
    f, given = torch.func.jacrev(sd.specialize(case.model, sd.aba).to_torch(), argnums=(0, 1, 2)), tensors(case.given)
    for found, wanted in zip(f(*(x[0] for x in given)), case.by, strict=True):
        close(found, wanted[0])
    for found, wanted in zip(torch.vmap(f)(*given), case.by, strict=True):
        close(found, wanted)


@FORWARD
def test_forward_mode_is_analytic(case: Case) -> None:
    """Of one and of a batch, along what varies alone, and in a program of several results of which one does."""
    f, given = sd.specialize(case.model, sd.aba).to_torch(), tensors(case.given)
    along = torch.func.jacfwd(f, argnums=(0, 1, 2))
    for found, wanted in zip(along(*(x[0] for x in given)), case.by, strict=True):
        close(found, wanted[0])
    for found, wanted in zip(torch.vmap(along)(*given), case.by, strict=True):
        close(found, wanted)
    q, v, tau = given
    a, moved = torch.func.jvp(lambda v: f(q, v, tau[0]), (v,), (tau,))
    np.testing.assert_array_equal(a, f(q, v, tau[0]))
    by_v = sd.aba_derivatives(case.model, q.numpy(), v.numpy(), tau[:1].numpy())[:, 1]
    close(moved, np.einsum("sij,sj->si", by_v, tau))
    several = sd.specialize(case.model, [sd.generalized_gravity, sd.rnea]).to_torch()
    _, (still, moved) = torch.func.jvp(lambda a: several(q, v, a), (tau,), (v,))
    close(still, 0 * still)
    close(moved, np.einsum("sij,sj->si", sd.crba(case.model, q.numpy()), v))
    with torch.autograd.forward_ad.dual_level():
        dual = torch.autograd.forward_ad.make_dual(q, v)
        close(torch.autograd.forward_ad.unpack_dual(f(dual, v, tau)).tangent, np.einsum("sij,sj->si", case.by[0], v))


@FORWARD
def test_forward_and_backward_agree_by_a_quaternions_entries() -> None:
    model = random_tree(5, 2, floating=True).model
    rng = np.random.default_rng(2)
    f = sd.specialize(model, sd.generalized_gravity).to_torch()
    (q,) = tensors([sd.random_configuration(model, rng)])
    close(torch.func.jacfwd(f)(q), torch.func.jacrev(f)(q))


def test_a_gradient_sums_over_the_samples_that_share_an_input(case: Case) -> None:
    f, (q, v, tau) = sd.specialize(case.model, sd.aba).to_torch(), case.given
    by_q, by_v, by_tau = np.moveaxis(sd.aba_derivatives(case.model, q, v[0] + 0 * v, tau), -3, 0)
    weights = np.random.default_rng(1).standard_normal(q.shape)
    given = tensors([q, v[0], tau], grad=True)
    (torch.tensor(weights) * f(*given)).sum().backward()
    close(given[0].grad, np.einsum("si,sij->sj", weights, by_q))
    close(given[1].grad, np.einsum("si,sij->j", weights, by_v))
    close(given[2].grad, np.einsum("si,sij->sj", weights, by_tau))
    q, v, tau = tensors(case.given)
    np.testing.assert_array_equal(torch.vmap(f, in_dims=(0, None, 1))(q, v[0], tau.T), f(q, v[0], tau))
    deep = torch.vmap(lambda q, v: f(q, v, tau[0]))(torch.stack([q, 2 * q]), v[:2])
    np.testing.assert_array_equal(deep, f(torch.stack([q, 2 * q]), v[:2, None], tau[0]))


def test_gradients_of_design_parameters(case: Case) -> None:
    joint, state = case.model.names[2], tuple(x[0] for x in case.given)
    at = (1.5, np.array([0.1, -0.2, 0.3]))
    f = sd.specialize(case.model, sd.rnea, inputs=[f"mass:{joint}", f"com:{joint}"]).to_torch()
    found = torch.func.jacrev(lambda mass, com: f(*tensors(state), mass, com), argnums=(0, 1))(*tensors(at))
    for one, wanted in zip(found, by_mass_and_place(case.model, joint, state, at), strict=True):
        close(one, wanted)


def test_several_results_have_one_gradient(case: Case) -> None:
    f = sd.specialize(case.model, [sd.rnea, sd.crba]).to_torch()
    q, v, a = (x[0] for x in case.given)
    given = tensors([q, v, a], grad=True)
    tau, M = f(*given)
    (tau.sum() + M.sum()).backward()
    wanted = sd.rnea_derivatives(case.model, q, v, a)[0].sum(0) + sd.mass_matrix_derivatives(case.model, q).sum((0, 1))
    close(given[0].grad, wanted)
    given = tensors([q, v, a], grad=True)
    f(*given)[1].sum().backward()  # the other result has no weight
    close(given[0].grad, sd.mass_matrix_derivatives(case.model, q).sum((0, 1)))


def test_derivatives_by_a_quaternion_are_by_its_entries() -> None:
    model = random_tree(5, 2, floating=True).model
    rng = np.random.default_rng(2)
    q, (v, a, e) = sd.random_configuration(model, rng), rng.standard_normal((3, model.nv))
    by_q = torch.func.jacrev(sd.specialize(model, sd.rnea).to_torch())(*tensors([q, v, a]))
    assert by_q.shape == (model.nv, model.nq)
    tangent = torch.func.jacrev(sd.specialize(model, sd.integrate).to_torch(), argnums=1)(*tensors([q, 0 * e]))
    close(by_q @ tangent, sd.rnea_derivatives(model, q, v, a)[0])


def test_float32_in_gives_float32_out(case: Case) -> None:
    f, narrow = sd.specialize(case.model, sd.rnea).to_torch(), [np.float32(x) for x in case.given]
    given = tensors(narrow, grad=True)
    tau = f(*given)
    tau.sum().backward()
    assert tau.dtype == given[0].grad.dtype == torch.float32
    wanted = sd.rnea_derivatives(case.model, *narrow)[:, 0].sum(-2)
    np.testing.assert_allclose(given[0].grad, wanted, rtol=0.0, atol=1e-6 * abs(wanted).max())
    assert f([0, 1, 2], [0, 0, 0], [0, 0, 0]).dtype == torch.float64
    assert f(given[0], *tensors(case.given[1:])).dtype == torch.float64


def test_a_number_beyond_float32_is_an_error(case: Case) -> None:
    f, given = sd.specialize(case.model, sd.rnea).to_torch(), tensors(np.float32(x) for x in case.given)
    with pytest.raises(sd.SpatialDynError, match="a result of rnea is beyond the range of float32, expected inputs of"):
        f(*given[:2], 3e38 + 0.0 * given[2])


@FORWARD
def test_second_derivatives_agree_in_every_mode(case: Case) -> None:
    """Forwards and backwards over either, and with differences of the gradient, where samples share an input."""
    f, weights = sd.specialize(case.model, sd.aba).to_torch(), torch.tensor([1.0, -2.0, 0.5], dtype=torch.float64)
    q, v, tau = tensors([case.given[0][0], case.given[1][:2], case.given[2][0]])

    def norm(q: Any) -> Any:
        return (weights * f(q, v, tau)).sum()

    slope, step = torch.func.grad(norm), 1e-5
    wanted = torch.stack([slope(q + step * e) - slope(q - step * e) for e in torch.eye(3, dtype=q.dtype)]) / (2 * step)
    func = torch.func
    for second in (func.hessian, lambda f: func.jacfwd(func.jacfwd(f)), lambda f: func.jacrev(func.jacrev(f))):
        found = second(norm)(q)
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-8 * abs(wanted).max())
    np.testing.assert_array_equal(torch.autograd.functional.hessian(norm, q), found)
    close(torch.vmap(func.hessian(norm))(torch.stack([q, 2.0 * q]))[0], found)
    assert torch.autograd.gradgradcheck(f, tensors([q, v, tau], grad=True))


def test_a_transform_sees_tensors_that_a_transform_within_it_does_not(case: Case) -> None:
    """Rates of q, by which the inner function of y does not differentiate: torch tells the inner tangents alone."""
    f, (q, v, tau) = sd.specialize(case.model, sd.aba).to_torch(), tensors([x[0] for x in case.given])
    ones, func = torch.ones(3, dtype=q.dtype), torch.func
    wanted = func.jacrev(lambda q: f(q, v, tau))(q)
    assert abs(wanted).max() > 0.1
    for within in (
        lambda q: func.jvp(lambda y: f(q, v, tau) * y, (ones,), (ones,))[1],
        lambda q: func.grad(lambda y: (f(q, v, tau) * y).sum())(ones),
    ):
        for jacobian in (func.jacfwd, func.jacrev):
            np.testing.assert_allclose(jacobian(within)(q), wanted, rtol=0.0, atol=1e-12 * abs(wanted).max())


def test_the_operator_tells_shapes_without_a_program(case: Case) -> None:
    from torch._subclasses.fake_tensor import FakeTensorMode

    call = operator(sd.specialize(case.model, [sd.rnea, sd.crba])._differentiable.node())
    with FakeTensorMode() as mode:
        q, v, a = (mode.from_tensor(x) for x in tensors([case.given[0], case.given[1][0], case.given[2][:, None]]))
        found = call(q, v, a)
        assert [tuple(x.shape) for x in found] == [(5, 5, 3), (5, 5, 3, 3)]
        with pytest.raises(sd.ShapeError, match=re.escape("v has shape (2,), expected (..., 3)")):
            call(q, v[:2], a)


# torch's compiler alone takes seconds
@pytest.mark.slow(quick="test_the_operator_tells_shapes_without_a_program")
@pytest.mark.filterwarnings("ignore:.*should not be instantiated:DeprecationWarning")  # by that compiler
def test_compiled_and_exported_graphs_hold_it_as_one_node(case: Case) -> None:
    f, given = sd.specialize(case.model, sd.aba).to_torch(), tensors(case.given)

    class Step(torch.nn.Module):  # type: ignore[misc, name-defined]
        def forward(self, q: Any, v: Any, tau: Any) -> Any:
            return q + 0.01 * (v + 0.01 * f(q, v, tau))

    step = Step()
    made = torch.compile(step, fullgraph=True, backend="aot_eager")
    np.testing.assert_array_equal(made(*given), step(*given))
    np.testing.assert_array_equal(made(*(x[:2] for x in given)), step(*(x[:2] for x in given)))
    slopes = []
    for one in (made, step):
        moved = tensors(case.given, grad=True)
        one(*moved).square().sum().backward()
        slopes.append(torch.stack([x.grad for x in moved]))
    close(slopes[0], slopes[1])
    batch = torch.export.Dim("batch")
    exported = torch.export.export(step, tuple(given), dynamic_shapes={x: {0: batch} for x in ("q", "v", "tau")})
    assert sum("spatialdyn" in str(node.target) for node in exported.graph.nodes) == 1
    np.testing.assert_array_equal(exported.module()(*(x[:3] for x in given)), step(*(x[:3] for x in given)))


@FORWARD
def test_what_it_has_not_is_refused(case: Case) -> None:
    f, (q, v, tau) = sd.specialize(case.model, sd.aba).to_torch(), tensors(x[0] for x in case.given)
    with pytest.raises(sd.SpatialDynError, match="a third derivative of aba is not available, expected first and"):
        torch.func.jacfwd(torch.func.hessian(lambda q: f(q, v, tau)[0]))(q)
    with pytest.raises(sd.SpatialDynError, match='q is on "meta", expected a tensor on the CPU'):
        f(q.to("meta"), v, tau)
    with pytest.raises(sd.SpatialDynError, match=r"q is torch\.complex128, expected real numbers"):
        f(q * 1j, v, tau)
    with pytest.raises(sd.ShapeError, match=re.escape("v has shape (2,), expected (..., 3)")):
        f(q, v[:2], tau)
    with pytest.raises(sd.ShapeError, match=re.escape("batch shapes do not broadcast: q (2,), v (), tau (3,)")):
        f(torch.stack([q] * 2), v, torch.stack([tau] * 3))
    with pytest.raises(TypeError, match=re.escape("1 inputs were given, expected 3: (q, v, tau)")):
        f(q)
    with pytest.raises(sd.SpatialDynError, match="expected results alone to differentiate"):
        sd.specialize(case.model, sd.aba, derivative="jvp").to_torch()


def test_without_torch_the_error_says_how_to_install_it(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    k = sd.specialize(case.model, sd.rnea)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(sd.SpatialDynError, match=re.escape("torch is not installed; pip install torch")):
        k.to_torch()

"""Programs as functions of JAX arrays: values and gradients under jit, vmap and both, against analytic derivatives."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator

import numpy as np
import pytest
from gradients import Case, Late, arm, by_mass_and_place, close
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels

jax = Late("jax")
pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="derivatives are of programs")


@pytest.fixture(autouse=True)
def in_float64() -> Iterator[None]:
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


@pytest.fixture(scope="module")
def case() -> Case:
    return arm()


def test_values_are_the_programs_bits_in_every_way(case: Case) -> None:
    k = sd.specialize(case.model, sd.aba)
    f, wanted = k.to_jax(), k(*case.given)
    for found in (f(*case.given), jax.jit(f)(*case.given), jax.vmap(f)(*case.given), jax.jit(jax.vmap(f))(*case.given)):
        np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(f(*(x[0] for x in case.given)), k(*(x[0] for x in case.given)))


def test_jacobians_of_one_and_of_a_batch_are_analytic(case: Case) -> None:
    f = jax.jacrev(sd.specialize(case.model, sd.aba).to_jax(), argnums=(0, 1, 2))
    for found, wanted in zip(f(*(x[0] for x in case.given)), case.by, strict=True):
        close(found, wanted[0])
    for found, wanted in zip(jax.jit(jax.vmap(f))(*case.given), case.by, strict=True):
        close(found, wanted)


def test_a_gradient_sums_over_the_samples_that_share_an_input(case: Case) -> None:
    f, (q, v, tau) = sd.specialize(case.model, sd.aba).to_jax(), case.given
    by_q, by_v, by_tau = np.moveaxis(sd.aba_derivatives(case.model, q, v[0] + 0 * v, tau), -3, 0)
    weights = np.random.default_rng(1).standard_normal(q.shape)
    found = jax.grad(lambda *x: (weights * f(*x)).sum(), argnums=(0, 1, 2))(q, v[0], tau)
    close(found[0], np.einsum("si,sij->sj", weights, by_q))
    close(found[1], np.einsum("si,sij->j", weights, by_v))
    close(found[2], np.einsum("si,sij->sj", weights, by_tau))
    mapped = jax.vmap(f, in_axes=(0, None, 1))(q, v[0], tau.T)
    np.testing.assert_array_equal(mapped, f(q, v[0], tau))
    deep = jax.vmap(lambda q, v: f(q, v, tau[0]))(np.stack([q, 2 * q]), v[:2])
    np.testing.assert_array_equal(deep, f(np.stack([q, 2 * q]), v[:2, None], tau[0]))


def test_gradients_of_design_parameters(case: Case) -> None:
    joint, state = case.model.names[2], tuple(x[0] for x in case.given)
    at = (1.5, np.array([0.1, -0.2, 0.3]))
    f = sd.specialize(case.model, sd.rnea, inputs=[f"mass:{joint}", f"com:{joint}"]).to_jax()
    found = jax.jacrev(lambda mass, com: f(*state, mass, com), argnums=(0, 1))(*at)
    for one, wanted in zip(found, by_mass_and_place(case.model, joint, state, at), strict=True):
        close(one, wanted)


def test_several_results_have_one_gradient(case: Case) -> None:
    f = sd.specialize(case.model, [sd.rnea, sd.crba]).to_jax()
    q, v, a = (x[0] for x in case.given)
    found = jax.grad(lambda q: f(q, v, a)[0].sum() + f(q, v, a)[1].sum())(q)
    wanted = sd.rnea_derivatives(case.model, q, v, a)[0].sum(0) + sd.mass_matrix_derivatives(case.model, q).sum((0, 1))
    close(found, wanted)


def test_derivatives_by_a_quaternion_are_by_its_entries() -> None:
    model = random_tree(5, 2, floating=True).model
    rng = np.random.default_rng(2)
    q, (v, a, e) = sd.random_configuration(model, rng), rng.standard_normal((3, model.nv))
    by_q = jax.jacrev(sd.specialize(model, sd.rnea).to_jax())(q, v, a)
    assert by_q.shape == (model.nv, model.nq)
    tangent = jax.jacrev(sd.specialize(model, sd.integrate).to_jax(), argnums=1)(q, 0 * e)
    close(by_q @ tangent, sd.rnea_derivatives(model, q, v, a)[0])


def test_float32_in_gives_float32_out(case: Case) -> None:
    f, narrow = sd.specialize(case.model, sd.rnea).to_jax(), [np.float32(x) for x in case.given]
    assert f(*narrow).dtype == np.float32
    by = jax.grad(lambda q: f(q, *narrow[1:]).sum())(narrow[0])
    assert by.dtype == np.float32
    wanted = sd.rnea_derivatives(case.model, *narrow)[:, 0].sum(-2)
    np.testing.assert_allclose(by, wanted, rtol=0.0, atol=1e-6 * abs(wanted).max())
    assert f([0, 1, 2], [0, 0, 0], [0, 0, 0]).dtype == np.float64
    jax.config.update("jax_enable_x64", False)
    assert f(*case.given).dtype == np.float32


def test_what_it_has_not_is_refused(case: Case) -> None:
    f, (q, v, tau) = sd.specialize(case.model, sd.aba).to_jax(), (x[0] for x in case.given)

    def norm(q: object) -> object:
        return f(q, v, tau).sum()

    for second in (jax.hessian(norm), jax.grad(lambda q: jax.grad(norm)(q).sum())):
        with pytest.raises(sd.SpatialDynError, match="a second derivative is not available"):
            second(q)
    for forwards in (lambda: jax.jvp(norm, (q,), (q,)), lambda: jax.jacfwd(norm)(q)):
        with pytest.raises(TypeError, match=r"aba has no forward mode \(jvp, jacfwd\), expected grad, vjp or jacrev"):
            forwards()
    with pytest.raises(sd.ShapeError, match=re.escape("v has shape (2,), expected (..., 3)")):
        f(q, v[:2], tau)
    with pytest.raises(sd.ShapeError, match=re.escape("batch shapes do not broadcast: q (2,), v (), tau (3,)")):
        f(np.stack([q] * 2), v, np.stack([tau] * 3))
    with pytest.raises(TypeError, match=re.escape("1 inputs were given, expected 3: (q, v, tau)")):
        f(q)
    with pytest.raises(sd.SpatialDynError, match="expected results alone to differentiate"):
        sd.bounded(case.model, sd.aba).to_jax()


def test_an_error_of_values_ends_with_this_librarys_message(case: Case) -> None:
    f, (q, v, tau) = sd.specialize(case.model, sd.aba).to_jax(), (x[0] for x in case.given)
    with pytest.raises(jax.errors.JaxRuntimeError) as raised:
        jax.grad(lambda q: f(q, v, tau).sum())(q + 1e7)
    last = str(raised.value).splitlines()[-1]
    assert last.startswith(
        "SpatialDynError: aba has no derivative by its program, where the largest input is q with 1e+07"
    )


def test_without_jax_the_error_says_how_to_install_it(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    k = sd.specialize(case.model, sd.rnea)
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(sd.SpatialDynError, match=re.escape("jax is not installed; pip install jax")):
        k.to_jax()

"""Programs as functions of JAX arrays: values and gradients under jit, vmap and both, against analytic derivatives."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from gradients import Case, Late, arm, by_mass_and_place, close
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.llvm import xla_text
from spatialdyn.engines.programs.run import xla_handler
from spatialdyn.engines.threads import thread_pool
from spatialdyn.interop import jax as bridge

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


def test_second_derivatives_agree_in_every_mode(case: Case) -> None:
    """Forwards and backwards over either, and with differences of the gradient, where samples share an input."""
    q, v, tau = case.given[0][0], case.given[1][:2], case.given[2][0]
    f, weights = sd.specialize(case.model, sd.aba).to_jax(), np.array([1.0, -2.0, 0.5])

    def norm(q: object) -> object:
        return (weights * f(q, v, tau)).sum()

    slope, step = jax.jit(jax.grad(norm)), 1e-5
    wanted = np.array([np.asarray(slope(q + step * e)) - np.asarray(slope(q - step * e)) for e in np.eye(3)])
    wanted /= 2.0 * step
    for second in (jax.hessian(norm), jax.jacfwd(jax.jacfwd(norm)), jax.jacrev(jax.jacrev(norm))):
        found = jax.jit(second)(q)
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-8 * abs(wanted).max())
        np.testing.assert_allclose(found, np.transpose(found), rtol=0.0, atol=1e-12 * abs(wanted).max())


def test_forward_mode_is_analytic(case: Case) -> None:
    f, (q, v, tau) = sd.specialize(case.model, sd.aba).to_jax(), case.given
    a, moved = jax.jvp(lambda q, v: f(q, v, tau[0]), (q, v[0]), (v, tau[0]))
    np.testing.assert_array_equal(a, f(q, v[0], tau[0]))
    by_q, by_v, _ = np.moveaxis(sd.aba_derivatives(case.model, q, v[0] + 0 * v, tau[0] + 0 * v), -3, 0)
    close(moved, np.einsum("sij,sj->si", by_q, v) + by_v @ tau[0])
    for found, wanted in zip(jax.jacfwd(f, argnums=(0, 1, 2))(q[0], v[0], tau[0]), case.by, strict=True):
        close(found, wanted[0])


def test_a_rollout_under_scan_has_the_gradient_of_its_steps(case: Case) -> None:
    f, (q, v, tau) = sd.specialize(case.model, sd.aba).to_jax(), (x[0] for x in case.given)

    def step(state: tuple[object, object], tau: object) -> tuple[object, None]:
        q, v = state
        v = v + 0.01 * f(q, v, tau)
        return (q + 0.01 * v, v), None

    def end(tau: object) -> object:
        return jax.lax.scan(step, (q, v), tau)[0][0][0]

    given = np.stack([tau, 2.0 * tau, -tau])
    found = jax.jit(jax.grad(end))(given)
    wanted = np.zeros_like(given)
    for at in np.ndindex(*given.shape):
        moved = np.zeros_like(given)
        moved[at] = 1e-4
        wanted[at] = (end(given + moved) - end(given - moved)) / 2e-4
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-8 * abs(wanted).max())


def test_samples_that_lanes_reject_are_those_of_the_native_call(case: Case) -> None:
    """NaN stays in its sample, an angle beyond lanes is computed again; in float32, in whole tiles and beside them."""
    k = sd.specialize(case.model, sd.rnea)
    f, (q, v, a) = k.to_jax(), (np.concatenate([x] * 4)[:19] for x in case.given)
    q, v = q.copy(), v.copy()
    q[2], v[17, 0], q[6] = np.nan, np.nan, 1e6
    wanted = k(q, v, a)
    np.testing.assert_array_equal(f(q, v, a), wanted)
    assert np.flatnonzero(np.isnan(wanted).any(1)).tolist() == [2, 17]
    q[6] = 2.0**20  # a number of float32
    narrow = [np.float32(x) for x in (q, v, a)]
    np.testing.assert_array_equal(f(*narrow), np.float32(k(*(np.float64(x) for x in narrow))))
    by = np.asarray(jax.grad(lambda v: f(q[:3], v, a[:3]).sum())(v[:3]))
    assert np.isnan(by).any(1).tolist() == [False, False, True]


def test_at_exit_python_waits_and_then_recomputes_nothing(case: Case) -> None:
    """JAX, which waits then too, holds the lock that samples need which Python recomputes."""
    f, (q, v, tau) = jax.jit(sd.specialize(case.model, sd.aba).to_jax()), (x[0] for x in case.given)
    given = np.stack([q + 1e6] * 2000), v, tau
    f(*given).block_until_ready()
    found = f(*given)
    try:
        bridge.end()
        assert found.is_ready()
        assert np.isfinite(f(q, v, tau)).all()
        with pytest.raises((ValueError, jax.errors.JaxRuntimeError), match="are not recomputed while Python ends"):
            f(*given).block_until_ready()
        assert not xla_handler.recomputing()[1]
    finally:
        xla_handler.recomputing()[0] = 0
    np.testing.assert_array_equal(f(*given), found)


@pytest.mark.slow(quick="test_at_exit_python_waits_and_then_recomputes_nothing")
@pytest.mark.parametrize("kept", ["x = ", ""])
def test_a_process_ends_while_samples_are_recomputed(kept: str) -> None:
    text = f"""
import jax, numpy as np, spatialdyn as sd
f = jax.jit(sd.specialize(sd.load_urdf("ur5"), sd.aba).to_jax())
q = np.full((8_000, 6), 2.0**24)
f(q, q, q).block_until_ready()
{kept}f(q, q, q)
"""
    subprocess.run([sys.executable, "-c", text], check=True, timeout=120)


def test_an_exported_function_takes_batches_of_any_size(case: Case) -> None:
    k = sd.specialize(case.model, sd.aba)
    f, name = k.to_jax(), k._differentiable.node().handler(np.float64).name
    sizes = jax.export.symbolic_shape("b, c")
    shapes = [jax.ShapeDtypeStruct(x, np.float64) for x in ((*sizes, 3), (sizes[1], 3), (3,))]
    checks = [jax.export.DisabledSafetyCheck.custom_call(name)]
    made = jax.export.export(jax.jit(f), disabled_checks=checks)(*shapes)
    given = np.stack(case.given[:1] * 2), case.given[1], case.given[2][0]
    np.testing.assert_array_equal(made.call(*given), k(*given))
    with pytest.raises(sd.ShapeError, match=re.escape("batch shapes do not broadcast: q (b), v (c), tau ()")):
        jax.export.export(jax.jit(f))(
            *(jax.ShapeDtypeStruct((*x, 3), np.float64) for x in ([sizes[0]], [sizes[1]], []))
        )


def test_a_number_beyond_float32_is_an_error(case: Case) -> None:
    f, (q, v, a) = sd.specialize(case.model, sd.rnea).to_jax(), (np.float32(x) for x in case.given)
    for n in (1, 5):  # of a tail, of whole vectors
        with pytest.raises(
            jax.errors.JaxRuntimeError, match="a result is beyond the range of float32, expected inputs"
        ):
            f(q[:n], v[:n], np.float32(3e38) + 0.0 * a[:n]).block_until_ready()
    a[0, 0] = np.inf
    assert not np.isfinite(f(q, v, a)[0]).all()


def test_long_batches_are_shared_with_xlas_threads(case: Case) -> None:
    k = sd.specialize(case.model, sd.aba)
    f, rng = k.to_jax(), np.random.default_rng(3)
    sd.set_num_threads(3)
    try:
        for n in (40_000, 40_003):
            given = [rng.standard_normal((n, 3)) for _ in range(3)]
            given[0][7] = np.nan
            np.testing.assert_array_equal(f(*given), k(*given))
    finally:
        thread_pool.ask(None)


def test_a_program_of_float32_has_its_own_bits(case: Case) -> None:
    k = sd.specialize(case.model, sd.aba, dtype=np.float32)
    f, narrow = k.to_jax(), [np.float32(x) for x in case.given]
    np.testing.assert_array_equal(f(*narrow), k(*narrow))
    np.testing.assert_array_equal(f(*case.given), k(*case.given))


def test_where_xla_takes_no_handler_python_is_called_and_it_is_said(
    case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise ValueError("unsupported version 9.1")

    monkeypatch.setattr(jax.ffi, "register_ffi_target", refuse)
    bridge.known_to_xla.cache_clear()
    k = sd.specialize(case.model, sd.aba, outputs=[0])  # of no other test
    f = k.to_jax()
    with pytest.warns(UserWarning, match="XLA does not take compiled ones: unsupported version 9.1"):
        found = f(*case.given)
    np.testing.assert_array_equal(found, k(*case.given))
    close(jax.grad(lambda q: f(q, *case.given[1:]).sum())(case.given[0]), case.by[0][:, 0])  # said once
    bridge.known_to_xla.cache_clear()


def test_the_structs_of_xlas_interface_are_where_the_handler_reads_them(tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None or sys.platform == "win32":
        pytest.skip("no C compiler called cc")
    struct = {"frame": "CallFrame", "args": "Args", "buffer": "Buffer", "metadata": "Metadata", "api": "Api"}
    struct |= {"version": "Api_Version", "extension": "Metadata_Extension", "error": "Error_Create_Args"}
    struct["task"] = "ThreadPool_Schedule_Args"
    field = {"extension": "extension_start", "count": "size", "items": "args", "version": "api_version"}
    field |= {"major": "major_version", "minor": "minor_version", "error_create": "XLA_FFI_Error_Create"}
    field |= {"error_destroy": "XLA_FFI_Error_Destroy", "schedule": "XLA_FFI_ThreadPool_Schedule"}
    field["type"] = "extension_base.type"
    offsets = []
    for name in xla_text.FIELDS:
        base, _, last = name.partition(".")
        offsets.append(f"offsetof(XLA_FFI_{struct[base]}, {field.get(last, last)})")
    for name, size in xla_text.SIZES.items():
        least = {"api": "offsetof(XLA_FFI_Api, XLA_FFI_ThreadPool_Schedule) + 8"}
        offsets.append(least.get(name, f"XLA_FFI_{struct[name]}_STRUCT_SIZE") + f" - {size}")
    rows = "\n".join(
        f'printf("%d\\n", (int)({x}));'
        for x in [*offsets, "XLA_FFI_API_MAJOR", "XLA_FFI_Error_Code_RESOURCE_EXHAUSTED"]
    )
    types = "".join(f"typedef struct XLA_FFI_{x} XLA_FFI_{x};" for x in struct.values() if x not in ("Buffer", "Args"))
    text = f'#include <stdio.h>\n#include "xla/ffi/api/c_api.h"\n{types}\nint main(void) {{ {rows} return 0; }}'
    (tmp_path / "layout.c").write_text(text)
    made = str(tmp_path / "layout")
    subprocess.run([compiler, "-I", jax.ffi.include_dir(), "-o", made, str(tmp_path / "layout.c")], check=True)
    found = [int(x) for x in subprocess.run([made], capture_output=True, check=True).stdout.split()]
    assert found[: len(xla_text.FIELDS)] == list(xla_text.FIELDS.values())
    assert found[len(xla_text.FIELDS) : -2] == [0] * len(xla_text.SIZES)
    assert found[-2:] == [xla_text.VERSION[0], xla_text.OUT_OF_MEMORY]


def test_what_it_has_not_is_refused(case: Case) -> None:
    f, (q, v, tau) = sd.specialize(case.model, sd.aba).to_jax(), (x[0] for x in case.given)
    with pytest.raises(sd.SpatialDynError, match="a third derivative of aba is not available, expected first and"):
        jax.jacfwd(jax.hessian(lambda q: f(q, v, tau).sum()))(q)
    with pytest.raises(sd.ShapeError, match=re.escape("v has shape (2,), expected (..., 3)")):
        f(q, v[:2], tau)
    with pytest.raises(sd.ShapeError, match=re.escape("batch shapes do not broadcast: q (2,), v (), tau (3,)")):
        f(np.stack([q] * 2), v, np.stack([tau] * 3))
    with pytest.raises(sd.SpatialDynError, match="tau is complex128, expected real numbers"):
        f(q, v, tau + 0j)
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

"""Arrays of equal dtypes are equal: unpickled, swapped back or with metadata, they run the same code to the same bits.

NumPy has one object for float64, and others that are equal to it, such as the dtype of what comes out of a pickle.
"""

from __future__ import annotations

import multiprocessing
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from trees import random_tree

import spatialdyn as sd
from spatialdyn.calls import dynamics, specialize_fallback
from spatialdyn.compat import pinocchio as pin
from spatialdyn.compat.native import recorded_calls
from spatialdyn.engines import by_table_kernel, run
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.run import single_call
from spatialdyn.engines.programs.run.call_code import CallCode
from spatialdyn.recursions import SPECS

CALLS = {"rnea": 3, "crba": 1, "aba": 3, "minverse": 1, "coriolis_matrix": 2}  # inputs of the shape (n,)
SAMPLES = 517
COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")


def swapped_back(x: Any) -> Any:
    """Twice the other way round, the second time by the name of the order."""
    swapped = x.astype(x.dtype.newbyteorder())
    return swapped.byteswap().view(swapped.dtype.newbyteorder())


EQUAL: dict[str, Callable[[Any], Any]] = {
    "unpickled": lambda x: pickle.loads(pickle.dumps(x)),
    "out of band": lambda x: pickle.loads(pickle.dumps(x, 5)),
    "swapped back": swapped_back,
    "little": lambda x: x.view(np.dtype(x.dtype.newbyteorder()).newbyteorder("<")),
    "metadata": lambda x: x.view(np.dtype(x.dtype, metadata={"unit": "rad"})),
}
forms = pytest.mark.parametrize("form", EQUAL.values(), ids=EQUAL)


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return random_tree(2, 4, ["revolute", "prismatic"]).model


def inputs(model: sd.Model, count: int, batch: tuple[int, ...] = ()) -> list[Any]:
    """Vectors of a fixed model, whose nq is its nv."""
    return list(np.random.default_rng(count).normal(size=(count, *batch, model.nv)))


def fail(*arguments: Any, **named: Any) -> Any:
    raise AssertionError("the checked call was taken")


@forms
def test_the_dtypes_are_equal_and_not_the_same(form: Any) -> None:
    for dtype in (np.dtype(np.float64), np.dtype(np.float32)):
        made = form(np.arange(3, dtype=dtype))
        assert made.dtype == dtype
        assert made.dtype is not dtype
        np.testing.assert_array_equal(made, np.arange(3.0))


# --- the same code ----------------------------------------------------------------------------------------------


@COMPILED
@forms
@pytest.mark.parametrize("name", CALLS)
def test_a_sample_takes_the_kernel_at_once(
    arm: sd.Model, monkeypatch: pytest.MonkeyPatch, name: str, form: Any
) -> None:
    call, given = getattr(sd, name), inputs(arm, CALLS[name])
    expected = call(arm, *given)
    monkeypatch.setitem(dynamics.python_calls[name].__globals__, "checked_call", fail)
    out = form(np.zeros(expected.shape))
    np.testing.assert_array_equal(call(arm, *map(form, given)), expected)
    np.testing.assert_array_equal(call(arm, *[form(x)[::-1][::-1] for x in given]), expected)  # strided
    assert call(arm, *given, out=out) is out
    np.testing.assert_array_equal(out, expected)


@COMPILED
@forms
def test_optional_forces_too(arm: sd.Model, monkeypatch: pytest.MonkeyPatch, form: Any) -> None:
    given, fext = inputs(arm, 3), np.random.default_rng(0).normal(size=(arm.njoints, 6))
    expected = sd.rnea(arm, *given, fext)
    monkeypatch.setitem(dynamics.python_calls["rnea"].__globals__, "checked_call", fail)
    np.testing.assert_array_equal(sd.rnea(arm, *given, form(fext)), expected)


@COMPILED
@forms
@pytest.mark.parametrize("name", CALLS)
def test_a_batch_takes_the_program_at_once(
    arm: sd.Model, monkeypatch: pytest.MonkeyPatch, name: str, form: Any
) -> None:
    call, given = getattr(sd, name), inputs(arm, CALLS[name], (SAMPLES,))
    expected = call(arm, *given)
    monkeypatch.setattr(dynamics, "check_model", fail)
    for module, left in ((run, "batch"), (by_table_kernel, "run_table_kernel")):
        monkeypatch.setattr(module, left, fail)
    np.testing.assert_array_equal(call(arm, *map(form, given)), expected)
    out = form(np.zeros(expected.shape))
    assert call(arm, *given, out=out) is out
    np.testing.assert_array_equal(out, expected)


@COMPILED
@forms
def test_a_checked_batch_takes_the_program_too(arm: sd.Model, monkeypatch: pytest.MonkeyPatch, form: Any) -> None:
    """Two axes of samples."""
    given = inputs(arm, 3, (2, SAMPLES))
    expected = sd.rnea(arm, *given)
    monkeypatch.setattr(by_table_kernel, "run_table_kernel", fail)
    np.testing.assert_array_equal(sd.rnea(arm, *map(form, given)), expected)


@COMPILED
@forms
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_specialised_program_runs_on_them(
    arm: sd.Model, monkeypatch: pytest.MonkeyPatch, form: Any, dtype: Any
) -> None:
    made = sd.specialize(arm, sd.rnea, dtype=dtype)
    many = [x.astype(dtype) for x in inputs(arm, 3, (SAMPLES,))]
    expected = made(*many)
    monkeypatch.setattr(specialize_fallback, "compute", fail)
    np.testing.assert_array_equal(made(*map(form, many)), expected)
    out = form(np.zeros(expected.shape, dtype))
    assert made(*many, out=out) is out
    np.testing.assert_array_equal(out, expected)


@COMPILED
@forms
def test_a_specialised_program_takes_a_sample_of_them_at_once(
    arm: sd.Model, monkeypatch: pytest.MonkeyPatch, form: Any
) -> None:
    made, one = sd.specialize(arm, sd.rnea), inputs(arm, 3)
    expected, out = made(*one), form(np.zeros(arm.nv))
    monkeypatch.setattr(type(made), "_checked_call", fail)
    np.testing.assert_array_equal(made(*map(form, one)), expected)
    assert made(*one, out=out) is out
    np.testing.assert_array_equal(out, expected)


@pytest.mark.skipif(not single_call.READY, reason="nothing is compiled, or Python is not as expected")
@forms
def test_a_builtin_takes_them_and_no_other(arm: sd.Model, form: Any) -> None:
    sizes = {"nq": arm.nq, "nv": arm.nv, "njoints": arm.njoints}
    code = CallCode(numba_kernels.variant(SPECS["rnea"], frozenset()), arm)
    call, given = recorded_calls.recorded_call(code, sizes), inputs(arm, 3)
    while (expected := call(*given)) is None:  # plain Python answered for as long as compiling takes
        assert code.renew()
    np.testing.assert_allclose(expected, sd.rnea(arm, *given), rtol=1e-14)
    np.testing.assert_array_equal(call(*map(form, given)), expected)
    for k, other in enumerate((">f8", np.int64, np.float32, np.complex128, "M8[s]")):
        wrong = [x.astype(other) if at == k % 3 else x for at, x in enumerate(given)]
        assert call(*wrong) is None


def test_the_other_byte_order_is_not_equal() -> None:
    """Its numbers read in this machine's order are not numbers."""
    foreign, arm = np.dtype(np.float64).newbyteorder(), sd.load_urdf("two_link")
    many = np.random.default_rng(0).normal(size=(SAMPLES if not numba_kernels.PLAIN else 3, 2))
    np.testing.assert_array_equal(sd.crba(arm, many.astype(foreign)), sd.crba(arm, many))
    made = sd.specialize(arm, sd.crba)
    for q in (many, many[0]):
        np.testing.assert_array_equal(made(q.astype(foreign)), made(q))


@forms
def test_the_pinocchio_names_take_them(form: Any) -> None:
    six, model = np.arange(6.0), pin.Model()
    np.testing.assert_array_equal(pin.Motion(form(six)).vector, six)
    np.testing.assert_array_equal(pin.Motion(six.astype(">f8")).vector, six)
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(1, pin.Inertia(1.0, np.array([0.0, 0.0, 1.0]), np.eye(3)), pin.SE3.Identity())
    data, x = model.createData(), np.array([0.3])
    expected = pin.rnea(model, data, x, x, x).copy()
    for _ in range(3):  # as a builtin from the second call on
        np.testing.assert_array_equal(pin.rnea(model, data, form(x), form(x), form(x)), expected)


# --- another process --------------------------------------------------------------------------------------------


def answers(task: tuple[sd.Model, list[Any], list[Any]]) -> list[Any]:
    """What a worker computes: calls of one sample and of a batch, a program, a rollout."""
    model, one, many = task
    program = sd.specialize(model, sd.rnea)
    found = [getattr(sd, name)(model, *given[:count]) for name, count in CALLS.items() for given in (one, many)]
    found += [program(*one), program(*one), program(*many)]
    return [*found, *sd.rollout(model, *many[:2], dt=0.01, steps=3)]


@COMPILED
def test_a_spawned_worker_answers_as_its_parent(arm: sd.Model) -> None:
    task = arm, inputs(arm, 3), inputs(arm, 3, (SAMPLES,))
    expected = answers(task)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.apply(answers, (task,))
    assert len(found) == len(expected)
    for there, here in zip(found, expected, strict=True):
        np.testing.assert_array_equal(there, here)

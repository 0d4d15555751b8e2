"""Calls that record inputs and result."""

from __future__ import annotations

import sys
from array import array
from typing import Any

import numpy as np
import pytest
from trees import random_state, random_tree
from unfused import unfused

from spatialdyn.compat.native import recorded_calls, recorded_constraints
from spatialdyn.constraints.contact import Solved, solve
from spatialdyn.engines.compiled import entries
from spatialdyn.engines.compiled.numba_kernels import variant
from spatialdyn.engines.programs.run import single_call
from spatialdyn.engines.programs.run.call_code import CallCode
from spatialdyn.recursions import SPECS


@pytest.fixture(scope="module")
def case() -> Any:
    made = random_tree(2, 7, floating=True)
    return made.model, random_state(made.tree, np.random.default_rng(0))


STAMP = array("q", [0, 0])
compiled = pytest.mark.skipif(not single_call.READY, reason="nothing is compiled, or Python is not as expected")


def recorded(
    name: str,
    model: Any,
    memory: Any,
    result: Any,
    forces: bool = False,
    unused: int = 0,
    returns: int = 0,
    now: Any = None,
) -> Any:
    now, spec = np.zeros(1) if now is None else now, variant(SPECS[name], frozenset(["fext"] if forces else []))
    table = recorded_calls.Table(np.frombuffer(model.bodies.tobytes(), np.uint8), now, now.copy())
    entries.table_entry(spec).compile_now()
    sizes = {"nq": model.nq, "nv": model.nv, "njoints": model.njoints}
    count = len(spec.present) - forces + unused
    noted = recorded_calls.record(count, memory, result, STAMP, table)
    return recorded_calls.recorded_call(CallCode(spec, table), sizes, noted, unused, returns, result)


@compiled
def test_a_call_notes_its_inputs_and_its_result(case: Any) -> None:
    model, s = case
    tau, memory = np.empty(model.nv), np.empty(model.nq + 2 * model.nv)
    call = recorded("rnea", model, memory, tau)
    found = call(s.q, s.v, s.a)
    np.testing.assert_array_equal(found, unfused("rnea", model, s.q, s.v, s.a))
    np.testing.assert_array_equal(tau, found)
    np.testing.assert_array_equal(memory, np.concatenate([s.q, s.v, s.a]))
    assert not np.shares_memory(tau, found)


@compiled
def test_a_call_is_left_to_python_if_the_model_was_edited(case: Any) -> None:
    model, s = case
    tau, memory, now = np.zeros(model.nv), np.zeros(model.nq + 2 * model.nv), np.zeros(3)
    call = recorded("rnea", model, memory, tau, now=now)
    assert call(s.q, s.v, s.a) is not None
    memory[:] = 0.0
    now[2] = 1.0
    assert call(s.q, s.v, s.a) is None
    assert not memory.any()
    now[2] = 0.0
    assert call(s.q, s.v, s.a) is not None


@compiled
def test_a_result_may_be_returned_in_parts(case: Any) -> None:
    model, s = case
    result, memory = np.empty((3, model.nv, model.nv)), np.empty(model.nq + 2 * model.nv)
    found = recorded("rnea_derivatives", model, memory, result, returns=recorded_calls.PARTS)(s.q, s.v, s.a)
    np.testing.assert_array_equal(found, unfused("rnea_derivatives", model, s.q, s.v, s.a))
    np.testing.assert_array_equal(found, result)
    assert type(found) is tuple
    assert all(x.flags.owndata and sys.getrefcount(x) == 3 for x in found)
    assert sys.getrefcount(found) == 2


@compiled
@pytest.mark.parametrize("name", ["rnea", "static_torque"])
def test_forces_are_a_last_vector(case: Any, name: str) -> None:
    """They are not recorded, also where they are required."""
    model, s = case
    given = (s.q, s.v, s.a) if name == "rnea" else (s.q,)
    tau, memory = np.empty(model.nv), np.zeros(1 + sum(map(len, given)))
    call = recorded(name, model, memory[:-1], tau, forces=True)
    np.testing.assert_array_equal(call(*given, s.fext.ravel()), unfused(name, model, *given, s.fext))
    assert call(*given) is call(*given, s.fext.ravel()[:-1]) is None
    np.testing.assert_array_equal(memory, [*np.concatenate(given), 0.0])


@compiled
def test_a_result_may_stay_and_more_be_noted(case: Any) -> None:
    model, s = case
    X, memory, before = np.empty((model.njoints, 4, 4)), np.empty(model.nq + 2 * model.nv), recorded_calls.clock()
    call = recorded("forward_kinematics", model, memory, X, unused=2, returns=recorded_calls.RESULT)
    assert call(s.q, s.v, s.a) is True
    assert before < STAMP[0] < recorded_calls.clock()
    np.testing.assert_array_equal(X, unfused("forward_kinematics", model, s.q))
    np.testing.assert_array_equal(memory, np.concatenate([s.q, s.v, s.a]))


@compiled
def test_an_input_may_lie_in_the_result() -> None:
    """Also one that is only recorded, and one that runs backwards."""
    model = random_tree(3, 5, ["revolute"]).model
    n, count = model.nq, 16 * model.njoints
    q, memory = np.full(n, 0.1), np.empty(2 * n)
    room = np.random.default_rng(0).normal(size=n + count + n)
    X = room[n : n + count].reshape(model.njoints, 4, 4)
    call = recorded("forward_kinematics", model, memory, X, unused=1, returns=recorded_calls.RESULT)
    for given in (room[n : 2 * n], room[n + 2 : 2 : -1], room[n + count + n - 1 : n + count - 1 : -1]):
        before = given.copy()
        assert call(given, q) is True
        np.testing.assert_array_equal(X, unfused("forward_kinematics", model, before))
        before = given.copy()
        assert call(q, given) is True
        np.testing.assert_array_equal(memory[n : 2 * n], before)


@compiled
def test_a_failure_notes_nothing(case: Any) -> None:
    model, s = case
    tau, memory = np.zeros(model.nv), np.zeros(model.nq + 2 * model.nv)
    call = recorded("rnea", model, memory, tau)
    assert call(2.0 * s.q, s.v, s.a) is call(s.q, s.v, s.a * np.inf) is None
    assert not memory.any()
    assert not tau.any()


@compiled
def test_a_call_is_made_again_on_what_was_noted(case: Any) -> None:
    model, s = case
    out, again = np.empty((model.njoints, 6)), np.empty((model.njoints, 6))
    spec = variant(SPECS["joint_velocities"], frozenset())
    entries.table_entry(spec).compile_now()
    assert recorded_calls.rerun(CallCode(spec, model), [s.q, s.v], out)() is True
    np.testing.assert_array_equal(out, unfused("joint_velocities", model, s.q, s.v))
    assert recorded_calls.copier(out, again)() is True
    np.testing.assert_array_equal(again, out)


@pytest.mark.slow(quick="compat/test_rigid_constraints.py::test_constraint_dynamics_is_pinocchios")
@compiled
def test_the_answer_under_constraints_is_the_librarys(case: Any) -> None:
    model, s = case
    m, n, rng = 3, model.nv, np.random.default_rng(3)
    J, drift = rng.normal(size=(m, n)), rng.normal(size=m)
    arrays: dict[str, Any] = {"bias": np.empty(n), "before": np.zeros(1, np.int64)}
    own = Solved(np.empty(n), np.empty(m), np.empty((n, n)), np.empty((m, n)), np.empty((m, m)))
    arrays |= recorded_constraints.words_of_factors(own) | {"U": np.empty((n, n)), "D": np.empty(n)}
    clock = recorded_calls.address(recorded_calls.clock.now)
    words = {"table": model.address, "nq": model.nq, "nv": model.nv, "njoints": model.njoints, "clock": clock}
    call = recorded_constraints.dynamics.bind(words | arrays, model)
    bias = unfused("nonlinear_effects", model, s.q, s.v)
    expected = solve(model, unfused("crba", model, s.q), s.tau - bias, J, drift, 0.1)
    close = 1e-13 * abs(expected.x).max()  # the library's solver fuses products and sums
    np.testing.assert_allclose(call(s.q, s.v, s.tau, J, drift, 0.1), expected.x, rtol=0.0, atol=close)
    np.testing.assert_allclose(arrays["force"], expected.force, rtol=1e-12)
    U, D = arrays["U"], arrays["D"]
    np.testing.assert_allclose(U @ np.diag(D) @ U.T, unfused("crba", model, s.q), rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(U, np.triu(U))
    assert 0 < arrays["before"][0] == recorded_calls.clock.now[0]
    J[1] = J[0]
    kept = arrays["force"].copy()
    assert call(s.q, s.v, s.tau, J, drift, 0.0) is call(s.q, s.v, s.tau, J, drift, -1.0) is None
    np.testing.assert_array_equal(arrays["force"], kept)

"""Calls that record inputs and result, and operators on rows."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from trees import random_state, random_tree
from unfused import unfused

import spatialdyn as sd
from spatialdyn.compat.native import operator_kernels, recorded_calls, recorded_constraints
from spatialdyn.constraints.contact import solve
from spatialdyn.engines.compiled import cpython


@pytest.fixture(scope="module")
def case() -> Any:
    made = random_tree(2, 7, floating=True)
    return made.model, random_state(made.tree, np.random.default_rng(0))


TIME = np.zeros(1, np.int64)
compiled = pytest.mark.skipif(not cpython.READY, reason="nothing is compiled, or Python is not as expected")


def bound(function: Any, model: Any, arrays: dict[str, Any], **sizes: int) -> Any:
    numbers = np.zeros(1)
    table = recorded_calls.Table(np.frombuffer(model.bodies.tobytes(), np.uint8), numbers, numbers.copy())
    words = {"table": table.address, "nq": model.nq, "nv": model.nv, "njoints": model.njoints, **sizes}
    words |= {name: x.ctypes.data for name, x in arrays.items()}
    return function.bind(table, arrays, **words)


@compiled
def test_a_call_notes_its_inputs_and_its_result(case: Any) -> None:
    model, s = case
    tau, memory = np.empty(model.nv), np.empty(model.nq + 2 * model.nv)
    call = bound(recorded_calls.recorded_call("rnea"), model, {"memory": memory, "result": tau, "time": TIME})
    found = call(s.q, s.v, s.a)
    np.testing.assert_array_equal(found, unfused("rnea", model, s.q, s.v, s.a))
    np.testing.assert_array_equal(tau, found)
    np.testing.assert_array_equal(memory, np.concatenate([s.q, s.v, s.a]))
    assert not np.shares_memory(tau, found)


@compiled
def test_a_result_may_be_returned_in_parts(case: Any) -> None:
    model, s = case
    result, memory = np.empty((3, model.nv, model.nv)), np.empty(model.nq + 2 * model.nv)
    function = recorded_calls.recorded_call("rnea_derivatives", returns=recorded_calls.PARTS)
    call = bound(function, model, {"memory": memory, "result": result, "time": TIME})
    found = call(s.q, s.v, s.a)
    np.testing.assert_array_equal(found, unfused("rnea_derivatives", model, s.q, s.v, s.a))
    np.testing.assert_array_equal(found, result)
    assert type(found) is tuple
    assert all(x.flags.owndata and sys.getrefcount(x) == 3 for x in found)
    assert sys.getrefcount(found) == 2


@compiled
def test_forces_are_a_last_vector(case: Any) -> None:
    model, s = case
    tau, memory = np.empty(model.nv), np.empty(model.nq + 2 * model.nv)
    call = bound(
        recorded_calls.recorded_call("rnea", forces=True),
        model,
        {"memory": memory, "result": tau, "time": TIME},
    )
    np.testing.assert_array_equal(call(s.q, s.v, s.a, s.fext.ravel()), unfused("rnea", model, s.q, s.v, s.a, s.fext))
    assert call(s.q, s.v, s.a) is call(s.q, s.v, s.a, s.fext.ravel()[:-1]) is None


@compiled
def test_a_result_may_stay_and_more_be_noted(case: Any) -> None:
    model, s = case
    X, memory = np.empty((model.njoints, 4, 4)), np.empty(model.nq + 2 * model.nv)
    stamp, before = np.zeros(1, np.int64), recorded_calls.clock()
    function = recorded_calls.recorded_call("forward_kinematics", 2, recorded_calls.RESULT)
    assert bound(function, model, {"memory": memory, "result": X, "time": stamp})(s.q, s.v, s.a) is True
    assert before < stamp[0] < recorded_calls.clock()
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
    places = {"memory": memory, "result": X, "time": TIME}
    call = bound(recorded_calls.recorded_call("forward_kinematics", 1, recorded_calls.RESULT), model, places)
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
    call = bound(recorded_calls.recorded_call("rnea"), model, {"memory": memory, "result": tau, "time": TIME})
    assert call(2.0 * s.q, s.v, s.a) is call(s.q, s.v, s.a * np.inf) is None
    assert not memory.any()
    assert not tau.any()


@compiled
def test_a_call_is_made_again_on_what_was_noted(case: Any) -> None:
    model, s = case
    out = np.empty((model.njoints, 6))
    arrays = {"address0": s.q, "address1": s.v, "out": out}
    assert bound(recorded_calls.recompute("joint_velocities"), model, arrays)() is True
    np.testing.assert_array_equal(out, unfused("joint_velocities", model, s.q, s.v))


@compiled
def test_frames_are_placed_with_the_joints(case: Any) -> None:
    model, s = case
    frames = [f for f in model.frames if f.joint > 0]
    joints, placements = np.array([f.joint for f in frames]), np.array([f.placement for f in frames])
    X, out, memory = np.empty((model.njoints, 4, 4)), np.zeros((len(frames), 4, 4)), np.empty(model.nq)
    places = np.array([x.ctypes.data for x in placements])
    arrays = {"memory": memory, "poses": X, "result": out, "joints": joints, "placements": places}
    arrays |= {name: np.zeros(1, np.int64) for name in ("clock", "time", "time_of_joints")}
    assert bound(recorded_calls.place_frames(True), model, arrays, frames=len(frames))(s.q) is True
    for frame, found in zip(frames, out, strict=True):
        np.testing.assert_allclose(found, sd.frame_placement(model, s.q, frame), atol=1e-14)
    first = out.copy()
    out[:] = 0.0
    assert bound(recorded_calls.place_frames(False), model, arrays, frames=len(frames))() is True
    np.testing.assert_array_equal(out, first)


@pytest.mark.slow(quick="compat/test_rigid_constraints.py::test_constraint_dynamics_is_pinocchios")
@compiled
def test_the_answer_under_constraints_is_the_librarys(case: Any) -> None:
    model, s = case
    m, n, rng = 3, model.nv, np.random.default_rng(3)
    J, drift = rng.normal(size=(m, n)), rng.normal(size=m)
    arrays = {"memory": np.empty(model.nq + n), "bias": np.empty(n), "result": np.empty(n), "L": np.empty((n, n))}
    arrays |= {"Y": np.empty((m, n)), "C": np.empty((m, m)), "force": np.empty(m), "time": np.zeros(1, np.int64)}
    arrays |= {"before": np.zeros(1, np.int64), "scratch": recorded_constraints.scratch_of(n, m)}
    clock = recorded_calls.address(recorded_calls.clock.now)
    call = bound(recorded_constraints.dynamics(), model, arrays, m=m, clock=clock)
    bias = unfused("nonlinear_effects", model, s.q, s.v)
    expected = solve(model, unfused("crba", model, s.q), s.tau - bias, J, drift, 0.1)
    close = 1e-13 * abs(expected.x).max()  # the library's solver fuses products and sums
    np.testing.assert_allclose(call(s.q, s.v, s.tau, J, drift, 0.1), expected.x, rtol=0.0, atol=close)
    np.testing.assert_allclose(arrays["force"], expected.force, rtol=1e-12)
    assert 0 < arrays["before"][0] < arrays["time"][0] == recorded_calls.clock.now[0]
    J[1] = J[0]
    kept = arrays["force"].copy()
    assert call(s.q, s.v, s.tau, J, drift) is call(s.q, s.v, s.tau, J, drift, -1.0) is None
    np.testing.assert_array_equal(arrays["force"], kept)


def test_a_listed_operator_is_the_operator_row_by_row() -> None:
    rng = np.random.default_rng(1)
    a, b = np.empty((3, 4, 4)), rng.normal(size=(5, 6))
    exp6 = operator_kernels.on_arrays(operator_kernels.Formula.parsed("exp6(v: motion) -> pose", "exp_pose(v)"))
    for X in a:
        exp6(rng.normal(size=6), X)
    places, out, one = np.array([2, 0, 0, 1, 2]), np.empty((5, 6)), np.empty(6)
    recorded_calls.motions_to_parent(a, places, b, out)
    for k, place in enumerate(places):
        operator_kernels.motion_to_parent(a[place], b[k], one)
        np.testing.assert_array_equal(out[k], one)

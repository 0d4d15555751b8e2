"""Builtins that the face binds for later calls give what their calls give without them, also after an edit."""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable
from typing import Any
from weakref import ref

import numpy as np
import pytest

from spatialdyn.compat import pinocchio as pin
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.object_layout import Definition, words_at
from spatialdyn.engines.programs.llvm.call_words import PLAN
from spatialdyn.engines.programs.run.single_call import NO_LIMIT, change

CLOSE = {"rtol": 1e-12, "atol": 1e-12}


@pytest.fixture
def model() -> Any:
    return pin.buildSampleModelHumanoid()


def state(model: Any, seed: int) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(seed)
    q = pin.integrate(model, pin.neutral(model), rng.standard_normal(model.nv))
    return q, *rng.standard_normal((2, model.nv))


def of_new_data(model: Any, call: Callable[[Any], Any], prepare: Callable[[Any], Any]) -> Any:
    """What a call gives in a new Data, where nothing is bound."""
    data = model.createData()
    prepare(data)
    return call(data)


def test_body_regressors_follow_each_rnea_and_what_is_written_to_its_motions(model: Any) -> None:
    data = model.createData()

    def regressor(data: Any) -> Any:
        return pin.jointBodyRegressor(model, data, 3)

    for seed in range(3):
        for _ in range(2):
            pin.rnea(model, data, *state(model, seed))
            expected = of_new_data(model, regressor, lambda new, k=seed: pin.rnea(model, new, *state(model, k)))
            np.testing.assert_allclose(regressor(data), expected, **CLOSE)
            np.testing.assert_array_equal(regressor(data), regressor(data))
    data.v[3] = pin.Motion(np.arange(6.0))
    for _ in range(2):
        expected = pin.bodyRegressor(data.v[3], data.a_gf[3])
        np.testing.assert_allclose(regressor(data), expected, **CLOSE)
        data.v[3] = pin.Motion(np.ones(6))


def test_solutions_follow_each_decomposition(model: Any) -> None:
    data, tau = model.createData(), np.random.default_rng(0).standard_normal(model.nv)
    for seed in range(3):
        M = pin.crba(model, data, state(model, seed)[0])
        pin.cholesky.decompose(model, data)
        for x in (tau, tau[::-1], 2.0 * tau):
            found = pin.cholesky.solve(model, data, x)
            np.testing.assert_allclose(M @ found, x, rtol=0.0, atol=1e-10)
            np.testing.assert_array_equal(pin.cholesky.solve(model, data, x), found)
        U = pin.cholesky.decompose(model, data)
        np.testing.assert_array_equal(U, data.U)
        np.testing.assert_allclose(U @ np.diag(data.D) @ U.T, M, **CLOSE)
    data.M[...] = 0.0
    for _ in range(2):
        with pytest.raises(ValueError, match=r"data\.M is zero, expected crba"):
            pin.cholesky.decompose(model, data)
    np.testing.assert_array_equal(data.U, U)
    data.D[0] = -1.0
    with pytest.raises(ValueError, match=r"expected cholesky\.decompose to have been called"):
        pin.cholesky.solve(model, data, tau)


def test_configurations_are_compared_to_their_precision(model: Any) -> None:
    q, v, _ = state(model, 0)
    far = pin.integrate(model, q, 1e-3 * v / abs(v).max())
    minus = q.copy()
    minus[3:7] *= -1.0
    for _ in range(2):
        assert pin.isSameConfiguration(model, q, q, 0.0)
        assert pin.isSameConfiguration(model, q, minus, 1e-12)
        assert pin.isSameConfiguration(model, q, far, 1.001e-3)
        assert not pin.isSameConfiguration(model, q, far, 0.999e-3)
    off = q.copy()
    off[3:7] *= 1.0 + 1e-3
    assert pin.isNormalized(model, q)
    assert (pin.isNormalized(model, off, 1e-4), pin.isNormalized(model, off, 1e-2)) == (False, True)
    assert not pin.isNormalized(model, q, 0.0)
    for wrong in (-1.0, np.nan):
        with pytest.raises(ValueError, match="expected a number that is not negative"):
            pin.isNormalized(model, q, wrong)
        with pytest.raises(ValueError, match="expected a number that is not negative"):
            pin.isSameConfiguration(model, q, q, wrong)


@pytest.mark.parametrize("reference", [pin.LOCAL, pin.WORLD, pin.LOCAL_WORLD_ALIGNED])
def test_velocity_derivatives_follow_each_call_and_moved_joints(model: Any, reference: Any) -> None:
    data = model.createData()

    def derivatives(data: Any) -> Any:
        return pin.getFrameVelocityDerivatives(model, data, model.nframes - 1, reference)

    for seed in range(3):
        if seed == 2:
            model.jointPlacements[2].translation[0] += 0.1
        given = state(model, seed)

        def prepare(data: Any, given: Any = given) -> None:
            pin.computeForwardKinematicsDerivatives(model, data, *given)

        prepare(data)
        expected = of_new_data(model, derivatives, prepare)
        for _ in range(3):
            np.testing.assert_allclose(derivatives(data), expected, **CLOSE)
    before = derivatives(data)
    model.jointPlacements[2].translation[0] += 0.1  # after the call: its derivatives are those of its placements
    np.testing.assert_array_equal(derivatives(data), before)


def test_subtree_jacobians_follow_each_call_but_no_edit_after_it(model: Any) -> None:
    data = model.createData()

    def jacobian(data: Any) -> Any:
        return pin.getJacobianSubtreeCenterOfMass(model, data, 3)

    for seed in range(3):
        q = state(model, seed)[0]
        expected = of_new_data(model, jacobian, lambda new, q=q: pin.jacobianCenterOfMass(model, new, q))
        for _ in range(2):
            np.testing.assert_array_equal(pin.jacobianSubtreeCenterOfMass(model, data, q, 3), expected)
        model.inertias[5].mass *= 2.0
        pin.crba(model, data, q)  # writes the edit to the table
        np.testing.assert_array_equal(jacobian(data), expected)
    with pytest.raises(IndexError, match="joint index is 99"):
        pin.getJacobianSubtreeCenterOfMass(model, data, 99)


@pytest.mark.parametrize("reference", [pin.LOCAL, pin.WORLD, pin.LOCAL_WORLD_ALIGNED])
def test_kinematic_regressors_follow_poses_and_placements(model: Any, reference: Any) -> None:
    data, frame = model.createData(), model.nframes - 1

    def regressor(data: Any) -> Any:
        return pin.computeFrameKinematicRegressor(model, data, frame, reference)

    for seed in range(3):
        pin.forwardKinematics(model, data, state(model, seed)[0])
        for _ in range(2):
            joint, place = model.frames[frame].parentJoint, model.frames[frame].placement
            expected = pin.computeJointKinematicRegressor(model, data, joint, reference, place)
            np.testing.assert_array_equal(regressor(data), expected)
            np.testing.assert_array_equal(regressor(data), expected)
            model.jointPlacements[2].translation[0] += 0.1
            model.frames[frame].placement.translation[1] += 0.1
    with pytest.raises(ValueError, match="frame_id is 0, the universe"):
        pin.computeFrameKinematicRegressor(model, data, 0, reference)


def test_the_robots_inertia_follows_each_call_and_edits(model: Any) -> None:
    data = model.createData()
    for seed in range(4):
        q, v, _ = state(model, seed)
        pin.ccrba(model, data, q, v)
        expected = of_new_data(model, lambda new: new.Ig.copy(), lambda new, q=q, v=v: pin.ccrba(model, new, q, v))
        assert data.Ig == expected
        model.inertias[3].mass *= 1.5


def test_factors_that_were_read_follow_each_constrained_call(model: Any) -> None:
    data, rng = model.createData(), np.random.default_rng(0)
    J, drift = rng.standard_normal((3, model.nv)), rng.standard_normal(3)
    M = pin.crba(model, data, state(model, 0)[0])
    pin.cholesky.decompose(model, data)
    pin.cholesky.solve(model, data, J[0])  # holds U and D
    for seed in range(4):
        q, v, tau = state(model, seed)
        if seed % 2:
            pin.impulseDynamics(model, data, q, v, J)
        else:
            pin.forwardDynamics(model, data, q, v, tau, J, drift)
        U, M = data.U, pin.crba(model, model.createData(), q)
        np.testing.assert_allclose(U @ np.diag(data.D) @ U.T, M, **CLOSE)
        np.testing.assert_array_equal(U, np.triu(U))


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no builtins")
def test_a_call_keeps_its_run_and_plan_while_other_code_replaces_them() -> None:
    model = pin.buildSampleModelManipulator()
    data, q = model.createData(), np.zeros(model.nq)
    for _ in range(2):
        expected = pin.crba(model, data, q)
    run = data._runs["crba"]
    plan, seen = run.plan, []
    address, context, _ = words_at(int(plan[PLAN.index("program")]), 3)
    own = ctypes.PYFUNCTYPE(*[ctypes.c_int64] * 4)(address)

    def replacing(*given: int) -> int:
        valid = own(context, *given[1:])
        data._runs.clear()
        gc.collect()
        seen.extend(x() is not None for x in here)
        return valid

    entry = ctypes.PYFUNCTYPE(*[ctypes.c_int64] * 4)(replacing)
    change(plan, (ctypes.cast(entry, ctypes.c_void_p).value or 0, 0, NO_LIMIT.ctypes.data), entry)
    plan[PLAN.index("program")] = plan.ctypes.data
    here = ref(run), ref(plan)
    del run, plan
    np.testing.assert_array_equal(pin.crba(model, data, q), expected)
    assert seen == [True, True]
    assert [x() for x in here] == [None, None]


def test_calls_and_bound_builtins_leave_no_definitions_behind() -> None:
    """Definitions are never freed: none may be made for each call or Data."""
    model = pin.buildSampleModelManipulator()
    q = np.zeros(model.nq)

    def forces_held(data: Any) -> None:
        for _ in range(3):
            pin.rnea(model, data, q, q, q, [pin.Force.Zero()] * model.njoints)
            assert len(data.f) == model.njoints

    def definitions() -> int:
        gc.collect()
        return sum(type(x) is Definition for x in gc.get_objects())

    forces_held(model.createData())
    before = definitions()
    forces_held(model.createData())
    assert definitions() == before

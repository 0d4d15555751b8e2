"""Derivatives beyond the table of calls: results, required calls, errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from plain import mimics_in_plain_python

import spatialdyn.compat.pinocchio as ours
from spatialdyn.errors import InertiaError

theirs = pytest.importorskip("pinocchio")


def test_results_are_copies() -> None:
    model = ours.buildSampleModelManipulator()
    data = model.createData()
    q, v = ours.neutral(model), np.ones(model.nv)
    by_q, _, M = ours.computeRNEADerivatives(model, data, q, v, v)
    kept = by_q.copy()
    M[:] = 0.0
    ours.computeRNEADerivatives(model, data, q, 2 * v, v)
    np.testing.assert_array_equal(by_q, kept)
    assert data.M.any()


STEP = 1e-5  # of central differences of sixth order, off by its sixth power and by eps over it
DIFFERENCES = 1e-9  # of the largest entry


def by_differences(call: Any, model: Any, q: np.ndarray) -> np.ndarray:
    """∂/∂q along integrate, (..., nv)."""
    columns = []
    for e in np.eye(model.nv):
        at = [call(ours.integrate(model, q, k * STEP * e)) for k in (1, -1, 2, -2, 3, -3)]
        columns.append((45 * (at[0] - at[1]) - 9 * (at[2] - at[3]) + (at[4] - at[5])) / (60 * STEP))
    return np.stack(columns, -1)


def of_turning_axes() -> Any:
    """A model of joints whose axes rotate with their own coordinates, and of a spherical and a planar joint."""
    model, rng = ours.Model(), np.random.default_rng(5)
    composite = ours.JointModelComposite(ours.JointModelRX())
    composite.addJoint(ours.JointModelPY(), ours.SE3(ours.exp3(rng.normal(size=3)), rng.normal(size=3)))
    kinds = [
        ours.JointModelRZ(), ours.JointModelSphericalZYX(), composite, ours.JointModelSpherical(),
        ours.JointModelUniversal(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.6, 0.8])), ours.JointModelPlanar(),
    ]  # fmt: skip
    for k, kind in enumerate(kinds):
        place = ours.SE3(ours.exp3(rng.normal(size=3)), rng.normal(size=3))
        joint = model.addJoint(k, kind, place, f"joint{k}")
        model.appendBodyToJoint(joint, ours.Inertia(1.0 + k, rng.normal(size=3), np.diag([0.1, 0.2, 0.25])), place)
    return model


def test_derivatives_are_those_of_the_calls_where_the_wheels_are_not() -> None:
    model = of_turning_axes()
    data, rng = model.createData(), np.random.default_rng(0)
    q = ours.integrate(model, ours.neutral(model), rng.normal(size=model.nv))
    v, a = rng.normal(size=(2, model.nv))

    def near(x: np.ndarray, y: np.ndarray) -> bool:
        return bool(abs(x - y).max() <= DIFFERENCES * abs(y).max())

    by_q, by_v, M = ours.computeRNEADerivatives(model, data, q, v, a)
    assert near(by_q, by_differences(lambda x: ours.rnea(model, data, x, v, a), model, q))
    assert near(by_v @ v, 2.0 * (ours.nle(model, data, q, v) - ours.computeGeneralizedGravity(model, data, q)))
    assert near(M, ours.crba(model, data, q))

    def acceleration(x: np.ndarray, frame: Any) -> np.ndarray:
        ours.forwardKinematics(model, data, x, v, a)
        return np.array(ours.getAcceleration(model, data, model.njoints - 1, frame).vector)

    for frame in (ours.LOCAL, ours.WORLD):
        ours.computeForwardKinematicsDerivatives(model, data, q, v, a)
        found = ours.getJointAccelerationDerivatives(model, data, model.njoints - 1, frame)
        assert near(found[1], by_differences(lambda x, frame=frame: acceleration(x, frame), model, q))


def test_a_missing_earlier_call_is_named() -> None:
    model = ours.buildSampleModelManipulator()
    data, q, v = model.createData(), ours.neutral(model), np.ones(model.nv)
    with pytest.raises(RuntimeError, match="computeForwardKinematicsDerivatives to be called before"):
        ours.getJointVelocityDerivatives(model, data, 1, ours.LOCAL)
    ours.computeForwardKinematicsDerivatives(model, data, q, v)
    ours.getJointVelocityDerivatives(model, data, 1, ours.LOCAL)
    with pytest.raises(RuntimeError, match="with accelerations to be called before"):
        ours.getJointAccelerationDerivatives(model, data, 1, ours.LOCAL)
    with pytest.raises(TypeError, match="aba was not called"):
        ours.computeABADerivatives(model, data)
    with pytest.raises(RuntimeError, match="computeRNEADerivatives"):
        ours.getCentroidalDynamicsDerivatives(model, model.createData())
    with pytest.raises(RuntimeError, match="vcom was not computed"):
        ours.getCenterOfMassVelocityDerivatives(model, data)
    for pin in (ours, theirs):
        model = pin.buildSampleModelManipulator()
        data = model.createData()
        pin.computeForwardKinematicsDerivatives(model, data, q, v, v)
        with pytest.raises(ValueError, match="reference frame"):
            pin.getPointVelocityDerivatives(model, data, 1, pin.SE3.Identity(), pin.WORLD)
        with pytest.raises(ValueError, match=r"\(9,\)|size|dimension|expected"):
            pin.computeRNEADerivatives(model, data, q, v[:-1], v)
        with pytest.raises(TypeError):
            pin.computeABADerivatives(model, data, q, v)


def test_a_joint_that_moves_nothing_is_named() -> None:
    model = ours.Model()
    model.addJoint(0, ours.JointModelRZ(), ours.SE3.Identity(), "idle")
    with pytest.raises(InertiaError, match='joint "idle" has zero articulated inertia'):
        ours.computeABADerivatives(model, model.createData(), np.zeros(1), np.zeros(1), np.zeros(1))


def test_derivatives_of_models_with_mimic_joints_are_those_of_the_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    mimics_in_plain_python(monkeypatch)
    model = ours.transformJointIntoMimic(ours.buildSampleModelManipulator(), 2, 3, 2.0, 0.1)
    data, other = model.createData(), model.createData()
    q, v, a = np.random.default_rng(0).normal(size=(3, model.nv))
    found = [
        (ours.computeRNEADerivatives(model, data, q, v, a)[0], lambda q: ours.rnea(model, other, q, v, a)),
        (ours.computeABADerivatives(model, data, q, v, a)[0], lambda q: ours.aba(model, other, q, v, a)),
        (
            ours.computeGeneralizedGravityDerivatives(model, data, q),
            lambda q: ours.computeGeneralizedGravity(model, other, q),
        ),
        (
            ours.computeCentroidalDynamicsDerivatives(model, data, q, v, a)[1],
            lambda q: ours.computeCentroidalMomentumTimeVariation(model, other, q, v, a).vector.copy(),
        ),
    ]
    for derivative, call in found:
        expected = by_differences(call, model, q)
        assert abs(derivative - expected).max() <= DIFFERENCES * abs(expected).max()

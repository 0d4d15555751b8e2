"""Derivatives of the face beside the table of calls: what they return, ask for and refuse."""

from __future__ import annotations

import numpy as np
import pytest

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


def test_what_has_to_come_before_is_asked_for() -> None:
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
    with pytest.raises(InertiaError, match='joint "idle" moves no inertia'):
        ours.computeABADerivatives(model, model.createData(), np.zeros(1), np.zeros(1), np.zeros(1))

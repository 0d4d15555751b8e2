"""Derivatives of the face and Pinocchio's, the same text under both: results, and the fields of data that they fill."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as ours
from spatialdyn.compat.pinocchio.kinds import KINDS
from spatialdyn.errors import InertiaError
from spatialdyn.urdf import find_robot

theirs = pytest.importorskip("pinocchio")

ROBOTS = (("panda", "fixed"), ("anymal_b_simple_description/robots/anymal", "floating"), ("talos_full", "floating"))
DERIVED = 1e-9  # of the largest entry: forward derivatives go through M⁻¹ of talos, whose condition number is 1e5
# kind of call whose fields are compared, or none, and the text
ROWS = (
    ("rnea_derivatives", "pin.computeRNEADerivatives(model, data, q, v, a)"),
    ("rnea_derivatives", "pin.computeRNEADerivatives(model, data, q, v, a, fext)"),
    ("aba_derivatives", "pin.computeABADerivatives(model, data, q, v, tau)"),
    ("aba_derivatives", "pin.computeABADerivatives(model, data, q, v, tau, fext)"),
    ("", "pin.aba(model, data, q, v, tau, pin.Convention.WORLD); pin.computeABADerivatives(model, data)"),
    ("gravity_derivatives", "pin.computeGeneralizedGravityDerivatives(model, data, q)"),
    ("static_derivatives", "pin.computeStaticTorqueDerivatives(model, data, q, fext)"),
    ("kinematics_derivatives1", "pin.computeForwardKinematicsDerivatives(model, data, q, v)"),
    ("kinematics_derivatives2", "pin.computeForwardKinematicsDerivatives(model, data, q, v, a)"),
    ("centroidal_derivatives", "pin.computeCentroidalDynamicsDerivatives(model, data, q, v, a)"),
    ("", "pin.computeRNEADerivatives(model, data, q, v, a); pin.getCentroidalDynamicsDerivatives(model, data)"),
    ("", "pin.centerOfMass(model, data, q, v); pin.getCenterOfMassVelocityDerivatives(model, data)"),
    *(
        ("", f"prepare(); [pin.{name}(model, data, k, {more}r) for k in {which} for r in references]")
        for name, which, more in (
            ("getJointVelocityDerivatives", "joints", ""),
            ("getJointAccelerationDerivatives", "joints", ""),
            ("getFrameVelocityDerivatives", "frames", ""),
            ("getFrameAccelerationDerivatives", "frames", ""),
            ("getFrameVelocityDerivatives", "joints", "placement, "),
            ("getFrameAccelerationDerivatives", "joints", "placement, "),
        )
    ),
    *(
        ("", f"prepare(); [pin.{name}(model, data, k, placement, r) for k in joints for r in references[::2]]")
        for name in ("getPointVelocityDerivatives", "getPointClassicAccelerationDerivatives")
    ),
)


def array(x: Any) -> np.ndarray:
    """Anything that a call returns or a field holds as one array of numbers."""
    if x is None:
        return np.zeros(0)
    for name in ("homogeneous", "vector"):
        if hasattr(x, name):
            return np.array(getattr(x, name))
    if hasattr(x, "lever"):
        return np.array(x.matrix())
    if isinstance(x, np.ndarray) or np.isscalar(x):
        return np.array(x, float)
    return np.array([array(y) for y in x])


def equal(found: Any, expected: Any) -> bool:
    x, y = array(found), array(expected)
    return x.shape == y.shape and bool(abs(x - y).max(initial=0.0) <= DERIVED * abs(y).max(initial=1.0))


def scope(pin: Any, path: str, root: str) -> dict[str, Any]:
    """What a text speaks of, under one of the modules."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of inertias that no body can have
        model = pin.buildModelFromUrdf(path, *([pin.JointModelFreeFlyer()] if root == "floating" else []))
    rng = np.random.default_rng(3)
    step, v, a, tau = rng.normal(size=(4, model.nv))
    made = {
        "pin": pin, "model": model, "v": v, "a": a, "tau": tau, "q": pin.integrate(model, pin.neutral(model), step),
        "fext": [pin.Force(x) for x in rng.normal(size=(model.njoints, 6))],
        "joints": [1, model.njoints // 2, model.njoints - 1], "frames": [0, model.nframes // 2, model.nframes - 1],
        "placement": pin.SE3(pin.exp3(np.array([0.3, -0.4, 0.5])), np.array([0.1, 0.2, -0.3])),
        "references": (pin.LOCAL, pin.WORLD, pin.LOCAL_WORLD_ALIGNED),
    }  # fmt: skip

    def prepare() -> None:
        pin.computeForwardKinematicsDerivatives(model, made["data"], made["q"], v, a)
        pin.updateFramePlacements(model, made["data"])

    return {**made, "prepare": prepare, "made": made}


def value(text: str, given: dict[str, Any]) -> Any:
    given["data"] = given["made"]["data"] = given["model"].createData()
    *before, last = text.split("; ")
    for line in before:
        exec(line, given)
    return eval(last, given)


@pytest.fixture(scope="module", params=ROBOTS, ids=lambda p: f"{p[0].split('/')[-1]}-{p[1]}")
def both(request: pytest.FixtureRequest) -> tuple[dict[str, Any], dict[str, Any]]:
    name, root = request.param
    path = str(find_robot(name))
    left, right = scope(ours, path, root), scope(theirs, path, root)
    right["q"] = right["made"]["q"] = left["q"]
    return left, right


@pytest.mark.parametrize(("kind", "text"), ROWS)
def test_derivatives_equal_the_wheels(both: Any, kind: str, text: str) -> None:
    left, right = both
    assert equal(value(text, left), value(text, right))
    fields = KINDS[kind].fills if kind else {}
    assert [f for f in fields if not equal(getattr(left["data"], f), getattr(right["data"], f))] == []


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

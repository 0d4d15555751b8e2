"""``pinocchio.casadi``: expressions against the numbers of the same names."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as pin
from spatialdyn.compat.pinocchio import casadi as cpin
from spatialdyn.compat.pinocchio.coverage.coverage import OUT_OF_SCOPE, SUPPORTED, entry

casadi = pytest.importorskip("casadi")
CLOSE = 1e-12  # of the largest entry
CALLS = ("rnea", "aba", "crba", "computeMinverse", "computeGeneralizedGravity", "nonLinearEffects")
FIELDS = {"rnea": "tau", "aba": "ddq", "crba": "M", "computeMinverse": "Minv", "nonLinearEffects": "nle"}


def close(found: Any, wanted: Any) -> None:
    wanted = np.asarray(wanted)
    size = max(1.0, abs(wanted).max())
    np.testing.assert_allclose(np.asarray(found).reshape(wanted.shape), wanted, rtol=0.0, atol=CLOSE * size)


def floating_arm() -> pin.Model:
    """A free flyer and a joint with cos and sin."""
    model = pin.Model()
    for k, joint in enumerate((pin.JointModelFreeFlyer(), pin.JointModelRUBY())):
        at = model.addJoint(k, joint, pin.SE3.Random(), f"joint{k}")
        model.appendBodyToJoint(at, pin.Inertia.Random(), pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", at, 0, pin.SE3.Random(), pin.OP_FRAME))
    return model


def given(name: str, q: Any, v: Any, a: Any) -> tuple[Any, ...]:
    return (q, v, a) if name in ("rnea", "aba") else (q, v) if name == "nonLinearEffects" else (q,)


@pytest.mark.parametrize("kind", ["SX", "MX"])
def test_calls_and_poses_are_the_numbers_of_the_same_names(kind: str) -> None:
    model = floating_arm()
    data, q, sym = model.createData(), pin.randomConfiguration(model), getattr(casadi, kind).sym
    v, a = np.random.default_rng(1).standard_normal((2, model.nv))
    cmodel = cpin.Model(model)
    cdata, x = (
        cmodel.createData(),
        [sym(name, n) for name, n in zip("qva", (cmodel.nq, model.nv, model.nv), strict=True)],
    )
    for name in CALLS:
        found = getattr(cpin, name)(cmodel, cdata, *given(name, *x))
        value = casadi.Function(name, x, [found])(q, v, a)
        close(value, getattr(pin, name)(model, data, *given(name, q, v, a)))
        assert getattr(cdata, FIELDS.get(name, "g")) is found
    cpin.framesForwardKinematics(cmodel, cdata, x[0])
    tip = cdata.oMf[cmodel.getFrameId("tip")]
    moved = cpin.integrate(cmodel, x[0], x[1])
    parts = [tip.rotation, tip.translation, moved, cpin.difference(cmodel, x[0], moved)]
    found = casadi.Function("parts", x, parts)(q, v, a)
    pin.framesForwardKinematics(model, data, q)
    wanted = data.oMf[model.getFrameId("tip")]
    expected = (wanted.rotation, wanted.translation, pin.integrate(model, q, v))
    for one, other in zip(found, (*expected, pin.difference(model, q, expected[2])), strict=True):
        close(one, other)


def test_log3_and_its_derivative_are_right_also_at_the_identity() -> None:
    R = casadi.SX.sym("R", 3, 3)
    w = casadi.SX.sym("w", 3)
    log = casadi.Function("log", [R], [cpin.log3(R)])
    turn = casadi.SX.eye(3) + casadi.skew(w)  # exp(w) to first order
    slope = casadi.Function("slope", [R, w], [casadi.jacobian(cpin.log3(R @ turn), w)])
    for rotation in (np.eye(3), pin.exp3(np.array([0.3, -1.0, 2.0])), pin.exp3(np.array([1e-9, 0.0, 0.0]))):
        close(log(rotation), pin.log3(rotation))
        close(slope(rotation, np.zeros(3)), pin.Jlog3(rotation))


def test_a_models_numbers_are_those_at_its_construction() -> None:
    model = floating_arm()
    cmodel, q = cpin.Model(model), pin.neutral(model)
    weight = pin.computeGeneralizedGravity(model, model.createData(), q)
    model.gravity.linear = np.zeros(3)
    close(cpin.computeGeneralizedGravity(cmodel, cmodel.createData(), q), weight)


def test_its_names_are_in_the_coverage() -> None:
    assert entry("casadi.rnea").status == SUPPORTED
    assert entry("casadi.computeCollisions").status == OUT_OF_SCOPE


def test_frames_centres_and_constraints_are_the_numbers_of_the_same_names() -> None:
    """What clients take of the poses, motions and Jacobians of frames, of centres of mass, and of contacts."""
    model = floating_arm()
    data, tip = model.createData(), model.getFrameId("tip")
    q, rng = pin.randomConfiguration(model), np.random.default_rng(2)
    v, a, fext = *rng.standard_normal((2, model.nv)), rng.standard_normal((model.njoints, 6))
    cmodel = cpin.Model(model)
    cdata = cmodel.createData()
    x = [casadi.SX.sym(name, n) for name, n in zip("qva", (model.nq, model.nv, model.nv), strict=True)]
    found, wanted = [], []
    cpin.centerOfMass(cmodel, cdata, *x)
    found += [cdata.com[0], cdata.vcom[0], cdata.acom[0]]
    pin.centerOfMass(model, data, q, v, a)
    wanted += [np.array(y[0]) for y in (data.com, data.vcom, data.acom)]
    cpin.forwardKinematics(cmodel, cdata, *x)
    cpin.updateFramePlacements(cmodel, cdata)
    cpin.computeJointJacobians(cmodel, cdata, x[0])
    pin.forwardKinematics(model, data, q, v, a)
    pin.computeJointJacobians(model, data, q)
    for reference in (pin.LOCAL, pin.WORLD, cpin.ReferenceFrame.LOCAL_WORLD_ALIGNED):
        for name in ("getFrameVelocity", "getFrameAcceleration", "getFrameClassicalAcceleration"):
            found.append(getattr(cpin, name)(cmodel, cdata, tip, reference).vector)
            wanted.append(getattr(pin, name)(model, data, tip, reference).vector)
        found.append(cpin.computeFrameJacobian(cmodel, cdata, x[0], tip, reference))
        wanted.append(pin.getFrameJacobian(model, data, tip, reference))
    forces = [cmodel.frames[tip].placement * cpin.Force(y) for y in fext]
    given = [model.frames[tip].placement * pin.Force(y) for y in fext]
    for name in ("rnea", "aba"):
        found.append(getattr(cpin, name)(cmodel, cdata, *x, forces))
        wanted.append(getattr(pin, name)(model, data, q, v, a, given))
        derivatives = f"compute{name.upper()}Derivatives"
        found += getattr(cpin, derivatives)(cmodel, cdata, *x)
        wanted += getattr(pin, derivatives)(model, data, q, v, a)
    J = np.asarray(pin.computeFrameJacobian(model, data, q, tip)[:3])
    found.append(cpin.forwardDynamics(cmodel, cdata, *x, J, np.ones(3), 1e-3))
    wanted.append(pin.forwardDynamics(model, data, q, v, a, J, np.ones(3), 1e-3))
    found.append(cdata.lambda_c)
    wanted.append(np.array(data.lambda_c))
    for aligned in (pin.LOCAL, pin.LOCAL_WORLD_ALIGNED):
        place = model.frames[tip].placement
        ours, theirs = (
            p.RigidConstraintModel(kind.CONTACT_3D, m, 2, place, aligned)
            for p, kind, m in ((cpin, cpin.ContactType, cmodel), (pin, pin.ContactType, model))
        )
        cpin.initConstraintDynamics(cmodel, cdata, [ours])
        found.append(cpin.constraintDynamics(cmodel, cdata, *x, [ours]))
        wanted.append(pin.constraintDynamics(model, data, q, v, a, [theirs], [theirs.createData()]))
    cpin.computeAllTerms(cmodel, cdata, *x[:2])
    pin.computeAllTerms(model, data, q, v)
    for name in ("M", "nle", "g", "J", "Ag", "kinetic_energy", "potential_energy"):
        found.append(getattr(cdata, name))
        wanted.append(getattr(data, name))
    for one, other in zip(casadi.Function("found", x, found)(q, v, a), wanted, strict=True):
        close(one, other)


def test_exponentials_and_logarithms_undo_each_other() -> None:
    rng = np.random.default_rng(0)
    v = casadi.SX.sym("v", 6)
    M, w = cpin.exp6(v), np.append(rng.standard_normal(3), [0.3, -1.0, 0.5])
    group = cpin.liegroups.SE3()
    seven = group.integrate(pin.SE3ToXYZQUAT(pin.SE3.Identity()), v)
    parts = [M.np, cpin.log6(M).np, cpin.log3(cpin.exp3(v[3:])), cpin.log3(cpin.exp3_quat(v[3:]))]
    parts += [cpin.log6_quat(seven).vector, (M.inverse() * M).homogeneous, M.actInv(M.act(cpin.Motion(v))).vector]
    found = casadi.Function("parts", [v], parts)(w)
    wanted = (pin.exp6(w).np, w, w[3:], w[3:], w, np.eye(4), w)
    for one, other in zip(found, wanted, strict=True):
        close(one, other)
    slope = casadi.Function("slope", [v], [casadi.jacobian(cpin.log6(M).vector, v)])
    close(slope(np.zeros(6)), np.eye(6))
    with pytest.raises(ValueError, match=r"vector has shape \(5, 1\)"):
        cpin.Force(np.zeros(5))
    with pytest.raises(TypeError, match=r"fext\[0\] is"):
        cpin.rnea(cpin.Model(floating_arm()), cpin.Data(), [0.0], [0.0], [0.0], [1.0])

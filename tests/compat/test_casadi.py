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

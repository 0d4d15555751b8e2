"""Wrong arguments of value types, of functions of them, and of calls: refused where Pinocchio refuses them."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as ours
from spatialdyn.compat.pinocchio.types.arguments import OMITTED, SizeError
from spatialdyn.errors import ShapeError, SpatialDynError

theirs = pytest.importorskip("pinocchio")

KINDS = TypeError, IndexError, ValueError, RuntimeError, OverflowError  # that a client may catch
TYPES = """
Motion Force Inertia SE3 Quaternion AngleAxis Symmetric3 PseudoInertia LogCholeskyParameters Frame log3 exp3 log6 exp6
log exp Jlog3 Jexp3 Jlog6 Jexp6 XYZQUATToSE3 SE3ToXYZQUAT SE3ToXYZQUATtuple skew unSkew rpy.rpyToMatrix rpy.matrixToRpy
log6_quat exp6_quat exp3_quat
"""
SIZES = ((0,), (3,), (4,), (5,), (6,), (7,), (10,), (3, 1), (6, 1), (1, 6), (2, 3), (3, 3), (4, 4), (6, 6))
NO_ARGUMENT = """
forwardKinematics(m, d, None)  forwardKinematics(m, d, q, None)  forwardKinematics(m, d, q, v, None)
forwardKinematics(m, d, q, None, v)  forwardKinematics(m, d, q, v, a=None)  computeJointJacobians(m, d, None)
computeJointJacobians(m, d, q=None)  computeMinverse(m, d, None)  computeKineticEnergy(m, d, None)
computeKineticEnergy(m, d, q)  computeKineticEnergy(m, d, q, None)  computeKineticEnergy(m, d, None, None)
computePotentialEnergy(m, d, None)  computeMechanicalEnergy(m, d, None, None)  computeMechanicalEnergy(m, d, q, None)
centerOfMass(m, d, q, None, None)  jacobianCenterOfMass(m, d, "q")  computeCentroidalMomentum(m, d, None)
computeCentroidalMomentum(m, d, None, None)  computeCentroidalMomentumTimeVariation(m, d, None, None, None)
computeABADerivatives(m, d, None)  computeABADerivatives(m, d, q, v, None)
computeABADerivatives(m, d, None, None, None)  computeForwardKinematicsDerivatives(m, d, q, v, None)
rnea(m, d, q, v, None)  crba(m, d, q, None)
getFrameVelocity(m, d, 1, None)  getVelocity(m, d, 1, None)  getFrameJacobian(m, d, 1, None)
Model(None)  Data(None)  isNormalized(m, q, None)  computeTotalMass(m, None)  randomConfiguration(m, None, None)
rnea(m, d, q, v, v, None)  aba(m, d, q, v, v, None)  aba(m, d, q, v, v, None, pin.Convention.WORLD)
computeStaticTorque(m, d, q, None)  computeRNEADerivatives(m, d, q, v, v, None)  dIntegrate(m, q, v, None)
computeABADerivatives(m, d, q, v, v, None)  dDifference(m, q, q, None)  randomConfiguration(m, q)
randomConfiguration(m, upper_bound=q)  JointModelRX().hasSameIndexes(q)
m.copy().appendBodyToJoint(1, pin.Inertia.Zero(), None)  classicAcceleration(pin.Motion.Zero(), None)
"""
REPEATED = 2  # rounds on one data: a builtin answers where a first call was recorded


def values(pin: Any) -> dict[str, Any]:
    """Arguments by name; what a type takes is among them."""
    rng = np.random.default_rng(0)
    arrays = {f"{x}": rng.normal(size=x) for x in SIZES} | {f"NaN {x}": np.full(x, np.nan) for x in SIZES[1::4]}
    given = {"None": None, "str": "a", "list": [0.0] * 6, "float": 1.5, "int": 2, "NaN": np.nan, "object": object()}
    types = ("SE3", "Motion", "Force", "Inertia", "Quaternion", "AngleAxis", "Symmetric3")
    others = {"int (6,)": np.zeros(6, int), "complex (6,)": np.zeros(6, complex), "str (3,)": np.array(["a"] * 3)}
    return {**given, **arrays, **others, **{x: getattr(pin, x)() for x in types}, "eye": np.eye(3)}


def attempt(function: Any, *arguments: Any) -> Any:
    """What a function returns, or the error that it raises."""
    try:
        return function(*arguments)
    except Exception as error:
        return error


def disagreement(x: Any, y: Any) -> str:
    """What is wrong with ours where theirs is an error, or neither is; "" if nothing is."""
    if not isinstance(y, Exception):
        return f"raises {x!r}, the wheel gives {y!r}" if isinstance(x, Exception) else ""
    if type(x) is TypeError and "positional argument" in str(x):
        return "" if isinstance(y, TypeError) else f"raises {x!r}, the wheel {y!r}"  # of their number
    if not isinstance(x, SpatialDynError):
        return f"gives {x!r}, the wheel raises {y!r}"
    kind = next(kind for kind in (*KINDS, Exception) if isinstance(y, kind))
    if not isinstance(x, kind):
        return f"raises {x!r}, the wheel {y!r}"
    return "" if "expected" in str(x) else f"says {x}, not what was expected"


def function(pin: Any, name: str) -> Any:
    module, _, last = name.rpartition(".")
    return getattr(getattr(pin, module) if module else pin, last)


@pytest.mark.parametrize("name", TYPES.split())
def test_wrong_arguments_of_values_are_refused_as_by_the_wheel(name: str) -> None:
    mine, other = values(ours), values(theirs)
    three = [keys for x in mine for keys in ((x, "(3,)", "eye"), ("float", x, "eye"), ("float", "(3,)", x))]
    wrong = []
    for keys in [(), *product(mine), *product(mine, mine), *three]:
        x = attempt(function(ours, name), *(mine[key] for key in keys))
        y = attempt(function(theirs, name), *(other[key] for key in keys))
        if name == "Quaternion" and len(keys) == 2 and not isinstance(y, Exception) and any("NaN" in k for k in keys):
            continue  # NaN has no direction
        if found := disagreement(x, y):
            wrong.append(f"{name}({', '.join(keys)}) {found}")
    assert not wrong, wrong[:5]


@pytest.mark.parametrize("round_", range(REPEATED))
def test_none_is_no_argument_that_was_left_out(round_: int) -> None:
    wrong = []
    scopes = []
    for pin in (ours, theirs):
        model = pin.buildSampleModelManipulator()
        data, q, v = model.createData(), pin.neutral(model), np.ones(model.nv)
        scopes.append({"pin": pin, "m": model, "d": data, "q": q, "v": v})
        pin.computeJointJacobians(model, data, q)
        for _ in range(round_):
            pin.forwardKinematics(model, data, q, v, v)
            pin.forwardKinematics(model, data, q, v)
            pin.aba(model, data, q, v, v)
            pin.computeAllTerms(model, data, q, v)
            for _ in range(2):
                pin.isNormalized(model, q), pin.computeTotalMass(model), pin.randomConfiguration(model, q - 1.0, q)
    for call in (x for line in NO_ARGUMENT.strip().split("\n") for x in line.split("  ")):
        text = call if call.startswith("m.") else f"pin.{call}"
        x, y = (attempt(eval, text, scope) for scope in scopes)
        assert isinstance(y, Exception), call
        if found := disagreement(x, y):
            wrong.append(f"{call} {found}")
    assert not wrong, wrong


def test_none_is_the_flag_of_the_centre_of_mass_as_in_the_wheel() -> None:
    for pin in (ours, theirs):
        model = pin.buildSampleModelManipulator()
        data, q = model.createData(), pin.neutral(model)
        whole = pin.centerOfMass(model, data, q).copy()
        for _ in range(REPEATED):
            assert (pin.centerOfMass(model, data, q, None) == whole).all()
            assert (pin.centerOfMass(model, data, None) == whole).all()
            assert pin.jacobianCenterOfMass(model, data, None).shape == (3, model.nv)


def test_a_wrong_size_is_each_kind_of_error_that_the_wheel_raises() -> None:
    for call in (lambda: ours.SE3(np.zeros(3)), lambda: ours.log3(np.zeros(7)), lambda: ours.XYZQUATToSE3([0.0] * 6)):
        for kind in (TypeError, ValueError, RuntimeError, ShapeError, SizeError):
            with pytest.raises(kind, match="expected"):
                call()


def test_the_one_argument_may_have_its_name_and_no_two_may_be_given() -> None:
    x = np.arange(6.0)
    assert ours.Motion(array=x) == ours.Motion(x) == ours.Motion(clone=ours.Motion(x))
    for call, text in (
        (lambda: ours.Motion(array=x, clone=ours.Motion(x)), "Motion got an array of shape"),
        (lambda: ours.Motion(angular=x[:3]), "Motion got angular alone, expected linear too"),
        (lambda: ours.SE3(np.eye(4), clone=ours.SE3()), "SE3 got an array of shape"),
        (lambda: ours.SE3(translation=x[:3]), "rotation is left out, expected"),
        (lambda: ours.Inertia(1.0, x[:3]), "Inertia got a float, an array of shape"),
        (lambda: ours.rpy.rpyToMatrix(0.1, 0.2), "yaw is left out, expected a number"),
    ):
        with pytest.raises(TypeError, match=text):
            call()
    assert repr(OMITTED) == "..."

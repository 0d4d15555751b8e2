"""Strict mode, and coordinates off their unit norm."""

from __future__ import annotations

import doctest
import os
import pickle
import subprocess
import sys
import warnings
from typing import Any

import numpy as np
import pytest
from slow import slow_but

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours
from spatialdyn.engines.compiled import jit, numba_kernels, tiers

theirs = pytest.importorskip("pinocchio")

FACE = "spatialdyn.compat.pinocchio"
UNIT_KINDS = ("FreeFlyer", "Spherical", "RUBZ", "Planar")
ROUNDING = 1e-12  # of the largest entry: products of a dozen numbers of size 3
# a dozen products of a matrix whose entries are up to 3, joint after joint
CHAIN = 1e-10
SEEN = """
rnea(m, d, q, v, a)  rnea(m, d, q, v, a, f)  nonLinearEffects(m, d, q, v)  computeGeneralizedGravity(m, d, q)
computeStaticTorque(m, d, q, f)  aba(m, d, q, v, a)  aba(m, d, q, v, a, f)  computeJointJacobians(m, d, q)
computeJointJacobian(m, d, q, 2)  computeFrameJacobian(m, d, q, 1)  centerOfMass(m, d, q)
jacobianCenterOfMass(m, d, q)  computeKineticEnergy(m, d, q, v)  computePotentialEnergy(m, d, q)
integrate(m, q, v)  normalize(m, q)  dIntegrate(m, q, v)
computeCentroidalMomentum(m, d, q, v)  computeCentroidalMomentumTimeVariation(m, d, q, v, a)
"""
FIELDS = "oMi liMi oMf v a J tau ddq"
OTHERS = """
crba(m, d, q)  computeMinverse(m, d, q)  computeCoriolisMatrix(m, d, q, v)  ccrba(m, d, q, v)  dccrba(m, d, q, v)
computeRNEADerivatives(m, d, q, v, a)  computeABADerivatives(m, d, q, v, a)  computeJointTorqueRegressor(m, d, q, v, a)
dDifference(m, q, q1)  computeAllTerms(m, d, q, v)
"""


JACOBIANS = (
    "computeJointJacobians(m, d, q); updateFramePlacements(m, d); getFrameJacobian(m, d, 4",
    "computeJointJacobians(m, d, q); getJointJacobian(m, d, 5",
    "computeFrameJacobian(m, d, q, 4",
)
RATES = "computeJointJacobiansTimeVariation(m, d, q, v)"
DIFFERENT = f"""
{RATES}  {RATES}; updateFramePlacements(m, d); getFrameJacobianTimeVariation(m, d, 4, pin.LOCAL)
{RATES}; getJointJacobianTimeVariation(m, d, 5, pin.WORLD)  computeCentroidalMap(m, d, q)
centerOfMass(m, d, q, v, a); d.vcom[0]  centerOfMass(m, d, q, v, a); d.acom[0]
"""
MOVING = """
integrate(m, q, v)  difference(m, q, q1)  interpolate(m, q, q1, 0.3)  distance(m, q, q1)  squaredDistance(m, q, q1)
"""
SAME = "interpolate(m, q, q, 0.3)"  # of a planar joint off the unit circle the sign of a rounding error decides


def calls(text: str) -> list[str]:
    return [call for line in text.strip().split("\n") for call in line.split("  ")]


def tree(pin: Any, *kinds: str) -> Any:
    """A chain of joints of these kinds, each with a body and a frame."""
    rng = np.random.default_rng(3)
    model = pin.Model()
    for k, kind in enumerate(kinds):
        place, there = (pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(2))
        at = model.addJoint(k, getattr(pin, f"JointModel{kind}")(), place, f"j{k}")
        model.appendBodyToJoint(
            at, pin.Inertia(1.0 + rng.random(), rng.normal(size=3), np.diag([0.1, 0.2, 0.25])), there
        )
        model.addFrame(pin.Frame(f"f{k}", at, 0, there, pin.OP_FRAME))
    return model


def pairs(*kinds: str) -> tuple[Any, Any]:
    return tree(ours, *kinds), tree(theirs, *kinds)


def array(x: Any) -> np.ndarray:
    if hasattr(x, "homogeneous"):
        return np.array(x.homogeneous)
    if hasattr(x, "vector"):
        return np.array(x.vector)
    return np.array(x, float) if isinstance(x, (np.ndarray, float)) else np.array([array(y) for y in x])


def scaled(x: Any, y: Any) -> float:
    x, y = array(x), array(y)
    return float(np.max(abs(x - y), initial=0.0) / np.max(abs(y), initial=1.0))


def inputs(model: Any, seed: int) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    q, q1 = rng.normal(size=(2, model.nq))
    v, a = rng.normal(size=(2, model.nv))
    return {"q": q, "q1": q1, "v": v, "a": a, "f": rng.normal(size=(model.njoints, 6)), "t": 0.3}


def answer(pin: Any, model: Any, call: str, given: dict[str, Any]) -> tuple[Any, Any]:
    data = model.createData()
    scope = {**given, "m": model, "d": data, "f": [pin.Force(x) for x in given["f"]]}
    return eval(f"pin.{call}", {"pin": pin}, scope), data


MIXED = ("FreeFlyer", "RX", "Spherical", "RUBY", "Planar", "RY", "PX")


@pytest.mark.parametrize("call", calls(SEEN))
def test_calls_off_the_unit_norm_give_what_the_wheel_gives(call: str) -> None:
    mine, other = pairs(*MIXED)
    for seed in range(3):
        given = inputs(other, seed)
        (x, data), (y, peer) = answer(ours, mine, call, given), answer(theirs, other, call, given)
        assert scaled(x, y) <= CHAIN
        if "(m, d, q" in call and "Jacobian(" not in call:  # Pinocchio places only the joints that carry the frame
            assert scaled(data.liMi, peer.liMi) <= CHAIN


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing is compiled")
@pytest.mark.parametrize("call", ["rnea(m, d, q, v, a)", "aba(m, d, q, v, a)", "jacobianCenterOfMass(m, d, q)"])
def test_the_first_calls_off_the_unit_norm_wait_for_no_compiler(call: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def compiles(*arguments: Any, **named: Any) -> Any:
        raise AssertionError(arguments)

    monkeypatch.setattr(jit, "compile_signature", compiles)
    monkeypatch.setattr(tiers.TableKernel, "code", lambda *given: None)  # as with an empty cache
    mine, other = pairs("FreeFlyer", "RX")
    given = inputs(other, 0)
    assert scaled(answer(ours, mine, call, given)[0], answer(theirs, other, call, given)[0]) <= CHAIN


def test_places_and_motions_off_the_unit_norm_are_the_wheels() -> None:
    mine, other = pairs(*MIXED)
    for seed in range(3):
        found = []
        for pin, model in ((ours, mine), (theirs, other)):
            x, data = inputs(other, seed), model.createData()
            pin.forwardKinematics(model, data, x["q"], x["v"], x["a"])
            pin.updateFramePlacements(model, data)
            seen = [pin.getFrameVelocity(model, data, k) for k in range(model.nframes)]
            found.append([array(getattr(data, name)) for name in ("oMi", "liMi", "oMf", "v", "a")] + [array(seen)])
        assert all(scaled(x, y) <= CHAIN for x, y in zip(*found, strict=True))


@pytest.mark.parametrize("call", calls(OTHERS))
def test_what_the_wheel_contradicts_itself_in_is_finite_or_an_error_with_a_name(call: str) -> None:
    mine, other = pairs(*MIXED)
    for seed in range(3):
        try:
            x, _ = answer(ours, mine, call, inputs(other, seed))
        except sd.InertiaError:
            continue
        assert x is None or all(np.isfinite(array(y)).all() for y in (x if isinstance(x, tuple) else (x,)))


def sequence(pin: Any, model: Any, calls: str, given: dict[str, Any]) -> Any:
    """The answer of the last of some calls on one data, or a field of it."""
    scope = {**given, "pin": pin, "m": model, "d": model.createData()}
    *before, last = calls.split("; ")
    for call in before:
        exec(f"pin.{call}", scope)
    return eval(last if last.startswith("d.") else f"pin.{last}", scope)


@pytest.mark.parametrize("reference", ["LOCAL", "WORLD", "LOCAL_WORLD_ALIGNED"])
def test_jacobians_off_the_unit_norm_are_the_local_ones_seen_from_the_reference(reference: str) -> None:
    mine, other = pairs(*MIXED)
    for seed in range(3):
        given = inputs(other, seed)
        for call in JACOBIANS:
            where, local = "d.oMf[4]", "computeFrameJacobian(m, d, q, 4, pin.LOCAL)"
            if "getJoint" in call:
                where, local = "d.oMi[5]", "computeJointJacobian(m, d, q, 5)"
            X = array(sequence(theirs, other, f"framesForwardKinematics(m, d, q); {where}", given))
            v, w = np.split(sequence(theirs, other, local, given), 2)
            if reference != "LOCAL":
                v, w = X[:3, :3] @ v, X[:3, :3] @ w
            if reference == "WORLD":
                v = v + np.cross(X[:3, 3], w, axisb=0, axisc=0)
            x, y = (sequence(pin, m, f"{call}, pin.{reference})", given) for pin, m in ((ours, mine), (theirs, other)))
            assert scaled(x, np.vstack([v, w])) <= CHAIN
            assert (scaled(x, y) > 1e-2) == ((reference, call) != ("LOCAL", JACOBIANS[2]))


@pytest.mark.parametrize("call", calls(DIFFERENT))
def test_what_the_table_says_is_different_off_the_unit_norm_is_finite_and_different(call: str) -> None:
    mine, other = pairs(*MIXED)
    for seed in range(3):
        x, y = (sequence(pin, model, call, inputs(other, seed)) for pin, model in ((ours, mine), (theirs, other)))
        assert np.isfinite(array(x)).all()
        assert scaled(x, y) > 1e-2


def test_those_differences_are_in_the_table() -> None:
    rows = " ".join(x.what for x in ours.differences() if x.what.startswith("configurations off"))
    tested = " ".join([DIFFERENT, *JACOBIANS])
    named = {word.strip(",:") for word in rows.split() if word.startswith(("get", "compute", "data."))} - {"computes"}
    missing = {name for name in named if name not in OTHERS and name.replace("data.", "d.") not in tested}
    assert missing == set()
    assert {"getFrameJacobian", "computeCentroidalMap", "data.vcom"} <= named


def test_the_wheel_contradicts_itself_off_the_unit_norm() -> None:
    """Why the calls of the test before have no reference numbers."""
    _, other = pairs(*MIXED)
    x, data = inputs(other, 0), other.createData()
    local = theirs.aba(other, data, x["q"], x["v"], x["a"], theirs.Convention.LOCAL)
    assert scaled(local, theirs.aba(other, data, x["q"], x["v"], x["a"], theirs.Convention.WORLD)) > 1e-2
    M = np.array(theirs.crba(other, data, x["q"]))
    rows = [theirs.rnea(other, data, x["q"], 0.0 * x["v"], e) for e in np.eye(other.nv)]
    g = theirs.computeGeneralizedGravity(other, data, x["q"])
    assert scaled(M, np.array([row - g for row in rows]).T) > 1e-2


@pytest.mark.parametrize("kind", UNIT_KINDS)
def test_configurations_off_the_unit_norm_move_as_the_wheels(kind: str) -> None:
    mine, other = pairs(kind)
    rng = np.random.default_rng(0)
    for k in range(200):
        q, q1 = rng.normal(size=(2, mine.nq)) * rng.choice([0.3, 1.0, 2.0])
        q = theirs.normalize(other, q) if k % 3 == 0 else q
        q1 = theirs.normalize(other, q1) * (1.0 + 1e-5 * (k % 2)) if k % 4 == 0 else q1
        q1 = theirs.neutral(other) if k % 7 == 0 else q1
        v = rng.normal(size=mine.nv)
        for call in calls(MOVING if kind == "Planar" else f"{MOVING.strip()}\n{SAME}"):
            scope = {"m": mine, "q": q, "q1": q1, "v": v, "ours": ours, "theirs": theirs, "n": other}
            x, y = eval(f"ours.{call}", scope), eval(f"theirs.{call.replace('(m', '(n')}", scope)
            assert scaled(x, y) <= ROUNDING, (call, q, q1)
        for s in (1.0001, 1.01, -1.0001, 2.0):
            same = [bool(pin.isSameConfiguration(m, q, s * q, 1e-3)) for pin, m in ((ours, mine), (theirs, other))]
            assert same[0] == same[1], (q, s)


def test_a_pair_half_a_turn_from_another_off_the_unit_circle_stays() -> None:
    mine, other = pairs("RUBZ")
    for q in (np.array([1.2, 0.5]), np.array([0.3, -0.4])):
        found = ours.interpolate(mine, q, -2.0 * q, 0.3)
        assert scaled(found, theirs.interpolate(other, q, -2.0 * q, 0.3)) <= ROUNDING
        assert (found == q).all()


@pytest.mark.parametrize("kind", UNIT_KINDS)
def test_null_quaternions_and_pairs_give_numbers(kind: str) -> None:
    mine, other = pairs(kind, "RY")
    zero, q, v = np.zeros(mine.nq), ours.neutral(mine), np.zeros(mine.nv)
    data, peer = mine.createData(), other.createData()
    for x in (ours.difference(mine, zero, q), ours.difference(mine, q, zero), ours.interpolate(mine, zero, q, 0.5)):
        assert np.isfinite(x).all()
    assert (ours.normalize(mine, zero) == 0.0).all()
    assert scaled(ours.integrate(mine, zero, v), theirs.integrate(other, zero, v)) == 0.0
    tau = np.ones(mine.nv)
    assert scaled(ours.rnea(mine, data, zero, tau, tau), theirs.rnea(other, peer, zero, tau, tau)) <= ROUNDING
    if kind in ("FreeFlyer", "Spherical"):  # their matrix is the identity then
        for call in (
            "crba(m, d, q)",
            "computeMinverse(m, d, q)",
            "computeCoriolisMatrix(m, d, q, v)",
            "ccrba(m, d, q, v)",
        ):
            given = {**inputs(mine, 0), "q": zero}
            assert scaled(answer(ours, mine, call, given)[0], answer(theirs, other, call, given)[0]) <= CHAIN


def test_differences_to_the_limits_of_a_free_flyer_keep_the_other_joints() -> None:
    mine, other = pairs("FreeFlyer", "RY", "PX")
    q = ours.neutral(mine)
    for one, two in (
        (q, mine.upperPositionLimit),
        (mine.lowerPositionLimit, q),
        (mine.lowerPositionLimit, -mine.lowerPositionLimit),
    ):
        x, t = ours.difference(mine, one, two), ours.interpolate(mine, one, two, 0.5)
        assert np.isfinite(x).all()
        assert np.isfinite(t).all()
    limits = np.array(mine.upperPositionLimit)
    limits[7:] = 1.0, 2.0
    for one, two in ((q, limits), (limits, q)):
        assert (ours.difference(mine, one, two)[6:] == theirs.difference(other, one, two)[6:]).all()
    assert not np.isfinite(theirs.difference(other, q, other.upperPositionLimit)[:6]).all()


def test_parallel_calls_off_the_unit_norm_give_what_single_ones_give() -> None:
    mine, other = pairs(*MIXED)
    rng = np.random.default_rng(1)
    n = 600  # too large for a program
    q = np.array([ours.integrate(mine, ours.neutral(mine), x) for x in rng.normal(size=(n, mine.nv))])
    q[::7] *= 1.0 + rng.random((len(q[::7]), mine.nq))
    v, a = rng.normal(size=(2, n, mine.nv))
    for single, many in (("rnea", "rneaInParallel"), ("aba", "abaInParallel")):
        found = getattr(ours, many)(1, ours.ModelPool(mine, 1), q.T, v.T, a.T)
        data = other.createData()
        for k in [*range(0, n, 7), 1, 2, 3]:
            assert scaled(found[:, k], getattr(theirs, single)(other, data, q[k], v[k], a[k])) <= CHAIN


# --- strict mode -----------------------------------------------------------------------------------------


def test_strict_mode_refuses_them_in_models_made_before_and_after(strict_mode: None) -> None:
    ours.strict(False)
    mine, _ = pairs("FreeFlyer", "RUBZ")
    data, x = mine.createData(), inputs(mine, 0)
    first = ours.rnea(mine, data, x["q"], x["v"], x["a"]).copy()
    again = ours.rnea(mine, data, x["q"], x["v"], x["a"])  # by the short way
    held = data.M
    ours.crba(mine, data, x["q"])
    kept = held.copy()
    assert ours.strict(True) is False
    for model in (mine, tree(ours, "FreeFlyer", "RUBZ"), mine.copy(), pickle.loads(pickle.dumps(mine))):
        for call in ("rnea(m, d, q, v, a)", "crba(m, d, q)", "integrate(m, q, v)", "difference(m, q, q1)",
                     "interpolate(m, q, q1, 0.3)", "forwardKinematics(m, d, q)", "frames(m, d, q)"):  # fmt: skip
            call = call.replace("frames", "framesForwardKinematics")
            with pytest.raises(sd.ConfigurationError, match=r"of norm .* expected 1 within 1e-6"):
                answer(ours, model, call, x)
    with pytest.raises(sd.ConfigurationError):
        ours.crba(mine, data, x["q"])
    assert (held == kept).all()
    q = ours.normalize(mine, x["q"])
    assert (ours.rnea(mine, data, q, x["v"], x["a"]) != first).any()
    assert ours.strict() is True
    assert ours.strict(False) is True
    assert (ours.rnea(mine, data, x["q"], x["v"], x["a"]) == again).all()
    assert (first == again).all()


def test_the_library_itself_refuses_them_in_either_mode(strict_mode: None) -> None:
    model = sd.load_urdf("panda", root="floating")
    q = np.zeros(model.nq)
    for on in (True, False):
        ours.strict(on)
        with pytest.raises(sd.ConfigurationError, match="quaternion of norm 0"):
            sd.rnea(model, q, np.zeros(model.nv), np.zeros(model.nv))
        with pytest.raises(sd.ConfigurationError, match="quaternion of norm 0"):
            sd.rnea(model, np.zeros((600, model.nq)), np.zeros(model.nv), np.zeros(model.nv))
        with pytest.raises(sd.ConfigurationError, match="quaternion of norm 0"):
            sd.difference(model, q, sd.neutral(model))


def test_the_switch_takes_a_bool() -> None:
    for x in (1, "yes", np.bool_(True)):
        with pytest.raises(sd.SpatialDynError, match="expected True, False or None"):
            ours.strict(x)  # type: ignore[arg-type]
    assert ours.strict() is False


def test_the_example_of_the_switch_holds() -> None:
    assert doctest.testmod(sys.modules[ours.strict.__module__]).failed == 0
    assert ours.strict() is False


SETTINGS = [("1", "True"), ("yes", "expected 0 or 1"), ("0", "False"), ("", "False")]


@pytest.mark.parametrize(("word", "says"), slow_but(SETTINGS[:2], SETTINGS))
def test_the_environment_turns_strict_mode_on(word: str, says: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", f"import {FACE} as pin; print(pin.strict())"],
        env={**os.environ, "SPATIALDYN_STRICT": word}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert says in (done.stdout if word != "yes" else done.stderr)
    assert (done.returncode == 0) == (word != "yes")


def test_strict_mode_refuses_inertias_that_no_body_has(strict_mode: None) -> None:
    I = ours.Inertia.Identity()
    with pytest.raises(RuntimeError, match="inertia has the eigenvalues"):
        I.inertia = -np.eye(3)
    assert (I.inertia == np.eye(3)).all()
    I.inertia = np.diag([1.0, 2.0, 9.0])
    ours.strict(False)
    I.inertia = -np.eye(3)
    assert (I.inertia == -np.eye(3)).all()


def test_what_strict_mode_switches_is_in_the_table_of_differences() -> None:
    switched = " ".join(x.what for x in ours.differences() if x.switched)
    assert "getFrameId" in switched
    assert "unit norm" in switched
    assert "Inertia.inertia" in switched
    assert sum(x.switched for x in ours.differences()) == 3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ours.Model().getFrameId("hand") == 1

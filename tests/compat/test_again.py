"""Second calls, which take the fast path, and what calls take over from earlier ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from slow import slow_but, thinned

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours

from .calls import BOUND, CALLS, DERIVED, Row
from .test_matrix import Side, scaled

theirs = pytest.importorskip("pinocchio")

KINDS = ("FreeFlyer", "RX", "PY", "RUBZ", "RZ", "Planar", "RY")
PARENTS = (0, 1, 2, 1, 4, 0, 6)  # of joints 1 to 7; the third is on the first, the fifth on the universe


def tree(pin: Any) -> Any:
    """A tree in which a joint's parent is often not the joint before."""
    rng = np.random.default_rng(3)
    model = pin.Model()
    for k, (kind, parent) in enumerate(zip(KINDS, PARENTS, strict=True)):
        place, there = (pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3)) for _ in range(2))
        at = model.addJoint(parent, getattr(pin, f"JointModel{kind}")(), place, f"j{k}")
        model.addJointFrame(at, -1 if parent else 0)
        inertia = pin.Inertia(1.0 + rng.random(), rng.normal(size=3), np.diag([0.1, 0.2, 0.25]))
        model.appendBodyToJoint(at, inertia, there)
        model.addBodyFrame(f"b{k}", at, there, -1)
    return model


@pytest.fixture(scope="module")
def both() -> tuple[list[Side], list[Side]]:
    """Each module with the tree, at three configurations."""
    left, right = ([Side(pin, tree(pin), seed) for seed in range(3)] for pin in (ours, theirs))
    for x, y in zip(left, right, strict=True):
        x.model, y.model = left[0].model, right[0].model
        x.values["model"], y.values["model"] = x.model, y.model
        y.values |= {name: x.values[name] for name in ("q", "d", "q1", "raw")}
    return left, right


@pytest.mark.parametrize("row", slow_but(CALLS[::16], thinned(CALLS[::16], CALLS, 1)), ids=lambda row: row.text)
def test_a_call_answers_the_second_and_third_time_as_the_wheel(both: tuple[list[Side], list[Side]], row: Row) -> None:
    """With one Data for all, whose fields are held from the first time on."""
    left, right = both
    data, peer = left[0].model.createData(), right[0].model.createData()
    bound = max(row.bound, DERIVED if row.solves else BOUND)
    for time in (0, 1, 2, 1):
        expected, found = right[time].run(row, peer), left[time].run(row, data)
        assert scaled(found, expected) <= bound, time
        for field in row.fields.split():
            if time and field in ("dhg", "f") and ("computeAllTerms" in row.text or "forwardDynamics" in row.text):
                continue  # Pinocchio adds to the old f[0]: see the test below
            assert scaled(getattr(data, field), getattr(peer, field)) <= bound, (time, field)


def test_all_terms_twice_are_those_of_once_where_the_wheel_adds_up() -> None:
    found = []
    for pin in (ours, theirs):
        model = tree(pin)
        data, q, v = model.createData(), ours.neutral(tree(ours)), np.ones(model.nv)
        for _ in range(2):
            pin.computeAllTerms(model, data, q, v)
            found.append(np.array(data.dhg.vector))
    assert (found[0] == found[1]).all()
    assert scaled(found[0], found[2]) <= BOUND
    assert scaled(found[3], 2.0 * found[2]) <= BOUND


@pytest.mark.parametrize("last", ["LOCAL", "WORLD"])
def test_the_inverse_without_q_is_that_of_the_last_aba_of_either_convention(last: str) -> None:
    mine = tree(ours)
    data, rng = mine.createData(), np.random.default_rng(0)
    first = "WORLD" if last == "LOCAL" else "LOCAL"
    q0, q1, q2 = (ours.integrate(mine, ours.neutral(mine), x) for x in rng.normal(size=(3, mine.nv)))
    v, tau = rng.normal(size=(2, mine.nv))
    conventions = {name: getattr(ours.Convention, name) for name in ("LOCAL", "WORLD")}
    for q, convention in ((q1, first), (q2, last), (q0, first), (q2, last)):
        ours.aba(mine, data, q, v, tau, convention=conventions[convention])
    expected = np.array(ours.computeMinverse(mine, mine.createData(), q2))
    for _ in range(2):
        assert (ours.computeMinverse(mine, data) == expected).all()
    assert (data.Minv == expected).all()
    found, whole = ours.computeABADerivatives(mine, data), mine.createData()
    for x, y in zip(found, ours.computeABADerivatives(mine, whole, q2, v, tau), strict=True):
        assert scaled(x, y) <= BOUND


GETTERS = """
getVelocity(m, d, k)  getAcceleration(m, d, k, r)  getClassicalAcceleration(m, d, k)  getFrameVelocity(m, d, k)
getFrameAcceleration(m, d, k, r)  getFrameClassicalAcceleration(m, d, k)  getJointJacobian(m, d, k, r)
getFrameJacobian(m, d, k, r)  computeJointJacobian(m, d, q, k)  computeFrameJacobian(m, d, q, k)
updateFramePlacement(m, d, k)  getFrameVelocity(m, d, k, X)  getFrameJacobian(m, d, k, X, r)
"""


@pytest.mark.parametrize("call", [call for line in GETTERS.strip().split("\n") for call in line.split("  ")])
def test_indices_that_are_not_there_are_refused_also_the_second_time(call: str) -> None:
    mine, other = tree(ours), tree(theirs)
    found = []
    for pin, model in ((ours, mine), (theirs, other)):
        data, q, v = model.createData(), ours.neutral(mine), np.ones(model.nv)
        pin.forwardKinematics(model, data, q, v, v)
        pin.computeJointJacobians(model, data, q)
        scope = {"pin": pin, "m": model, "d": data, "q": q, "r": pin.LOCAL, "X": pin.SE3.Identity()}
        for _ in range(3):
            for k in (-1, -(2**70)):
                with pytest.raises(OverflowError):  # an index of Pinocchio's has no sign
                    eval(f"pin.{call}", {**scope, "k": k})
            found.append(eval(f"pin.{call}", {**scope, "k": 2}))
        if pin is ours:
            for k in (model.nframes, 2**70):
                with pytest.raises(IndexError, match=r"index is \d+, expected one from 0 to"):
                    eval(f"pin.{call}", {**scope, "k": k})
    assert all(scaled(x, y) <= BOUND for x, y in zip(found[:3], found[3:], strict=True))


@pytest.mark.parametrize("joint", range(1, len(KINDS) + 1))
def test_a_joint_that_is_moved_takes_effect_whatever_it_hangs_on(joint: int) -> None:
    """The LibraryModel stays; only its numbers are replaced."""
    mine, other = tree(ours), tree(theirs)
    data, peer, rng = mine.createData(), other.createData(), np.random.default_rng(joint)
    q, v, a = ours.integrate(mine, ours.neutral(mine), rng.normal(size=mine.nv)), *rng.normal(size=(2, mine.nv))
    ours.rnea(mine, data, q, v, a)
    R, p = ours.exp3(rng.normal(size=3)), rng.normal(size=3)
    for pin, model in ((ours, mine), (theirs, other)):
        model.jointPlacements[joint] = pin.SE3(R, p)
    for _ in range(2):
        assert scaled(ours.rnea(mine, data, q, v, a), theirs.rnea(other, peer, q, v, a)) <= BOUND
        for pin, model, where in ((ours, mine, data), (theirs, other, peer)):
            pin.forwardKinematics(model, where, q, v, a)
            pin.updateFramePlacements(model, where)
        for field in ("oMi", "liMi", "oMf", "v", "a"):
            assert scaled(getattr(data, field), getattr(peer, field)) <= BOUND, field
        for k in range(1, mine.njoints):
            X = mine.jointPlacements[k] * (mine.jointPlacements[k].inverse() * data.liMi[k])
            above = data.oMi[mine.parents[k]]
            assert scaled(data.oMi[k], above * X) <= BOUND
    ours.updateGlobalPlacements(mine, data)
    theirs.updateGlobalPlacements(other, peer)
    assert scaled(data.oMi, peer.oMi) <= BOUND


def test_the_errors_of_the_face_are_those_of_the_library() -> None:
    from spatialdyn.compat.pinocchio.types.arguments import RangeError

    assert issubclass(RangeError, (sd.SpatialDynError,))
    assert issubclass(RangeError, OverflowError)
    assert issubclass(RangeError, IndexError)

"""Tolerances and limits that messages and docstrings promise, from just inside and just outside."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from asymmetric import roots

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.urdf.load import read_urdf

BOX = (1.0, (0.0, 0.0, 0.0), np.diag([1.0, 1.2, 1.4]))
TWO = sd.ModelBuilder("two").add_body("a", inertia=BOX).add_body("b", "a", axis=(0, 1, 0), inertia=BOX)
FLYING = sd.ModelBuilder("flying").set_inertia("base", BOX).build(root="floating")
TURNING = sd.ModelBuilder("turning").add_body("a", joint="continuous", inertia=BOX).build(continuous="cos_sin")
BALL = sd.ModelBuilder("ball").add_body("a", joint="spherical", inertia=BOX).build()


def coordinates(model: sd.Model, norm: float) -> np.ndarray:
    """q whose quaternion or (cos, sin) pair has a norm, in no axis' direction."""
    q = np.zeros(model.nq)
    width = 2 if model is TURNING else 4
    q[-width:] = roots(width) / np.linalg.norm(roots(width)) * norm
    return q


def pose(off: float, at: tuple[int, int] | None = None) -> np.ndarray:
    """A pose whose R Rᵀ is off the identity by that: in all of its diagonal, or in one entry."""
    X = np.eye(4)
    c, s = 0.8, 0.6
    X[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    if at is None:
        X[:3, :3] *= math.sqrt(1.0 + off)
    else:
        square = np.eye(3)
        square[at] = square[at[::-1]] = off
        X[:3, :3] = np.linalg.cholesky(square) @ X[:3, :3]
    return X


def body(**given: Any) -> sd.Model:
    return sd.ModelBuilder("body").add_body("a", inertia=given.pop("inertia", BOX), **given).build(inertia="strict")


def moments(off: float) -> np.ndarray:
    """Principal moments of a flat plate, the largest off the sum of the others by that part of it."""
    return np.diag([1.0, 2.0, 3.0 / (1.0 - off)])


def dynamics(model: sd.Model, name: str = "crba") -> Callable[[float], Any]:
    return lambda off: getattr(sd, name)(model, coordinates(model, 1.0 + off))


def batch(off: float) -> Any:
    q = np.array([coordinates(FLYING, 1.0)] * 300)
    q[217] = coordinates(FLYING, 1.0 + off)
    return sd.crba(FLYING, q)


def noted(off: float) -> None:
    """An axis whose norm is off 1 is noted, which is made an error here."""
    axis = np.array([0.6, 0.0, 0.8]) * (1.0 + off)
    xyz = " ".join(map(repr, axis.tolist()))
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="continuous">'
        f'<parent link="a"/><child link="b"/><axis xyz="{xyz}"/></joint></robot>'
    )
    notes = [x for x in read_urdf(text).notes if "unit length" in x]
    if notes:
        raise sd.UrdfError(notes[0])


def restitution(e: float) -> None:
    sd.Contacts(TWO.build(), {"a": 0.1}, restitution=e)


def held_away(off: float) -> None:
    """A run from a state that is off its constraint by that."""
    model = TWO.build()
    held = sd.Constraints(model, [sd.CouplerConstraint("a_joint", "b_joint")])
    sd.simulate(sd.Scene(model, constraints=held), [off, 0.0], [0.0, 0.0], 1e-3, 1e-3, "rk4")


# {what: (what is called, promised, error, words, whether both signs are)}: accepted at 0.99 of it, refused at 1.01
PROMISED: dict[str, tuple[Callable[[float], Any], float, type[Exception], str, bool]] = {
    "placement": (lambda off: body(placement=pose(off)), 1e-6, sd.ModelError, "orthonormal within 1e-6", True),
    "placement, skew": (
        lambda off: body(placement=pose(off, (0, 2))), 1e-6, sd.ModelError, "orthonormal within 1e-6", True,
    ),
    "floating base": (dynamics(FLYING), 1e-6, sd.ConfigurationError, "expected 1 within 1e-6", True),
    "in a batch": (batch, 1e-6, sd.ConfigurationError, "in sample 217.*expected 1 within 1e-6", True),
    "spherical": (dynamics(BALL), 1e-6, sd.ConfigurationError, "expected 1 within 1e-6", True),
    "pair": (dynamics(TURNING), 1e-6, sd.ConfigurationError, "expected 1 within 1e-6", True),
    "forward kinematics": (
        dynamics(FLYING, "forward_kinematics"), 1e-6, sd.ConfigurationError, "expected 1 within 1e-6", True,
    ),
    "exact": (
        lambda off: sd.exact(FLYING, sd.crba)(coordinates(FLYING, 1.0 + off)), 1e-6, sd.ConfigurationError,
        "within 1e-6", True,
    ),
    "locked": (
        lambda off: BALL.reduced({"a_joint": coordinates(BALL, 1.0 + off)}), 1e-6, sd.ModelError, "norm", True,
    ),
    "to MuJoCo": (
        lambda off: sd.to_mujoco(FLYING, coordinates(FLYING, 1.0 + off), np.zeros(6)), 1e-6, sd.ConfigurationError,
        "expected 1 within 1e-6", True,
    ),
    "fixed input": (
        lambda off: sd.specialize(FLYING, sd.crba, fixed={"q": coordinates(FLYING, 1.0 + off)}), 1e-6,
        sd.SpatialDynError, "within 1e-6 of 1", True,
    ),
    "axis": (noted, 1e-6, sd.UrdfError, "not of unit length", True),
    "inertia": (lambda off: body(inertia=(1.0, (0, 0, 0), moments(off))), 1e-6, sd.InertiaError, "at most 1", False),
    "symmetric": (
        lambda off: body(inertia=(1.0, (0, 0, 0), BOX[2] + 1.4 * off * np.outer([1, 0, 0], [0, 1, 0]))), 1e-12,
        sd.InertiaError, "expected I = Iᵀ", True,
    ),
    "restitution": (restitution, 1.0, sd.ConstraintError, "expected 0 to 1", False),
    "steps": (
        lambda off: sd.Contacts(TWO.build(), {"a": 0.1}, steps=round(off)), 100.0, sd.ConstraintError,
        "whole number of 1 to 100", False,
    ),
    "start on a constraint": (held_away, 1e-6, sd.ConstraintError, "expected at most 1e-06", True),
    "efficiency": (
        lambda off: sd.torque_limits(TWO.build(), [0, 0], sd.Motor([1, 1], 1, 1, efficiency=off)), 1.0,
        sd.ModelError, "at most 1", False,
    ),
}  # fmt: skip
CASES = [(what, sign) for what, (*_, both) in PROMISED.items() for sign in ((1.0, -1.0) if both else (1.0,))]
PROGRAMS = {"fixed input"}


@pytest.mark.parametrize(("what", "sign"), CASES)
def test_what_is_just_inside_a_promised_tolerance_is_accepted(what: str, sign: float) -> None:
    call, promised, *_ = PROMISED[what]
    if what in PROGRAMS and numba_kernels.PLAIN:
        pytest.skip("NUMBA_DISABLE_JIT: nothing is compiled")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        call(sign * 0.99 * promised)


@pytest.mark.parametrize(("what", "sign"), CASES)
def test_what_is_just_outside_a_promised_tolerance_is_refused(what: str, sign: float) -> None:
    call, promised, error, words, _ = PROMISED[what]
    with pytest.raises(error) as refused:
        call(sign * 1.01 * promised)
    assert re.search(words, str(refused.value))

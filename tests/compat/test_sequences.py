"""Random sequences of calls, reads, writes and edits give the same under both imports.

``data.a`` is not read: Pinocchio's aba and rnea use it as scratch, ours do not write it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as ours

from .test_data import biped, close

theirs = pytest.importorskip("pinocchio")

STEPS = 120


class Case:
    """A module with a model, a data, and the fields that are held."""

    def __init__(self, pin: Any) -> None:
        self.pin, self.model = pin, biped(pin)
        self.data = self.model.createData()
        self.held: dict[str, Any] = {}
        self.forces = [pin.Force(0.1 * np.arange(6.0)) for _ in range(self.model.njoints)]


def read(field: str) -> Callable[..., Any]:
    """A field as it is now, held from now on."""

    def action(c: Case, *given: Any) -> Any:
        shown = c.held.setdefault(field, getattr(c.data, field))
        if isinstance(shown, np.ndarray):
            return np.array(shown)
        return np.array([x.homogeneous if hasattr(x, "homogeneous") else x.vector for x in shown])

    return action


def edit(c: Case, x: Any) -> None:
    """Other numbers in the same tree."""
    which = int(x.rng % 5)
    if which == 0:
        c.model.inertias[2] = c.pin.Inertia(1.0 + x.k, np.array([0.1, 0.2, 0.3]), np.diag([1.0, 1.5, 2.0]))
    elif which == 1:
        c.model.armature = 0.1 * x.a**2
    elif which == 2:
        c.model.jointPlacements[2] = c.pin.SE3(np.eye(3), 0.1 * x.a[:3])
    elif which == 3:
        c.model.gravity = c.pin.Motion(np.array([*x.a[:3], 0.0, 0.0, 0.0]))
    else:
        c.model.frames[1].placement = c.pin.SE3(np.eye(3), x.a[3:6])


def write(c: Case, x: Any) -> None:
    """Write into a held field, until the next call that fills it."""
    if "oMi" in c.held:
        c.held["oMi"][1].translation[:] = x.a[:3]


class Given:
    """Inputs of an action, the same for both."""

    def __init__(self, rng: np.random.Generator, nv: int) -> None:
        q = theirs.neutral(biped(theirs))
        self.k, self.rng = int(rng.integers(5)), int(rng.integers(100))
        self.v, self.a = rng.normal(size=(2, nv))
        self.q = np.array(theirs.integrate(biped(theirs), q, rng.normal(size=nv)))
        self.J = rng.normal(size=(2 + self.k % 2, nv))
        self.reference = ("LOCAL", "WORLD", "LOCAL_WORLD_ALIGNED")[int(rng.integers(3))]


CALLS: dict[str, Callable[..., Any]] = {
    "fk0": lambda c, x: c.pin.forwardKinematics(c.model, c.data, x.q),
    "fk1": lambda c, x: c.pin.forwardKinematics(c.model, c.data, x.q, x.v),
    "fk2": lambda c, x: c.pin.forwardKinematics(c.model, c.data, x.q, x.v, x.a),
    "frames": lambda c, x: c.pin.framesForwardKinematics(c.model, c.data, x.q),
    "place": lambda c, x: c.pin.updateFramePlacements(c.model, c.data),
    "place1": lambda c, x: c.pin.updateFramePlacement(c.model, c.data, x.k).homogeneous,
    "rnea": lambda c, x: c.pin.rnea(c.model, c.data, x.q, x.v, x.a),
    "pushed": lambda c, x: c.pin.rnea(c.model, c.data, x.q, x.v, x.a, c.forces),
    "static": lambda c, x: c.pin.computeStaticTorque(c.model, c.data, x.q, c.forces),
    "aba": lambda c, x: c.pin.aba(c.model, c.data, x.q, x.v, x.a),
    "nle": lambda c, x: c.pin.nonLinearEffects(c.model, c.data, x.q, x.v),
    "J": lambda c, x: c.pin.computeJointJacobians(c.model, c.data, x.q),
    "V": lambda c, x: c.pin.getFrameVelocity(c.model, c.data, x.k, getattr(c.pin, x.reference)).vector,
    "Vj": lambda c, x: c.pin.getVelocity(c.model, c.data, x.k, getattr(c.pin, x.reference)).vector,
    "com": lambda c, x: c.pin.centerOfMass(c.model, c.data, x.q),
    "energy": lambda c, x: c.pin.computeKineticEnergy(c.model, c.data, x.q, x.v),
    "contact": lambda c, x: c.pin.forwardDynamics(c.model, c.data, x.q, x.v, x.a, x.J, x.a[: len(x.J)], 0.1),
    "impact": lambda c, x: c.pin.impulseDynamics(c.model, c.data, x.q, x.v, x.J, 0.5, 0.1),
    "bordered": lambda c, x: c.pin.computeKKTContactDynamicMatrixInverse(c.model, c.data, x.q, x.J, 0.1),
    "integrate": lambda c, x: c.pin.integrate(c.model, x.q, x.v),
    "edit": edit,
    "write": write,
    **{field: read(field) for field in ("oMi", "liMi", "oMf", "v", "tau", "ddq")},
}


@pytest.mark.parametrize("seed", range(8))
def test_sequences_give_the_same_under_both_imports(seed: int) -> None:
    rng, wheel, face = np.random.default_rng(seed), Case(theirs), Case(ours)
    done = []
    for c in (wheel, face):  # fields that the wheel's getters would else read before they are computed
        c.pin.forwardKinematics(c.model, c.data, c.pin.neutral(c.model), np.zeros(c.model.nv), np.zeros(c.model.nv))
        c.pin.framesForwardKinematics(c.model, c.data, c.pin.neutral(c.model))
    for _ in range(STEPS):
        name = str(rng.choice([*CALLS]))
        given = Given(rng, face.model.nv)
        done.append(name)
        expected, found = (CALLS[name](c, given) for c in (wheel, face))
        assert (expected is None) == (found is None), done
        if expected is not None:
            try:
                close(found, expected)
            except AssertionError:
                raise AssertionError(f"after {' '.join(done)}") from None

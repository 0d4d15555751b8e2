"""Conserved quantities of a motion without torques.

Noether: if a rigid motion of the robot changes neither its kinetic nor its potential energy, its momentum is conserved.
Rotating or translating a subtree on the world is such a motion if the joint allows it and gravity does no work: a
rotation about the direction of gravity, a translation across it; any without gravity.

A free-floating robot conserves its total momentum, six numbers. It does not conserve M(q) v: the rows of inner joints
change with the shape, and those of the base are the total momentum in the base's rotating frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, check_model
from ..calls.dynamics import calls
from ..calls.random_configurations import random_configuration
from ..model.joint_rows import Joint
from ..model.model import Model
from ..waiting import watch
from .hamiltonian import STEP, WEIGHTS, hamilton_equations
from .lie_brackets import motion_subspace

Array = NDArray[np.float64]

SAMPLES = 8  # random states: an analytic rate that is not identically zero is nonzero in all of them
CONSERVED = 1e-9  # relative to the terms of a rate: above rounding and the error of π/2 with 12 digits in a URDF


@dataclass(frozen=True, repr=False)
class ConservedQuantity:
    """A function of (q, p) that is constant along every free motion.

    name         e.g. "energy"
    unit         unit of its values
    description  the reason why it is conserved
    function     function of q (..., nq), p (..., nv) that returns values (...)
    """

    name: str
    unit: str
    description: str
    function: Callable[[Array, Array], Array]

    def value(self, q: ArrayLike, p: ArrayLike) -> Any:
        """Values at q (..., nq), p (..., nv): an array (...), or a float for one state."""
        found = np.asarray(self.function(as_array("q", q), as_array("p", p)))
        return found if found.shape else float(found)

    def __repr__(self) -> str:
        return f"<{self.name} [{self.unit}]: {self.description}>"


@watch.call("conserved_quantities")
def conserved_quantities(model: Model) -> list[ConservedQuantity]:
    """Quantities that a motion without torques and external forces conserves: energy first, then momenta.

    Source: Noether's theorem, for the motions in the module's docstring.

    Each joint on the world gives the momenta of the translations and rotations that it allows and on which gravity does
    no work: for a floating base without gravity all six; with gravity the horizontal linear ones, and the angular ones
    about the vertical and, in free fall, about the centre of mass. Added are single momenta p_i whose rate is zero in
    every state, such as that of a symmetric top about its axis. Each quantity is checked at random states: its rate is
    below 1e-9 of its terms. Joint limits are ignored. So are springs of series-elastic joints, which count as torques
    here and change the quantities that they act on. A robot may conserve more than these symmetries give.

    Returns a list of ConservedQuantity, with .name, .unit, .description and .value(q, p).
    Raises  InertiaError if M is singular; ModelError if model is not a Model.

    >>> import spatialdyn as sd
    >>> [x.name for x in conserved_quantities(sd.load_urdf("ur5"))]
    ['energy', 'momentum of shoulder_pan_joint']
    """
    check_model(model)
    rng = np.random.default_rng(0)
    q = random_configuration(model, rng, SAMPLES)
    v = rng.normal(size=(SAMPLES, model.nv))
    p = calls["momentum"](model, q, v)
    found = [ConservedQuantity("energy", "J", "no torque does work", partial(calls["hamiltonian"], model))]
    if not model.nv:
        return found
    terms = abs(p) @ np.ones(model.nv) * abs(v).max(-1) + abs(calls["generalized_gravity"](model, q)).max(-1)
    _, dp = hamilton_equations(model, q, p)
    taken = set()
    for index, joint in enumerate(model.joints):
        if index == 0 or joint.parent != 0 or joint.mimic is not None:
            continue
        for quantity in _of_joint(model, index):
            if _is_conserved(model, quantity, q, p, v, dp, terms):
                found.append(quantity)
                taken |= {joint.idx_v} if joint.nv == 1 else set()
    for joint in model.joints[1:]:
        for k in range(joint.idx_v, joint.idx_v + joint.nv):
            if joint.mimic is None and k not in taken and (abs(dp[:, k]) <= CONSERVED * terms).all():
                found.append(_of_coordinate(model, joint, k))
    return found


def _of_coordinate(model: Model, joint: Joint, k: int) -> ConservedQuantity:
    """The single momentum p_k."""
    place = "" if joint.nv == 1 else f" [{k - joint.idx_v}]"
    unit = "kg m²/s" if motion_subspace(model, joint)[k - joint.idx_v, :3].any() else "kg m/s"
    return ConservedQuantity(
        f"momentum of {joint.name}{place}", unit, "the energy does not change along it", partial(_coordinate, k)
    )


def _coordinate(k: int, q: Array, p: Array) -> Array:
    return np.broadcast_to(p[..., k], np.broadcast_shapes(q.shape[:-1], p.shape[:-1]))


# --- motions of the whole robot --------------------------------------------------------------------------


def _of_joint(model: Model, index: int) -> Iterator[ConservedQuantity]:
    """Momenta of the motions that a joint on the world allows and on which gravity does no work."""
    joint = model.joints[index]
    if joint.pitch:  # a screw is neither a translation nor a rotation: its momentum is tested separately
        return
    S, R, origin = motion_subspace(model, joint), joint.placement[:3, :3], joint.placement[:3, 3]
    g = model.gravity
    up = -g / np.linalg.norm(g) if g.any() else np.zeros(3)
    why = "gravity does not see it" if g.any() else "there is no gravity"
    linear = [x for x in S[:, 3:] @ R.T if x.any()]
    angular = [x for x in S[:, :3] @ R.T if x.any()]
    single = joint.nv == 1
    for u in _across(np.array(linear).reshape(-1, 3), up):
        name = f"momentum of {joint.name}" if single else f"linear momentum of {joint.name} along {_direction(u)}"
        twist = np.concatenate([np.zeros(3), u])
        yield ConservedQuantity(
            name, "kg m/s", f"everything shifts along {_direction(u)}: {why}", partial(_mapped, model, index, twist)
        )
    centre = np.zeros(3) if joint.kind == "floating" else origin
    for u in _about(np.array(angular).reshape(-1, 3), up):
        name = f"momentum of {joint.name}" if single else f"angular momentum of {joint.name} about {_direction(u)}"
        twist = np.concatenate([u, np.cross(centre, u)])
        yield ConservedQuantity(
            name, "kg m²/s", f"everything turns about {_direction(u)} through {_point(centre)}: {why}",
            partial(_mapped, model, index, twist),
        )  # fmt: skip
    alone = [j.parent for j in model.joints[1:]].count(0) == 1
    if joint.kind == "floating" and g.any() and alone:
        for k, axis in enumerate("xyz"):
            yield ConservedQuantity(
                f"angular momentum about the centre of mass, {axis}", "kg m²/s", "it falls freely",
                partial(_about_centre, model, index, k),
            )  # fmt: skip


def _across(rows: Array, up: Array) -> Array:
    """An orthonormal basis of the part of the span of orthonormal rows that is orthogonal to ``up``."""
    rows = np.eye(3) if len(rows) == 3 else rows
    seen = abs(rows @ up) > CONSERVED
    if seen.sum() <= 1:
        return rows[~seen]
    part = rows @ up
    basis = np.linalg.svd(part[None])[2][1:]  # orthogonal to part, within the rows
    return np.asarray(basis @ rows)


def _about(rows: Array, up: Array) -> Array:
    """The axis along ``up`` if it is in the span of orthonormal rows; the rows themselves if ``up`` is zero."""
    if not up.any():
        return np.eye(3) if len(rows) == 3 else rows
    if not len(rows) or abs(rows.T @ (rows @ up) - up).max() > CONSERVED:
        return np.zeros((0, 3))
    return rows if len(rows) == 1 else up[None]


def _wrench(model: Model, index: int, q: Array, p: Array) -> tuple[Array, Array]:
    """Momentum of a joint's subtree: angular about the world's origin, and linear, (..., 3) each, in world axes."""
    joint = model.joints[index]
    body = p[..., joint.idx_v : joint.idx_v + joint.nv] @ motion_subspace(model, joint)
    X = calls["forward_kinematics"](model, q)[..., index, :, :]
    n, f = ((X[..., :3, :3] @ part[..., None])[..., 0] for part in (body[..., :3], body[..., 3:]))
    return n + np.cross(X[..., :3, 3], f), f


def _mapped(model: Model, index: int, twist: Array, q: Array, p: Array) -> Array:
    """Momentum of the subtree along a twist (angular first) in the world frame."""
    n, f = _wrench(model, index, q, p)
    return np.asarray(n @ twist[:3] + f @ twist[3:])


def _about_centre(model: Model, index: int, k: int, q: Array, p: Array) -> Array:
    n, f = _wrench(model, index, q, p)
    return np.asarray((n - np.cross(calls["center_of_mass"](model, q), f))[..., k])


def _is_conserved(
    model: Model, quantity: ConservedQuantity, q: Array, p: Array, v: Array, dp: Array, terms: Array
) -> bool:
    """Whether the rate along the flow is below CONSERVED of its terms in all samples."""
    h = STEP / max(1.0, float(abs(v).max()))
    rate = np.zeros(len(q))
    for k, weight in WEIGHTS:
        for s in (k * h, -k * h):
            rate += np.sign(s) * weight / h * quantity.function(calls["integrate"](model, q, s * v), p + s * dp)
    return bool((abs(rate) <= CONSERVED * terms).all())


def _direction(u: Array) -> str:
    axes = [sign + axis for k, axis in enumerate("xyz") for sign in ("", "-") if float(sign + "1") * u[k] > 1 - 1e-12]
    return axes[0] if axes else _point(u)


def _point(x: Array) -> str:
    return "(" + ", ".join(f"{c + 0.0:.6g}" for c in x) + ")"

"""The terms of motors in the sweeps of ``aba``: rotors on the body before their joint, and differentials.

Two rows that share motors are row i and the row behind it, its partner k, which is eliminated first. With the coupling
m, q̈_k has the term -m/D_k q̈_i. It adds the force -m/D_k U_k to U_i, and the rest of q̈_k adds the same to the equation
of row i, so that D_i has the term twice. ``rotors`` describes the rotors.
"""

from __future__ import annotations

from ...algebra.euclidean import cross, dot, scale
from ...algebra.records import force_of, motion_of, pose_of, put_force, vec_of
from ...algebra.scalars import Scalar, inline
from ...algebra.spatial import Force, Pose, add_force, force_to_parent, power, scale_force
from ..signatures import Bodies, Record, Vector, Work
from .rotors import add_couple, in_row_axes


@inline
def through_differential(
    bodies: Bodies, work: Work, i: int, v: Vector, U: Force, D: Scalar, u: Scalar
) -> tuple[Force, Scalar, Scalar]:
    """U, D and u of row i, with the terms of the row behind it that shares motors with it; v may be None."""
    U, D = couple_to_partner(bodies, work, i, U, D)
    return U, D, push_of_partner(bodies, work, i, v, u)


@inline
def couple_to_partner(bodies: Bodies, work: Work, i: int, U: Force, D: Scalar) -> tuple[Force, Scalar]:
    """U and D of row i, with the terms of its partner."""
    k = bodies[i].partner
    partner, m = work[k], bodies[k].coupling
    W = force_to_parent(pose_of(partner.X), scale_force(-m * partner.d, force_of(partner.U)))
    twice = 2.0 * power(motion_of(bodies[i].S), W)
    return add_force(U, W), D + twice - m * m * partner.d


@inline
def push_of_partner(bodies: Bodies, work: Work, i: int, v: Vector, u: Scalar) -> Scalar:
    """u of row i, less the torque that accelerates its partner; v may be None."""
    k = bodies[i].partner
    partner = work[k]
    own = partner.u
    if v is not None:
        own = own - power(motion_of(partner.c), force_of(partner.U))
    return u - bodies[k].coupling * (partner.d * own)


@inline
def behind_differential(b: Record, here: Record, a: Vector, qdd: Scalar) -> Scalar:
    """q̈ of a row, less the term of the acceleration of the row before it, through their shared motors."""
    return qdd - here.d * (b.coupling * a[b.parent - 1])


@inline
def add_rotor(b: Record, X: Pose, here: Record, v: Vector, U: Force, u: Scalar) -> tuple[Force, Scalar]:
    """U and u of a row with a rotor: n J e is added to the U that pairs with the parent's acceleration, not to the U
    that pairs with c; v may be None, and then c is not read.
    """
    e = in_row_axes(b, X)
    U = add_couple(U, e)
    if v is not None:
        u = u + dot(e, motion_of(here.c).w)
    return U, u


@inline
def add_spin_of_rotor(b: Record, parent: Record, i: int, v: Vector) -> None:
    """Add the couple n J q̇ ω × e of the rotor of row i to the parent's pA; v may be None."""
    if v is not None:
        spun = scale(v[i - 1], cross(motion_of(parent.v).w, vec_of(b.rotor)))
        put_force(parent.pA, add_couple(force_of(parent.pA), spun))

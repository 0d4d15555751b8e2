"""Inertias regrouped towards the root: the part of a body that its joint cannot feel moves to the parent body.

A revolute joint about u does not feel a part with mass m, first moment along u and rotational inertia J (1 - u uᵀ): the
momentum of the part under S is zero, and a rotation about u does not change the part, so it may be fixed to the parent.
A prismatic joint does not feel the rotational inertia. τ, M, q̈ and the articulated inertias D of the joints stay the
same; quantities of a single body (forces, momenta, energies) do not. The resulting zeros shorten a program by a fifth
to a third. Source: after Gautier and Khalil, Direct calculation of minimum set of inertial parameters of serial robots
(1990), for any axis.

A moved part is subtracted from the body and cancels in sums over bodies, so it must not be larger than the inertia that
remains in the end. J is therefore the smaller of the two diagonal entries across u, either of which leaves a zero:
where u is a coordinate axis the part is at most the body's entry about each other axis, no diagonal entry becomes
negative, and no entry of a sum over bodies is larger than in the composite inertia of the table kernel. With the larger
entry a thin rod that may align with an axis above it leaves (thin + J) - J there: of 1e-12 of its length² no digit is
left. Where u is no coordinate axis, the part must be at most the body's entry about all three axes, or nothing is
moved: a rod that is thin about one of them has little else there.
An inertia whose axes are oblique to its frame has no small entry to protect, and loses as much in the table kernel.
"""

from __future__ import annotations

from typing import Any

from ....algebra.euclidean import Sym, Vec, dot, scale, sub, sub_sym
from ....algebra.records import (
    inertia_of,
    motion_of,
    pose_of,
    put_inertia,
)
from ....algebra.spatial import Inertia, add_inertia, inertia_to_parent
from ....bodies.kinds import SLIDES, TURNS

# of a parent over the mass moved to it: four times its own mass costs two bits, as other roundings do
LEAST_MASS_RATIO = 0.25
PERPENDICULAR = 1e-8  # entry of a unit vector whose square is below eps: URDFs write right angles with twelve digits


def regroup(rows: Any, solved: bool = False) -> None:
    """Regroup the inertias of a table of bodies, written in place, from the tips to the root.

    solved  whether the recursion divides by articulated inertias. A parent to which c times its mass is moved loses a
            factor c in the accuracy of its own inertia, and only that inertia counts where the load stays at rest: at
            c = 6 the refined batch of a floating double_pendulum has an error of 20 eps instead of 2; with a tip of 1e6
            aba_refined is no better than aba. So nothing is moved to a parent of at most LEAST_MASS_RATIO times that
            mass (c = 4), or to a parent without mass.
    """
    for i in range(len(rows) - 1, 0, -1):
        b = rows[i]
        body = inertia_of(b.inertia)
        if b.kind in TURNS:
            free = _unfelt_by_revolute(body, motion_of(b.S).w)
        elif b.kind in SLIDES:
            free = Inertia(0.0, Vec(0.0, 0.0, 0.0), body.I)
        else:
            continue
        carrier = rows[b.parent]
        if b.parent > 0 and carrier.inertia.m <= (LEAST_MASS_RATIO * body.m if solved else 0.0):
            continue
        put_inertia(b.inertia, Inertia(body.m - free.m, sub(body.h, free.h), sub_sym(body.I, free.I)))
        put_inertia(carrier.inertia, add_inertia(inertia_of(carrier.inertia), inertia_to_parent(pose_of(b.X), free)))


def _unfelt_by_revolute(body: Inertia, u: Vec) -> Inertia:
    """Mass, first moment along u, and J (1 - u uᵀ) with the least J that leaves a zero on the diagonal of the rest."""
    diagonal = (body.I.xx, u.x), (body.I.yy, u.y), (body.I.zz, u.z)
    J = max(0.0, min((inertia for inertia, along in diagonal if abs(along) <= PERPENDICULAR), default=0.0))
    if any(J * (1.0 - along * along) > inertia for inertia, along in diagonal):
        return Inertia(0.0, Vec(0.0, 0.0, 0.0), Sym(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    ring = Sym(
        J * (1.0 - u.x * u.x), -(J * (u.x * u.y)), -(J * (u.x * u.z)),
        J * (1.0 - u.y * u.y), -(J * (u.y * u.z)), J * (1.0 - u.z * u.z),
    )  # fmt: skip
    return Inertia(body.m, scale(dot(body.h, u), u), ring)

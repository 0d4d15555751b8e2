"""Inertias regrouped towards the root: what a joint cannot feel of its body is given to the body that carries it.

A revolute joint about u feels nothing of a part with mass m, first moment along u and rotational inertia
J (1 - u uᵀ): its momentum under S is zero and turning about u leaves it as it is, so it may as well be fixed to
the parent. A prismatic joint feels nothing of the rotational inertia. τ, M, q̈ and the articulated inertias D of
the joints stay the same; nothing that is said of a single body does. The zeros that this leaves shorten a program
by a fifth to a third. Source: Gautier and Khalil, Direct calculation of minimum set of inertial parameters of
serial robots (1990), in words of its own for any axis.

What is moved up is taken away again further down, so a part must not be larger than what is felt in the end. J is
therefore the smaller of the two diagonal entries across u, either of which leaves a zero: where u is a coordinate axis
the part is at most once what the body has about each other one, nothing negative remains on the diagonal, and no entry
of a sum over bodies is larger than in the composite inertia of the untraced recursion. With the larger entry a thin rod
that may align with an axis above it leaves (thin + J) - J there: of 1e-12 of its length² no digit is left. Where u is
none, c = 1 must hold about each of the three, or nothing of the body is moved: a rod that is thin about one of them
has little else there.
An inertia whose axes are oblique to its frame has no small entry to protect, and loses as much in the untraced call.
"""

from __future__ import annotations

from typing import Any

from ...algebra.euclidean import Sym, Vec, dot, minus, times
from ...algebra.records import (
    inertia_of,
    motion_of,
    pose_of,
    put_inertia,
)
from ...algebra.spatial import Inertia, add_inertia, inertia_to_parent
from ...bodies.table import PRISMATIC, REVOLUTE, REVOLUTE_CS

LIGHT = 0.25  # of the mass it would be given: with four times its own it loses two bits, what other roundings cost
ALONG = 1e-8  # entry of a unit vector whose square is lost beside 1: URDFs write right angles with twelve digits


def regroup(rows: Any, solved: bool = False) -> None:
    """Move what can be moved in a table of bodies, in place, from the tips to the root.

    solved  for recursions that divide by articulated inertias. A carrier that is given c times its mass loses as
            much of its own inertia, which is all that is felt where the load stays at rest: at c = 6 the refined batch
            of a floating double_pendulum has 20 eps for 2, behind a tip of 1e6 all is lost that aba_refined wins over
            aba. A carrier that would be given more than c = 4 times its mass is left as it is; one without mass always.
    """
    for i in range(len(rows) - 1, 0, -1):
        b = rows[i]
        body = inertia_of(b.inertia)
        if b.kind in (REVOLUTE, REVOLUTE_CS):
            free = _unfelt_by_revolute(body, motion_of(b.S).w)
        elif b.kind == PRISMATIC:
            free = Inertia(0.0, Vec(0.0, 0.0, 0.0), body.I)
        else:
            continue
        carrier = rows[b.parent]
        if b.parent > 0 and carrier.inertia.m <= (LIGHT * body.m if solved else 0.0):
            continue
        put_inertia(b.inertia, Inertia(body.m - free.m, minus(body.h, free.h), _less(body.I, free.I)))
        put_inertia(carrier.inertia, add_inertia(inertia_of(carrier.inertia), inertia_to_parent(pose_of(b.X), free)))


def _unfelt_by_revolute(body: Inertia, u: Vec) -> Inertia:
    """Mass, first moment along u, and J (1 - u uᵀ) with the least J that leaves a zero on the diagonal of the rest."""
    diagonal = (body.I.xx, u.x), (body.I.yy, u.y), (body.I.zz, u.z)
    J = max(0.0, min((inertia for inertia, along in diagonal if abs(along) <= ALONG), default=0.0))
    if any(J * (1.0 - along * along) > inertia for inertia, along in diagonal):
        return Inertia(0.0, Vec(0.0, 0.0, 0.0), Sym(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    ring = Sym(
        J * (1.0 - u.x * u.x), -(J * (u.x * u.y)), -(J * (u.x * u.z)),
        J * (1.0 - u.y * u.y), -(J * (u.y * u.z)), J * (1.0 - u.z * u.z),
    )  # fmt: skip
    return Inertia(body.m, times(dot(body.h, u), u), ring)


def _less(A: Sym, B: Sym) -> Sym:
    return Sym(A.xx - B.xx, A.xy - B.xy, A.xz - B.xz, A.yy - B.yy, A.yz - B.yz, A.zz - B.zz)

"""Forward dynamics q̈ = M(q)⁻¹ (τ - C q̇ - g) by the articulated body algorithm."""

from __future__ import annotations

from ..algebra.articulated import (
    Articulated,
    add_articulated,
    articulated,
    articulated_force,
    articulated_to_parent,
    subtract_outer,
)
from ..algebra.euclidean import Vec, cross, dot, neg, scale, zero
from ..algebra.public_arrays import read_force
from ..algebra.records import (
    articulated_of,
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_articulated,
    put_force,
    put_motion,
    table_dtype,
    vec_of,
)
from ..algebra.scalars import Scalar, inline
from ..algebra.spatial import (
    Force,
    Motion,
    Pose,
    add_force,
    add_motion,
    cross_force,
    cross_motion,
    force_to_parent,
    momentum,
    motion_to_child,
    power,
    scale_force,
    scale_motion,
    sub_force,
    zero_force,
    zero_motion,
)
from ..bodies.joints import joint_motion, place_joint
from .rotors import add_couple, in_row_axes
from .signatures import Array, Bodies, Config, Matrix, Vector, Work
from .spec import FEXT_OPTIONAL, TAU, TURNED_Q, A, MassMatrix, Spec, V
from .steps import moved_by_joint

WORK = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
    c=Motion,  # velocity-product acceleration v × S q̇; outward
    a=Motion,  # spatial acceleration; third sweep
    IA=Articulated,  # articulated inertia; of the body alone, outward; of its subtree, inward
    pA=Force,  # bias force; of the body alone, outward; of its subtree, inward
    U=Force,  # IA S, and n J e of a rotor; inward
    d=float,  # 1 / D = 1 / (S·IA S + armature); inward
    u=float,  # τ - S·pA, and n J e·c of a rotor; inward
)


@inline
def aba(bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, a: Vector, pivots: Vector) -> None:
    """RBDA table 7.1 in body coordinates; fext may be None, for zero."""
    aba_inward(bodies, work, q, v, tau, fext, pivots)
    aba_outward(bodies, work, v, vec_of(bodies[0].gravity), a)


@inline
def aba_inward(bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, pivots: Vector) -> None:
    """The first two passes of the table: poses, and U, D, u of each row; v, fext may be None, for zero.

    A rotor's n J e is part of the U that pairs with the parent's acceleration, and not of that which pairs with c.
    """
    n = len(bodies) - 1
    if v is not None:
        put_motion(work[0].v, zero_motion())

    for i in range(1, n + 1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        I = inertia_of(b.inertia)
        place_joint(bodies, i, q, here.X)
        pA = zero_force()
        if v is not None:
            vJ = joint_motion(bodies, i, v)
            vi = moved_by_joint(here, parent, vJ)
            pA = cross_force(vi, momentum(I, vi))
            put_motion(here.v, vi)
            put_motion(here.c, cross_motion(vi, vJ))
        if fext is not None and b.joint > 0:
            pA = sub_force(pA, read_force(fext[b.joint]))
        put_articulated(here.IA, articulated(I))
        put_force(here.pA, pA)

    for i in range(n, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        X, S = pose_of(here.X), motion_of(b.S)
        IA, pA = articulated_of(here.IA), force_of(here.pA)
        U = articulated_force(IA, S)
        D = power(S, U) + b.armature
        u = tau[i - 1] - power(S, pA)
        if b.partner > 0:
            k = work[b.partner]
            W = force_to_parent(pose_of(k.X), force_of(k.U))
            U, D = coupled_to_partner(bodies[b.partner].coupling, k.d, W, S, U, D)
            u = u - felt_of_partner(bodies, work, i, v)
        d = 1.0 / D
        if b.geared:
            e = in_row_axes(b, X)
            U = add_couple(U, e)
            if v is not None:
                u = u + dot(e, motion_of(here.c).w)
        Ia = subtract_outer(IA, U, scale_force(d, U))
        pa = pA if v is None else add_force(pA, articulated_force(Ia, motion_of(here.c)))
        pa = add_force(pa, scale_force(d * u, U))
        if b.parent > 0:
            put_articulated(parent.IA, add_articulated(articulated_of(parent.IA), articulated_to_parent(X, Ia)))
            put_force(parent.pA, add_force(force_of(parent.pA), force_to_parent(X, pa)))
            if v is not None and b.geared:
                spun = scale(v[i - 1], cross(motion_of(parent.v).w, vec_of(b.rotor)))
                put_force(parent.pA, add_couple(force_of(parent.pA), spun))
        put_force(here.U, U)
        here.d = d
        here.u = u
        pivots[i - 1] = D


@inline
def coupled_to_partner(m: Scalar, d: Scalar, W: Force, S: Motion, U: Force, D: Scalar) -> tuple[Force, Scalar]:
    """U and D of a row S that shares motors with the row behind it, its partner k, which is eliminated.

    With m the coupling and d = 1/D_k, q̈_k has the term -m d q̈_i. Its force -m d W, W = U_k in row i, is felt with q̈_i,
    and in the equation of row i the rest of q̈_k brings back the same: twice in D.
    """
    W = scale_force(-m * d, W)
    return add_force(U, W), D + 2.0 * power(S, W) - m * m * d


@inline
def felt_of_partner(bodies: Bodies, work: Work, i: int, v: Vector) -> Scalar:
    """What the acceleration that the partner of row i has by itself takes of the row's torque; v may be None."""
    k = bodies[i].partner
    partner = work[k]
    u = partner.u
    if v is not None:
        u = u - power(motion_of(partner.c), force_of(partner.U))
    return bodies[k].coupling * (partner.d * u)


@inline
def aba_resolve(bodies: Bodies, work: Work, tau: Vector) -> None:
    """The second pass for other torques on a robot at rest: u of each row, from the X, U, D of ``aba_inward``."""
    for i in range(len(bodies)):
        put_force(work[i].pA, zero_force())
    for i in range(len(bodies) - 1, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        pA = force_of(here.pA)
        here.u = tau[i - 1] - power(motion_of(bodies[i].S), pA)
        if bodies[i].partner > 0:
            here.u = here.u - felt_of_partner(bodies, work, i, None)
        pa = add_force(pA, scale_force(here.d * here.u, force_of(here.U)))
        put_force(parent.pA, add_force(force_of(parent.pA), force_to_parent(pose_of(here.X), pa)))


@inline
def aba_outward(bodies: Bodies, work: Work, v: Vector, gravity: Vec, a: Vector) -> None:
    """The third pass, under a given gravity. With v None and gravity 0 it solves M(q) a = τ + Σ Jᵀ fext."""
    put_motion(work[0].a, Motion(zero(), neg(gravity)))
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        ai = motion_to_child(pose_of(here.X), motion_of(parent.a))
        if v is not None:
            ai = add_motion(ai, motion_of(here.c))
        qdd = here.d * (here.u - power(ai, force_of(here.U)))
        if b.coupled:
            qdd = qdd - here.d * (b.coupling * a[b.parent - 1])
        put_motion(here.a, add_motion(ai, scale_motion(qdd, motion_of(b.S))))
        a[i - 1] = qdd


def acceleration_through_M(M: MassMatrix, q: Array, v: Array, tau: Array, fext: Array) -> Array:
    """a = M⁻¹ (tau - rnea(q, v, 0))."""
    return M.solve(tau - M.call("rnea", q, v, 0.0 * v, fext))


SPECS = (
    Spec(
        "aba", aba, WORK, (TURNED_Q, V, TAU, FEXT_OPTIONAL), A,
        "Forward dynamics a = M(q)⁻¹ (tau - C(q, v) v - g(q) + Σ Jᵀ fext) by the articulated body algorithm.",
        "Featherstone, RBDA (2008), table 7.1.", pivots=True, regroup=True, through_M=acceleration_through_M,
        residual=("rnea", "minverse"),
    ),
)  # fmt: skip

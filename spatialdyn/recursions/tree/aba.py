"""Forward dynamics q̈ = M(q)⁻¹ (τ - C q̇ - g) by the articulated body algorithm, and M(q)⁻¹ by the same sweep."""

from __future__ import annotations

from ...algebra.articulated import (
    Articulated,
    add_articulated,
    articulated,
    articulated_force,
    articulated_to_parent,
    no_articulated,
    subtract_outer,
)
from ...algebra.euclidean import Vec, neg, zero
from ...algebra.public_arrays import read_force
from ...algebra.records import (
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
from ...algebra.scalars import inline, inline_or_by_rows
from ...algebra.spatial import (
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
from ...bodies.joints import joint_motion, place_joint
from ...bodies.kinds import CONTINUED
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from ..spec import FEXT_OPTIONAL, TAU, TURNED_Q, A, Argument, MassMatrix, Spec, V
from .aba_motors import (
    add_rotor,
    add_spin_of_rotor,
    behind_differential,
    couple_to_partner,
    push_of_partner,
    through_differential,
)
from .rotors import add_couple, in_row_axes

WORK = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity; outward
    c=Motion,  # velocity-product acceleration v × S q̇; outward
    a=Motion,  # spatial acceleration; third sweep
    IA=Articulated,  # articulated inertia where the tree branches; of the body alone, outward; with branches, inward
    pA=Force,  # bias force; of the body alone, outward; with those of branches, inward
    U=Force,  # IA S, and n J e of a rotor; inward
    d=float,  # 1 / D = 1 / (S·IA S + armature); inward
    u=float,  # τ - S·pA, and n J e·c of a rotor; inward
)
WORK_INVERSE = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    IA=Articulated,  # articulated inertia; of the body alone, outward; of its subtree, inward
    U=Force,  # as in WORK
    d=float,  # as in WORK
    F=Force,  # force that a unit torque of this row exerts on the row reached; inward, column by column
    P=Motion,  # acceleration that the unit torque causes; outward, column by column
)


@inline_or_by_rows
def aba(bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, a: Vector, pivots: Vector) -> None:
    """RBDA table 7.1 in body coordinates; fext may be None, for zero."""
    aba_inward(bodies, work, q, v, tau, fext, pivots)
    aba_outward(bodies, work, v, vec_of(bodies[0].gravity), a)


@inline
def aba_inward(bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, pivots: Vector) -> None:
    """The first two passes of the table: poses, and U, D, u of each row; v, fext may be None, for zero.

    What passes between neighbouring rows stays in registers, as in ``rnea``: ``vi`` outward, inward the inertia and
    the bias force that a row passes to the row before it. Further rows of a joint, at the identity pose, are not moved.
    """
    n = len(bodies) - 1
    vi = zero_motion()
    if v is not None:
        put_motion(work[0].v, vi)

    for i in range(1, n + 1):
        b, here = bodies[i], work[i]
        place_joint(bodies, i, q, here.X)
        pA = zero_force()
        if v is not None:
            # v_i = X v_λ + S q̇,   c_i = v_i × S q̇,   pA_i = v_i ×* I v_i - f_ext
            if b.parent < i - 1:
                vi = motion_of(work[b.parent].v)
            c = zero_motion()
            if b.kind != CONTINUED:
                vJ = joint_motion(bodies, i, v)
                vi = add_motion(motion_to_child(pose_of(here.X), vi), vJ)
                c = cross_motion(vi, vJ)
            if b.joint > 0:
                pA = cross_force(vi, momentum(inertia_of(b.inertia), vi))
            put_motion(here.v, vi)
            put_motion(here.c, c)
        if fext is not None and b.joint > 0:
            pA = sub_force(pA, read_force(fext[b.joint]))
        if branches(bodies, i):
            put_articulated(here.IA, articulated(inertia_of(b.inertia)))
        put_force(here.pA, pA)

    passed_I, passed_p = no_articulated(), zero_force()
    for i in range(n, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        X, S, pA = pose_of(here.X), motion_of(b.S), add_force(force_of(here.pA), passed_p)
        IA = articulated_of(here.IA) if branches(bodies, i) else articulated(inertia_of(b.inertia))
        IA = add_articulated(IA, passed_I)
        # U_i = IA S,   D_i = S·U_i,   u_i = τ_i - S·pA
        U = articulated_force(IA, S)
        D = power(S, U) + b.armature
        u = tau[i - 1] - power(S, pA)
        if b.partner > 0:
            U, D, u = through_differential(bodies, work, i, v, U, D, u)
        d = 1.0 / D
        if b.geared:
            U, u = add_rotor(b, X, here, v, U, u)
        put_force(here.U, U)
        here.d = d
        here.u = u
        pivots[i - 1] = D
        # Ia = IA - U Uᵀ / D,   pa = pA + Ia c + U u / D
        Ia, pa = subtract_outer(IA, U, scale_force(d, U)), pA
        if v is not None and b.kind != CONTINUED:
            pa = add_force(pa, articulated_force(Ia, motion_of(here.c)))
        pa = add_force(pa, scale_force(d * u, U))
        # IA_λ += X* Ia X,   pA_λ += X* pa
        if b.kind != CONTINUED:
            Ia, pa = articulated_to_parent(X, Ia), force_to_parent(X, pa)
        passed_I, passed_p = Ia, pa
        if b.parent < i - 1 or b.geared:
            if b.parent > 0:
                put_articulated(parent.IA, add_articulated(articulated_of(parent.IA), Ia))
                put_force(parent.pA, add_force(force_of(parent.pA), pa))
                if b.geared:
                    add_spin_of_rotor(b, parent, i, v)
            passed_I, passed_p = no_articulated(), zero_force()


@inline
def branches(bodies: Bodies, i: int) -> bool:
    """Whether inertias are added up in row i: more than the next row hangs there, or that row has a rotor on it."""
    last = bodies[i].last_row
    several: bool = last > i and (bodies[i + 1].last_row < last or bodies[i + 1].geared > 0)
    return several


@inline
def aba_resolve(bodies: Bodies, work: Work, tau: Vector) -> None:
    """The second pass for other torques on a robot at rest: u of each row, from the X, U, D of ``aba_inward``."""
    for i in range(len(bodies)):
        put_force(work[i].pA, zero_force())
    for i in range(len(bodies) - 1, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        pA = force_of(here.pA)
        u = tau[i - 1] - power(motion_of(bodies[i].S), pA)
        if bodies[i].partner > 0:
            u = push_of_partner(bodies, work, i, None, u)
        here.u = u
        pa = add_force(pA, scale_force(here.d * here.u, force_of(here.U)))
        put_force(parent.pA, add_force(force_of(parent.pA), force_to_parent(pose_of(here.X), pa)))


@inline
def aba_outward(bodies: Bodies, work: Work, v: Vector, gravity: Vec, a: Vector) -> None:
    """The third pass, under a given gravity. With v None and gravity 0 it solves M(q) a = τ + Σ Jᵀ fext."""
    ai = Motion(zero(), neg(gravity))
    put_motion(work[0].a, ai)
    for i in range(1, len(bodies)):
        b, here = bodies[i], work[i]
        # a' = X a_λ + c,   q̈_i = (u - U·a') / D,   a_i = a' + S q̈_i
        if b.parent < i - 1:
            ai = motion_of(work[b.parent].a)
        if b.kind != CONTINUED:
            ai = motion_to_child(pose_of(here.X), ai)
            if v is not None:
                ai = add_motion(ai, motion_of(here.c))
        qdd = here.d * (here.u - power(ai, force_of(here.U)))
        if b.coupled:
            qdd = behind_differential(b, here, a, qdd)
        ai = add_motion(ai, scale_motion(qdd, motion_of(b.S)))
        put_motion(here.a, ai)
        a[i - 1] = qdd


@inline
def minverse(bodies: Bodies, work: Work, q: Config, Minv: Matrix, pivots: Vector) -> None:
    """M⁻¹ column by column, after one articulated sweep."""
    articulate(bodies, work, q, pivots)
    inverse_columns(bodies, work, Minv)


@inline
def articulate(bodies: Bodies, work: Work, q: Config, pivots: Vector) -> None:
    """The articulated sweep alone: X, U and d = 1/D of each row, which do not depend on torques and forces."""
    n = len(bodies) - 1
    for i in range(1, n + 1):
        place_joint(bodies, i, q, work[i].X)
        put_articulated(work[i].IA, articulated(inertia_of(bodies[i].inertia)))

    for i in range(n, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        X, S, IA = pose_of(here.X), motion_of(b.S), articulated_of(here.IA)
        U = articulated_force(IA, S)
        D = power(S, U) + b.armature
        if b.partner > 0:
            U, D = couple_to_partner(bodies, work, i, U, D)
        d = 1.0 / D
        if b.geared:
            U = add_couple(U, in_row_axes(b, X))
        Ia = subtract_outer(IA, U, scale_force(d, U))
        if b.parent > 0:
            put_articulated(parent.IA, add_articulated(articulated_of(parent.IA), articulated_to_parent(X, Ia)))
        put_force(here.U, U)
        here.d = d
        pivots[i - 1] = D


@inline
def inverse_columns(bodies: Bodies, work: Work, Minv: Matrix) -> None:
    """M⁻¹ from the X, U and d = 1/D of an articulated sweep.

    Inward, F is the force that a unit torque at row j exerts on the row reached; outward, P is the acceleration that
    it causes. Only rows i <= j are computed, the rest follows by symmetry.
    """
    n = len(bodies) - 1
    put_motion(work[0].P, zero_motion())
    for i in range(n, 0, -1):
        b, here = bodies[i], work[i]
        X, S, U, d = pose_of(here.X), motion_of(b.S), force_of(here.U), here.d
        for j in range(1, n + 1):
            Minv[i - 1, j - 1] = 0.0
        Minv[i - 1, i - 1] = d
        put_force(here.F, force_to_parent(X, scale_force(d, U)))
        for j in range(i + 1, b.last_row + 1):
            F = force_of(work[j].F)
            Mij = -d * power(S, F)
            if b.partner > 0:
                Mij = Mij - d * (bodies[b.partner].coupling * Minv[b.partner - 1, j - 1])
            Minv[i - 1, j - 1] = Mij
            put_force(work[j].F, force_to_parent(X, add_force(F, scale_force(Mij, U))))

    for j in range(1, n + 1):
        root = j
        while bodies[root].parent > 0:
            root = bodies[root].parent
        for i in range(root, j + 1):  # zero for rows of another branch from the world
            here, parent = work[i], work[bodies[i].parent]
            P = motion_to_child(pose_of(here.X), motion_of(parent.P))
            Mij = Minv[i - 1, j - 1] - here.d * power(P, force_of(here.U))
            if bodies[i].coupled:
                Mij = Mij - here.d * (bodies[i].coupling * Minv[bodies[i].parent - 1, j - 1])
            put_motion(here.P, add_motion(P, scale_motion(Mij, motion_of(bodies[i].S))))
            Minv[i - 1, j - 1] = Mij
            Minv[j - 1, i - 1] = Mij


def acceleration_through_M(M: MassMatrix, q: Array, v: Array, tau: Array, fext: Array) -> Array:
    """a = M⁻¹ (tau - rnea(q, v, 0))."""
    return M.solve(tau - M.call("rnea", q, v, 0.0 * v, fext))


def minverse_through_M(M: MassMatrix, q: Array) -> Array:
    """M⁻¹ itself."""
    return M.inverse


SPECS = (
    Spec(
        "aba", aba, WORK, (TURNED_Q, V, TAU, FEXT_OPTIONAL), A,
        "Forward dynamics a = M(q)⁻¹ (tau - C(q, v) v - g(q) + Σ Jᵀ fext) by the articulated body algorithm.",
        "Featherstone, RBDA (2008), table 7.1.", pivots=True, regroup=True,
        through_M=acceleration_through_M, residual=("rnea", "minverse"),
    ),
    Spec(
        "minverse", minverse, WORK_INVERSE, (TURNED_Q,),
        Argument("Minv", ("nv", "nv"), "1/(kg m²) | 1/(kg m) | 1/kg", "inverse mass matrix, both triangles filled"),
        "Inverse M(q)⁻¹ of the mass matrix, without forming M.",
        "after Featherstone, RBDA (2008), table 7.1, with unit torques.", pivots=True, regroup=True,
        through_M=minverse_through_M, residual=("crba", "minverse"),
    ),
)  # fmt: skip

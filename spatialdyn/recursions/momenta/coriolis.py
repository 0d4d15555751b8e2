"""The Coriolis matrix C(q, q̇) of the Levi-Civita connection of M, Ṁ, Cᵀq̇ and M a + C(q, q̇) b + g.

Of the many matrices with the right C q̇ this is the one of the Christoffel symbols: C_ij = Σ_k Γ_ijk v_k, so that
Ṁ = C + Cᵀ and Ṁ - 2C is skew-symmetric. This holds for quaternion joints too, with the symbols of their
quasi-velocities (Koszul's formula; see ``christoffel``). C follows from M(q) alone: armatures are constant and add
nothing; rotors that turn on moving bodies do (``rotors``).

All is in root-aligned axes, the axes of the first body of each branch from the world, each row about its own origin. M,
C and Γ do not depend on that body's pose, so it is not used; each row is rotated once, and sums towards the root only
move to another origin. Roundoff is that of body coordinates, because no lever arm is longer than a link. Source:
Echeandia and Wensing, Numerical methods to compute the Coriolis matrix and Christoffel symbols for rigid-body systems
(2021), with the factor B in twelve numbers (``algebra.coriolis_factor``).
"""

from __future__ import annotations

from ...algebra.coriolis_factor import (
    CoriolisFactor,
    add_coriolis_factor,
    coriolis_factor,
    coriolis_factor_at_parent,
    coriolis_force,
    coriolis_times,
    coriolis_transpose_times,
)
from ...algebra.euclidean import add, cross, dot, matmul, neg, rotate, scale, zero
from ...algebra.public_arrays import read_parameters
from ...algebra.records import (
    coriolis_factor_of,
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_coriolis_factor,
    put_force,
    put_inertia,
    put_motion,
    put_pose,
    table_dtype,
    vec_of,
)
from ...algebra.scalars import inline, inline_or_by_rows
from ...algebra.spatial import (
    Force,
    Inertia,
    Motion,
    Pose,
    add_force,
    add_inertia,
    add_motion,
    cross_motion,
    force_at_parent,
    force_to_parent,
    identity_pose,
    inertia_at_parent,
    inertia_rate,
    momentum,
    motion_at_child,
    motion_to_child,
    power,
    rotate_inertia,
    rotate_motion,
    scale_motion,
    zero_force,
    zero_motion,
)
from ...bodies.joints import joint_motion, place_joint
from ..signatures import Array, Bodies, Config, Matrix, Vector, Work
from ..spec import TAU, TURNED_Q, A, Argument, Spec, V
from ..steps import body_velocity
from ..tree.rotors import add_couple, of_other, rotor_factor, rotor_in_root_axes
from .hamilton import WORK_RATE as WORK_MOMENTUM
from .hamilton import rate

WORK = table_dtype(
    X=Pose,  # pose of the row relative to its parent's, in root-aligned axes; outward
    S=Motion,  # motion subspace in root-aligned axes; outward
    v=Motion,  # velocity in root-aligned axes; outward
    dS=Motion,  # Ṡ = v × S; outward
    I=Inertia,  # inertia in root-aligned axes, outward; of the subtree, inward
    B=CoriolisFactor,  # coriolis factor, outward; of the subtree, inward
)
WORK_RATE = table_dtype(
    X=Pose,  # as in WORK, as are the fields to I
    S=Motion,
    v=Motion,
    dS=Motion,
    I=Inertia,
    dI=Inertia,  # rate of I, outward; of the subtree, inward
)
WORK_MODIFIED = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    v=Motion,  # spatial velocity of the body; outward
    w=Motion,  # the same of the joint velocities v_r; outward
    a=Motion,  # rate of w less gravity; outward
    f=Force,  # force that moves the body, outward; that its joint transmits, inward
)


@inline
def to_root_aligned_axes(bodies: Bodies, work: Work, q: Config) -> None:
    """S and I of every row in root-aligned axes, about its own origin.

    X.R holds the row's axes there, X.p leads from the parent's origin to its own; X of a branch's first body is 1.
    """
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        if b.parent == 0:
            put_pose(here.X, identity_pose())
        else:
            place_joint(bodies, i, q, here.X)
            R = pose_of(parent.X).R
            put_pose(here.X, Pose(matmul(R, pose_of(here.X).R), rotate(R, vec_of(here.X.p))))
        R = pose_of(here.X).R
        put_motion(here.S, rotate_motion(R, motion_of(b.S)))
        put_inertia(here.I, rotate_inertia(R, inertia_of(b.inertia)))


@inline
def _velocities(bodies: Bodies, work: Work, v: Vector) -> None:
    """v of every row and Ṡ = v × S, in root-aligned axes; every row of a joint has the velocity of its body."""
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        vi = rotate_motion(pose_of(here.X).R, joint_motion(bodies, i, v))
        if b.parent > 0:
            vi = add_motion(motion_at_child(vec_of(here.X.p), motion_of(parent.v)), vi)
        put_motion(here.v, vi)
        put_motion(here.dS, cross_motion(vi, motion_of(here.S)))


@inline
def coriolis_matrix(bodies: Bodies, work: Work, q: Config, v: Vector, C: Matrix) -> None:
    """Column and row of each subtree: C_ij = S_i·(I Ṡ_j + B S_j), C_ji = Ṡ_i·I S_j + S_i·Bᵀ S_j, for i above j.

    I and B belong to the subtree of j; Bᵀ S is a couple, the same about every origin. The rotor of j adds half of its
    couple's rate to C_ij and C_ji, and a term to B of the body that carries it, so that C remains the C of Γ.
    """
    n = len(bodies) - 1
    C[:] = 0.0
    to_root_aligned_axes(bodies, work, q)
    _velocities(bodies, work, v)
    for i in range(1, n + 1):
        put_coriolis_factor(work[i].B, coriolis_factor(inertia_of(work[i].I), motion_of(work[i].v)))

    for j in range(n, 0, -1):
        here, parent = work[j], work[bodies[j].parent]
        S, I, B = motion_of(here.S), inertia_of(here.I), coriolis_factor_of(here.B)
        F_dS = add_force(momentum(I, motion_of(here.dS)), coriolis_times(B, S))
        F_S = momentum(I, S)
        couple = coriolis_transpose_times(B, S)
        C[j - 1, j - 1] = power(S, F_dS)
        i = j
        while bodies[i].parent > 0:
            p = vec_of(work[i].X.p)
            F_dS, F_S = force_at_parent(p, F_dS), force_at_parent(p, F_S)
            if i == j and bodies[j].geared:
                e, de = rotor_in_root_axes(bodies, work, j)
                F_dS, F_S = add_couple(F_dS, scale(0.5, de)), add_couple(F_S, e)
                couple = add(couple, scale(0.5, de))
            i = bodies[i].parent
            Si = motion_of(work[i].S)
            C[i - 1, j - 1] = power(Si, F_dS)
            C[j - 1, i - 1] = power(motion_of(work[i].dS), F_S) + dot(Si.w, couple)
        if bodies[j].parent > 0:
            p = vec_of(here.X.p)
            put_inertia(parent.I, add_inertia(inertia_of(parent.I), inertia_at_parent(p, I)))
            put_coriolis_factor(
                parent.B, add_coriolis_factor(coriolis_factor_of(parent.B), coriolis_factor_at_parent(p, B))
            )
            if bodies[j].geared:
                e, _ = rotor_in_root_axes(bodies, work, j)
                put_coriolis_factor(
                    parent.B, add_coriolis_factor(coriolis_factor_of(parent.B), rotor_factor(v[j - 1], e))
                )


@inline
def mass_matrix_dot(bodies: Bodies, work: Work, q: Config, v: Vector, dM: Matrix) -> None:
    """Ṁ_ij = S_i·(İ S_j + I Ṡ_j) + Ṡ_i·I S_j with I of the subtree of j, for i above j; symmetric to the bit."""
    n = len(bodies) - 1
    dM[:] = 0.0
    to_root_aligned_axes(bodies, work, q)
    _velocities(bodies, work, v)
    for i in range(1, n + 1):
        put_inertia(work[i].dI, inertia_rate(inertia_of(work[i].I), motion_of(work[i].v)))

    for j in range(n, 0, -1):
        here, parent = work[j], work[bodies[j].parent]
        S, I, dI = motion_of(here.S), inertia_of(here.I), inertia_of(here.dI)
        F_dS = add_force(momentum(I, motion_of(here.dS)), momentum(dI, S))
        F_S = momentum(I, S)
        dM[j - 1, j - 1] = power(S, F_dS) + power(motion_of(here.dS), F_S)
        i = j
        while bodies[i].parent > 0:
            p = vec_of(work[i].X.p)
            F_dS, F_S = force_at_parent(p, F_dS), force_at_parent(p, F_S)
            if i == j and bodies[j].geared:
                e, de = rotor_in_root_axes(bodies, work, j)
                F_dS, F_S = add_couple(F_dS, de), add_couple(F_S, e)
            i = bodies[i].parent
            dMij = power(motion_of(work[i].S), F_dS) + power(motion_of(work[i].dS), F_S)
            dM[i - 1, j - 1] = dMij
            dM[j - 1, i - 1] = dMij
        if bodies[j].parent > 0:
            p = vec_of(here.X.p)
            put_inertia(parent.I, add_inertia(inertia_of(parent.I), inertia_at_parent(p, I)))
            put_inertia(parent.dI, add_inertia(inertia_of(parent.dI), inertia_at_parent(p, dI)))


@inline
def coriolis_transpose_times_velocity(bodies: Bodies, work: Work, q: Config, v: Vector, out: Vector) -> None:
    """Cᵀ v = ṗ without torque and gravity: (v_i × S_i)·h_i with h the momentum of the subtree of i."""
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
    rate(bodies, work, v, None, None, None, out)


@inline_or_by_rows
def modified_rnea(bodies: Bodies, work: Work, q: Config, v: Vector, v_r: Vector, a_r: Vector, tau: Vector) -> None:
    """The Newton-Euler recursion with two velocities of bodies: v, and w due to v_r, whose rate ẇ has a_r.

    Per body ẇ = S a_r + v × S v_r along the tree, and f = I ẇ + B(I, v) w. ``rnea`` is separate: there v = w, and
    products of ω with itself save a fifth of the work.
    """
    modified_sweeps(bodies, work, q, v, v_r, a_r, None, tau)


@inline
def modified_sweeps(
    bodies: Bodies, work: Work, q: Config, v: Vector, v_r: Vector, a_r: Vector, pi: Array, tau: Vector
) -> None:
    """``modified_rnea`` with other inertial parameters pi (njoints, 10), row 0 zero; None for the table's."""
    n = len(bodies) - 1
    put_motion(work[0].v, zero_motion())
    put_motion(work[0].w, zero_motion())
    put_motion(work[0].a, Motion(zero(), neg(vec_of(bodies[0].gravity))))
    put_force(work[0].f, zero_force())
    for i in range(1, n + 1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        S = motion_of(b.S)
        I = inertia_of(b.inertia) if pi is None else read_parameters(pi[b.joint])
        place_joint(bodies, i, q, here.X)
        X = pose_of(here.X)
        wJ = joint_motion(bodies, i, v_r)
        vi = body_velocity(bodies, work, i, v)
        wi = add_motion(motion_to_child(X, motion_of(parent.w)), wJ)
        ai = add_motion(motion_to_child(X, motion_of(parent.a)), cross_motion(vi, wJ))
        ai = add_motion(ai, scale_motion(a_r[i - 1], S))
        put_motion(here.v, vi)
        put_motion(here.w, wi)
        put_motion(here.a, ai)
        put_force(here.f, add_force(momentum(I, ai), coriolis_force(I, vi, wi)))
    for i in range(n, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        f = force_of(here.f)
        tau[i - 1] = power(motion_of(b.S), f) + b.armature * a_r[i - 1]
        put_force(parent.f, add_force(force_of(parent.f), force_to_parent(pose_of(here.X), f)))
        if b.coupled or b.partner > 0:
            tau[i - 1] = tau[i - 1] + of_other(bodies, i, a_r)
        if b.geared:
            e, w, dw = vec_of(b.rotor), motion_of(parent.w).w, motion_of(parent.a).w
            turned, de = cross(w, e), cross(motion_of(parent.v).w, e)
            tau[i - 1] = tau[i - 1] + dot(e, dw) + 0.5 * dot(de, w)
            half = scale(0.5, add(scale(v_r[i - 1], de), scale(v[i - 1], turned)))
            put_force(parent.f, add_couple(force_of(parent.f), add(scale(a_r[i - 1], e), half)))


_SOURCE = "Echeandia and Wensing, Coriolis matrix and Christoffel symbols (2021), with B in twelve numbers."
SPECS = (
    Spec(
        "coriolis_matrix", coriolis_matrix, WORK, (TURNED_Q, V),
        Argument("C", ("nv", "nv"), "kg m²/s | kg m/s | kg/s", "Coriolis matrix of the Christoffel symbols"),
        "Coriolis matrix C(q, v): C v + g(q) is the bias torque, C + Cᵀ = dM/dt, and dM/dt - 2C is skew-symmetric.",
        _SOURCE, regroup=True,
    ),
    Spec(
        "mass_matrix_dot", mass_matrix_dot, WORK_RATE, (TURNED_Q, V),
        Argument("dM", ("nv", "nv"), "kg m²/s | kg m/s | kg/s", "time derivative of M, symmetric"),
        "Time derivative of the mass matrix M(q) along v.", "after Featherstone, RBDA (2008), table 6.2.", regroup=True,
    ),
    Spec(
        "coriolis_transpose_times_velocity", coriolis_transpose_times_velocity, WORK_MOMENTUM, (TURNED_Q, V), TAU,
        "Cᵀ(q, v) v without C: the momentum p = M v obeys dp/dt = Cᵀ v + tau - g(q), and Cᵀ v is the gradient of the "
        "kinetic energy where v are velocities of coordinates.",
        "after Echeandia and Wensing, Coriolis matrix and Christoffel symbols (2021).", regroup=True,
    ),
    Spec(
        "modified_rnea", modified_rnea, WORK_MODIFIED,
        (
            TURNED_Q, V,
            Argument("v_r", V.shape, V.unit, "reference velocities"),
            Argument("a_r", A.shape, A.unit, "reference accelerations"),
        ),
        TAU,
        "Torque M(q) a_r + C(q, v) v_r + g(q) of a reference motion, without M or C: the feed-forward of "
        "passivity-based and adaptive controllers.",
        "after Slotine and Li, On the adaptive control of robot manipulators (1987), by a Newton-Euler recursion.",
        regroup=True,
    ),
)  # fmt: skip

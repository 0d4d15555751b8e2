"""The Coriolis matrix C(q, q̇) that the Levi-Civita connection of M gives, Ṁ, Cᵀq̇ and M a + C(q, q̇) b + g.

Of the many matrices with the right C q̇ this is the one of the Christoffel symbols: C_ij = Σ_k Γ_ijk v_k, so that
Ṁ = C + Cᵀ and Ṁ - 2C is skew-symmetric. It is so for quaternion joints as well, with the symbols of their
quasi-velocities (Koszul's formula; see ``christoffel``). All of it follows from M(q) alone: armatures, being
constant, have no part in it.

The matrices are seen in the axes of the first body of each branch that stands on the world, each row about its own
origin. M, C and Γ do not depend on where that body stands, so its pose never enters; rotations are made once a row,
and what climbs towards the root is only shifted. Roundoff is that of body coordinates, for no arm is longer than
a link. Source: Echeandia and Wensing, Numerical methods to compute the Coriolis matrix and Christoffel symbols for
rigid-body systems (2021), with the factor B in twelve numbers (``coriolis_factor.coupling``).
"""

from __future__ import annotations

from typing import Any

from ..algebra.coriolis_factor import (
    Coupling,
    add_coupling,
    coupled,
    coupled_back,
    coupled_force,
    coupling,
    unshift_coupling,
)
from ..algebra.euclidean import dot, matmul, negative, rotate, zero
from ..algebra.records import (
    coupling_of,
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_coupling,
    put_force,
    put_inertia,
    put_motion,
    put_pose,
    table_dtype,
    vec_of,
)
from ..algebra.scalars import inlined
from ..algebra.spatial import (
    Force,
    Inertia,
    Motion,
    Pose,
    add_force,
    add_inertia,
    add_motion,
    cross_motion,
    force_to_parent,
    identity_pose,
    inertia_rate,
    momentum,
    motion_to_child,
    power,
    rotate_inertia,
    rotate_motion,
    scale_motion,
    shift_motion,
    unshift_force,
    unshift_inertia,
    zero_force,
    zero_motion,
)
from ..bodies.joints import joint_motion, place_joint
from .hamilton import WORK_RATE as WORK_MOMENTUM
from .hamilton import rate
from .spec import TAU, A, Argument, Q, Spec, V

WORK = table_dtype(X=Pose, S=Motion, v=Motion, dS=Motion, I=Inertia, B=Coupling)
WORK_RATE = table_dtype(X=Pose, S=Motion, v=Motion, dS=Motion, I=Inertia, dI=Inertia)
WORK_MODIFIED = table_dtype(X=Pose, v=Motion, w=Motion, a=Motion, f=Force)


@inlined
def in_branch_axes(bodies: Any, work: Any, q: Any) -> None:
    """S and I of every row in the axes of its branch's first body, about its own origin.

    X.R are the row's axes there, X.p leads from the parent's origin to its own; of the first body the pose is 1.
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


@inlined
def _velocities(bodies: Any, work: Any, v: Any) -> None:
    """v of every row and Ṡ = v × S, in branch axes; every row of a joint has the velocity of its body."""
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        vi = rotate_motion(pose_of(here.X).R, joint_motion(bodies, i, v))
        if b.parent > 0:
            vi = add_motion(shift_motion(vec_of(here.X.p), motion_of(parent.v)), vi)
        put_motion(here.v, vi)
        put_motion(here.dS, cross_motion(vi, motion_of(here.S)))


@inlined
def _clear(A: Any, n: int) -> None:
    for i in range(n):
        for j in range(n):
            A[i, j] = 0.0


@inlined
def coriolis_matrix(bodies: Any, work: Any, q: Any, v: Any, C: Any) -> None:
    """Column and row of each subtree: C_ij = S_i·(I Ṡ_j + B S_j), C_ji = Ṡ_i·I S_j + S_i·Bᵀ S_j, for i above j.

    I and B are those of the subtree of j; Bᵀ S is a couple, which needs no shifting.
    """
    n = len(bodies) - 1
    _clear(C, n)
    in_branch_axes(bodies, work, q)
    _velocities(bodies, work, v)
    for i in range(1, n + 1):
        put_coupling(work[i].B, coupling(inertia_of(work[i].I), motion_of(work[i].v)))

    for j in range(n, 0, -1):
        here, parent = work[j], work[bodies[j].parent]
        S, I, B = motion_of(here.S), inertia_of(here.I), coupling_of(here.B)
        rate = add_force(momentum(I, motion_of(here.dS)), coupled(B, S))
        plain = momentum(I, S)
        couple = coupled_back(B, S)
        C[j - 1, j - 1] = power(S, rate)
        i = j
        while bodies[i].parent > 0:
            p = vec_of(work[i].X.p)
            rate, plain = unshift_force(p, rate), unshift_force(p, plain)
            i = bodies[i].parent
            Si = motion_of(work[i].S)
            C[i - 1, j - 1] = power(Si, rate)
            C[j - 1, i - 1] = power(motion_of(work[i].dS), plain) + dot(Si.w, couple)
        if bodies[j].parent > 0:
            p = vec_of(here.X.p)
            put_inertia(parent.I, add_inertia(inertia_of(parent.I), unshift_inertia(p, I)))
            put_coupling(parent.B, add_coupling(coupling_of(parent.B), unshift_coupling(p, B)))


@inlined
def mass_matrix_dot(bodies: Any, work: Any, q: Any, v: Any, dM: Any) -> None:
    """Ṁ_ij = S_i·(İ S_j + I Ṡ_j) + Ṡ_i·I S_j with I of the subtree of j, for i above j; symmetric to the bit."""
    n = len(bodies) - 1
    _clear(dM, n)
    in_branch_axes(bodies, work, q)
    _velocities(bodies, work, v)
    for i in range(1, n + 1):
        put_inertia(work[i].dI, inertia_rate(inertia_of(work[i].I), motion_of(work[i].v)))

    for j in range(n, 0, -1):
        here, parent = work[j], work[bodies[j].parent]
        S, I, dI = motion_of(here.S), inertia_of(here.I), inertia_of(here.dI)
        rate = add_force(momentum(I, motion_of(here.dS)), momentum(dI, S))
        plain = momentum(I, S)
        dM[j - 1, j - 1] = power(S, rate) + power(motion_of(here.dS), plain)
        i = j
        while bodies[i].parent > 0:
            p = vec_of(work[i].X.p)
            rate, plain = unshift_force(p, rate), unshift_force(p, plain)
            i = bodies[i].parent
            dMij = power(motion_of(work[i].S), rate) + power(motion_of(work[i].dS), plain)
            dM[i - 1, j - 1] = dMij
            dM[j - 1, i - 1] = dMij
        if bodies[j].parent > 0:
            p = vec_of(here.X.p)
            put_inertia(parent.I, add_inertia(inertia_of(parent.I), unshift_inertia(p, I)))
            put_inertia(parent.dI, add_inertia(inertia_of(parent.dI), unshift_inertia(p, dI)))


@inlined
def coriolis_transpose_times_velocity(bodies: Any, work: Any, q: Any, v: Any, out: Any) -> None:
    """Cᵀ v = ṗ without torque and gravity: (v_i × S_i)·h_i with h the momentum of the subtree of i."""
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
    rate(bodies, work, v, None, None, None, out)


@inlined
def modified_rnea(bodies: Any, work: Any, q: Any, v: Any, v_r: Any, a_r: Any, tau: Any) -> None:
    """The Newton-Euler recursion of two velocities, v and w: v moves the bodies, w is what a_r belongs to.

    Per body ẇ = S a_r + v × S v_r along the tree, and f = I ẇ + B(I, v) w. It is no case of ``rnea``: there v = w,
    and products of ω with itself save a fifth of the work.
    """
    n = len(bodies) - 1
    put_motion(work[0].v, zero_motion())
    put_motion(work[0].w, zero_motion())
    put_motion(work[0].a, Motion(zero(), negative(vec_of(bodies[0].gravity))))
    put_force(work[0].f, zero_force())
    for i in range(1, n + 1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        S, I = motion_of(b.S), inertia_of(b.inertia)
        place_joint(bodies, i, q, here.X)
        X = pose_of(here.X)
        wJ = joint_motion(bodies, i, v_r)
        vi = add_motion(motion_to_child(X, motion_of(parent.v)), joint_motion(bodies, i, v))
        wi = add_motion(motion_to_child(X, motion_of(parent.w)), wJ)
        ai = add_motion(motion_to_child(X, motion_of(parent.a)), cross_motion(vi, wJ))
        ai = add_motion(ai, scale_motion(a_r[i - 1], S))
        put_motion(here.v, vi)
        put_motion(here.w, wi)
        put_motion(here.a, ai)
        put_force(here.f, add_force(momentum(I, ai), coupled_force(I, vi, wi)))
    for i in range(n, 0, -1):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        f = force_of(here.f)
        tau[i - 1] = power(motion_of(b.S), f) + b.armature * a_r[i - 1]
        put_force(parent.f, add_force(force_of(parent.f), force_to_parent(pose_of(here.X), f)))


_SOURCE = "Echeandia and Wensing, Coriolis matrix and Christoffel symbols (2021), with B in twelve numbers."
SPECS = (
    Spec(
        "coriolis_matrix", coriolis_matrix, WORK, (Q, V),
        Argument("C", ("nv", "nv"), "kg m²/s | kg m/s | kg/s", "Coriolis matrix of the Christoffel symbols"),
        "Coriolis matrix C(q, v): C v + g(q) is the bias torque, C + Cᵀ = dM/dt, and dM/dt - 2C is skew-symmetric.",
        _SOURCE, regroup=True,
    ),
    Spec(
        "mass_matrix_dot", mass_matrix_dot, WORK_RATE, (Q, V),
        Argument("dM", ("nv", "nv"), "kg m²/s | kg m/s | kg/s", "time derivative of M, symmetric"),
        "Time derivative of the mass matrix M(q) along v.", "after Featherstone, RBDA (2008), table 6.2.", regroup=True,
    ),
    Spec(
        "coriolis_transpose_times_velocity", coriolis_transpose_times_velocity, WORK_MOMENTUM, (Q, V), TAU,
        "Cᵀ(q, v) v without C: the momentum p = M v obeys dp/dt = Cᵀ v + tau - g(q), and Cᵀ v is the gradient of the "
        "kinetic energy where v are velocities of coordinates.",
        "after Echeandia and Wensing, Coriolis matrix and Christoffel symbols (2021).", regroup=True,
    ),
    Spec(
        "modified_rnea", modified_rnea, WORK_MODIFIED,
        (
            Q, V,
            Argument("v_r", V.shape, V.unit, "reference velocities"),
            Argument("a_r", A.shape, A.unit, "reference accelerations"),
        ),
        TAU,
        "Torque M(q) a_r + C(q, v) v_r + g(q) of a reference, without M or C: what passivity-based and adaptive "
        "controllers feed forward.",
        "after Slotine and Li, On the adaptive control of robot manipulators (1987), by a Newton-Euler recursion.",
        regroup=True,
    ),
)  # fmt: skip

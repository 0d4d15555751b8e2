"""Derivatives of inverse and forward dynamics by the configuration, the velocity and what is given besides.

By the configuration means along ``integrate(q, e_k)``: a joint's own motion after it has moved to q.

Where row i moves by δ, what hangs on it turns as one rigid whole, and forces in it turn along. Seen from there the
world before i has moved: every body's velocity changes by Ṡ° = v_λ × S, its acceleration by S̈° - v × Ṡ° with
S̈° = a_λ × S + v_λ × Ṡ°; v_λ and a_λ are those of the body that i's joint stands on. With I, 2B and f of the subtree of
the deeper row j (``coriolis_factor``: 2B w = v ×* I w + w ×* I v - I (v × w)), and i above it,

    ∂τ_i/∂q_j = S_i·(I S̈°_j + 2B Ṡ°_j + S_j ×* f)    ∂τ_j/∂q_i = S_j·(I S̈°_i + 2B Ṡ°_i)
    ∂τ_i/∂v_j = S_i·(I D_j + 2B S_j)                 ∂τ_j/∂v_i = S_j·(I D_i + 2B S_i),    D = Ṡ° + v × S

of which all but f's term hold between the rows of one joint as well. The matrices are seen in the axes of the first
body of each branch, each row about its own origin, as those of ``coriolis`` are. Source: Singh, Russell, Wensing,
Efficient analytical derivatives of rigid-body dynamics using spatial vector algebra (2022).
"""

from __future__ import annotations

from typing import Any

from ..algebra.articulated import Articulated
from ..algebra.coriolis_factor import Coupling, add_coupling, coupled, coupled_back, coupling, unshift_coupling
from ..algebra.euclidean import Vec, cross, dot, negative, unrotate, zero
from ..algebra.records import (
    coupling_of,
    force_from,
    force_of,
    inertia_of,
    motion_of,
    pose_of,
    put_coupling,
    put_force,
    put_inertia,
    put_motion,
    put_pose,
    put_vec,
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
    cross_force,
    cross_motion,
    identity_pose,
    momentum,
    power,
    rotate_force,
    rotate_motion,
    scale_motion,
    shift_motion,
    sub_force,
    unshift_force,
    unshift_inertia,
    zero_motion,
)
from ..bodies.joints import joint_motion, place_joint
from ..bodies.table import FOLLOW
from .aba import aba, inverse_columns
from .coriolis import in_branch_axes
from .spec import FEXT, FEXT_OPTIONAL, TAU, A, Argument, Q, Spec, V

WORK = table_dtype(
    X=Pose, S=Motion, I=Inertia, v=Motion, a=Motion, dS=Motion, ddS=Motion, D=Motion, B=Coupling, f=Force
)
WORK_FORWARD = table_dtype(
    X=Pose, S=Motion, I=Inertia, v=Motion, a=Motion, dS=Motion, ddS=Motion, D=Motion, B=Coupling, f=Force,
    c=Motion, IA=Articulated, pA=Force, U=Force, d=float, u=float, F=Force, P=Motion,
)  # fmt: skip
WORK_STATIC = table_dtype(X=Pose, S=Motion, I=Inertia, g=Vec, f=Force)


@inlined
def _gravity(bodies: Any, i: int, q: Any, X: Any) -> Vec:
    """Gravity in the axes of the first body of a branch, whose joint starts at row i; X is left at 1."""
    place_joint(bodies, i, q, X)
    g = unrotate(pose_of(X).R, vec_of(bodies[0].gravity))
    put_pose(X, identity_pose())
    return g


@inlined
def outward(bodies: Any, work: Any, q: Any, v: Any, a: Any, fext: Any) -> None:
    """v, a, 2B and f of every body, and Ṡ°, S̈°, D of every row."""
    in_branch_axes(bodies, work, q)
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        if b.parent == 0:
            vp = zero_motion()
            ap = Motion(zero(), negative(_gravity(bodies, i, q, here.X)))
        else:
            p = vec_of(here.X.p)
            vp, ap = shift_motion(p, motion_of(parent.v)), shift_motion(p, motion_of(parent.a))
        R, I = pose_of(here.X).R, inertia_of(here.I)
        vJ = rotate_motion(R, joint_motion(bodies, i, v))
        vi = add_motion(vp, vJ)
        ai = add_motion(add_motion(ap, cross_motion(vp, vJ)), scale_motion(a[i - 1], motion_of(here.S)))
        for k in range(i, i + b.dofs):
            S = motion_of(work[k].S)
            dS = cross_motion(vp, S)
            put_motion(work[k].dS, dS)
            put_motion(work[k].ddS, add_motion(cross_motion(ap, S), cross_motion(vp, dS)))
            put_motion(work[k].D, add_motion(dS, cross_motion(vi, S)))
        B = coupling(I, vi)
        f = add_force(momentum(I, ai), coupled(B, vi))
        if fext is not None and b.joint > 0:
            f = sub_force(f, rotate_force(R, force_from(fext[b.joint])))
        put_motion(here.v, vi)
        put_motion(here.a, ai)
        put_force(here.f, f)
        put_coupling(here.B, add_coupling(B, B))


@inlined
def _pair(work: Any, i: int, j: int, turned: Force, moved: Force, plain: Force, couple: Vec, D: Any) -> None:
    """The entries of rows i, above or the same, and j, with the forces of j about the origin of i."""
    S, dS, ddS, Di = motion_of(work[i].S), motion_of(work[i].dS), motion_of(work[i].ddS), motion_of(work[i].D)
    M = power(S, plain)
    D[0, j - 1, i - 1] = power(ddS, plain) + dot(dS.w, couple)
    D[1, j - 1, i - 1] = power(Di, plain) + dot(S.w, couple)
    D[2, j - 1, i - 1] = M
    D[0, i - 1, j - 1] = power(S, turned)
    D[1, i - 1, j - 1] = power(S, moved)
    D[2, i - 1, j - 1] = M


@inlined
def rnea_derivatives(bodies: Any, work: Any, q: Any, v: Any, a: Any, fext: Any, D: Any) -> None:
    """Column and row of each subtree, as the module has it; fext may be None, for zero."""
    n = len(bodies) - 1
    for k in range(3):
        for i in range(n):
            for j in range(n):
                D[k, i, j] = 0.0
    outward(bodies, work, q, v, a, fext)

    for j in range(n, 0, -1):
        here, parent = work[j], work[bodies[j].parent]
        S, I, B, f = motion_of(here.S), inertia_of(here.I), coupling_of(here.B), force_of(here.f)
        plain = momentum(I, S)
        turned = add_force(momentum(I, motion_of(here.ddS)), coupled(B, motion_of(here.dS)))
        moved = add_force(momentum(I, motion_of(here.D)), coupled(B, S))
        couple = coupled_back(B, S)
        _pair(work, j, j, turned, moved, plain, couple, D)
        D[2, j - 1, j - 1] = D[2, j - 1, j - 1] + bodies[j].armature
        i = j
        while bodies[i].kind == FOLLOW:
            i = bodies[i].parent
            _pair(work, i, j, turned, moved, plain, couple, D)
        turned = add_force(turned, cross_force(S, f))
        while bodies[i].parent > 0:
            p = vec_of(work[i].X.p)
            turned, moved, plain = unshift_force(p, turned), unshift_force(p, moved), unshift_force(p, plain)
            i = bodies[i].parent
            _pair(work, i, j, turned, moved, plain, couple, D)
        if bodies[j].parent > 0:
            p = vec_of(here.X.p)
            put_inertia(parent.I, add_inertia(inertia_of(parent.I), unshift_inertia(p, I)))
            put_coupling(parent.B, add_coupling(coupling_of(parent.B), unshift_coupling(p, B)))
            put_force(parent.f, add_force(force_of(parent.f), unshift_force(p, f)))


@inlined
def static_torque_derivatives(bodies: Any, work: Any, q: Any, fext: Any, D: Any) -> None:
    """The same at rest, where Ṡ° = 0 and S̈° = -g × S, which is linear alone; fext may be None, for zero."""
    n = len(bodies) - 1
    for i in range(n):
        for j in range(n):
            D[i, j] = 0.0
    in_branch_axes(bodies, work, q)
    for i in range(1, n + 1):
        b, here = bodies[i], work[i]
        g = _gravity(bodies, i, q, here.X) if b.parent == 0 else vec_of(work[b.parent].g)
        I = inertia_of(here.I)
        f = momentum(I, Motion(zero(), negative(g)))
        if fext is not None and b.joint > 0:
            f = sub_force(f, rotate_force(pose_of(here.X).R, force_from(fext[b.joint])))
        put_vec(here.g, g)
        put_force(here.f, f)

    for j in range(n, 0, -1):
        here, parent = work[j], work[bodies[j].parent]
        S, I, f, g = motion_of(here.S), inertia_of(here.I), force_of(here.f), vec_of(here.g)
        plain = momentum(I, S).f  # needs no shifting, and S̈° asks for no more
        turned = momentum(I, Motion(zero(), cross(S.w, g)))
        D[j - 1, j - 1] = power(S, turned)
        i = j
        while bodies[i].kind == FOLLOW:
            i = bodies[i].parent
            D[j - 1, i - 1] = dot(cross(motion_of(work[i].S).w, g), plain)
            D[i - 1, j - 1] = power(motion_of(work[i].S), turned)
        turned = add_force(turned, cross_force(S, f))
        while bodies[i].parent > 0:
            turned = unshift_force(vec_of(work[i].X.p), turned)
            i = bodies[i].parent
            D[j - 1, i - 1] = dot(cross(motion_of(work[i].S).w, g), plain)
            D[i - 1, j - 1] = power(motion_of(work[i].S), turned)
        if bodies[j].parent > 0:
            p = vec_of(here.X.p)
            put_inertia(parent.I, add_inertia(inertia_of(parent.I), unshift_inertia(p, I)))
            put_force(parent.f, add_force(force_of(parent.f), unshift_force(p, f)))


@inlined
def aba_derivatives(
    bodies: Any, work: Any, q: Any, v: Any, tau: Any, fext: Any, D: Any, pivots: Any, a: Any, inverse: Any
) -> None:
    """-M⁻¹ ∂τ/∂q, -M⁻¹ ∂τ/∂v and M⁻¹ at the acceleration that tau causes; fext may be None, for zero.

    a (nv), inverse (nv, nv), written: that acceleration and M⁻¹
    """
    n = len(bodies) - 1
    aba(bodies, work, q, v, tau, fext, a, pivots)
    inverse_columns(bodies, work, inverse)
    rnea_derivatives(bodies, work, q, v, a, fext, D)
    for k in range(2):
        by = D[2]  # M is not needed
        for i in range(n):
            for j in range(n):
                by[i, j] = D[k, i, j]
                D[k, i, j] = 0.0
        for m in range(1, n + 1):
            root = m
            while bodies[root].parent > 0:
                root = bodies[root].parent
            row = by[m - 1, root - 1 : bodies[m].last]  # of rows that carry m, and that it carries; a view from 0 on
            for i in range(root, bodies[root].last + 1):  # becomes SIMD code
                x, out = inverse[i - 1, m - 1], D[k, i - 1, root - 1 : bodies[m].last]
                for j in range(len(row)):
                    out[j] = out[j] - x * row[j]
    for i in range(n):
        for j in range(n):
            D[2, i, j] = inverse[i, j]


_SOURCE = "Singh, Russell, Wensing, Efficient analytical derivatives of rigid-body dynamics (2022)."
_ALONG = "along integrate(q, e_k)"
_BY_Q = "N m/rad | N | N/m"
SPECS = (
    Spec(
        "rnea_derivatives", rnea_derivatives, WORK, (Q, V, A, FEXT_OPTIONAL),
        Argument(
            "dtau", (3, "nv", "nv"), f"{_BY_Q}; N m s/rad | N s | N s/m; kg m² | kg m | kg",
            f"∂tau/∂q {_ALONG}, ∂tau/∂v and ∂tau/∂a = M",
        ),
        "Derivatives of the inverse dynamics tau = rnea(q, v, a): ``dtau_dq, dtau_dv, M = rnea_derivatives(...)``.",
        _SOURCE, regroup=True,
    ),
    Spec(
        "aba_derivatives", aba_derivatives, WORK_FORWARD, (Q, V, TAU, FEXT_OPTIONAL),
        Argument(
            "da", (3, "nv", "nv"), "1/s² | 1/(m s²) | m/s²; 1/s | 1/(m s) | m/s; 1/(kg m²) | 1/(kg m) | 1/kg",
            f"∂a/∂q {_ALONG}, ∂a/∂v and ∂a/∂tau = M⁻¹",
        ),
        "Derivatives of the forward dynamics a = aba(q, v, tau): ``da_dq, da_dv, Minv = aba_derivatives(...)``.\n\n"
        "    A program of them grows with the cube of nv: of more than 25, batches run sample by sample unless\n"
        "    ``specialize`` is asked for one, which is several times faster and takes half a minute to compile.",
        _SOURCE, pivots=True, regroup=True, terms=("nv",) * 3, spare=(("nv",), ("nv", "nv")),
    ),
    Spec(
        "generalized_gravity_derivatives", static_torque_derivatives, WORK_STATIC, (Q, None),
        Argument("dg", ("nv", "nv"), _BY_Q, f"∂g_i/∂q_k {_ALONG}"),
        "Derivatives of the gravity torque g(q): the stiffness that gravity makes.", _SOURCE, regroup=True,
    ),
    Spec(
        "static_torque_derivatives", static_torque_derivatives, WORK_STATIC, (Q, FEXT),
        Argument("dtau", ("nv", "nv"), _BY_Q, f"∂tau_i/∂q_k {_ALONG}, each force fixed in its joint's frame"),
        "Derivatives of the torque g(q) - Σ Jᵀ fext that holds the robot still.", _SOURCE, regroup=True,
    ),
)  # fmt: skip

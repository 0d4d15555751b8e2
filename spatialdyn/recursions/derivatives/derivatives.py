"""Derivatives of inverse and forward dynamics with respect to configuration, velocity, and acceleration or torque.

Derivatives with respect to the configuration are along ``integrate(q, e_k)``, a joint's own motion from q.

If row i moves by δ, its subtree moves as one rigid body, with its forces. Seen from the subtree, all bodies before i
have moved: every body's velocity changes by Ṡ° = v_λ × S, its acceleration by S̈° - v × Ṡ° with
S̈° = a_λ × S + v_λ × Ṡ°; v_λ and a_λ belong to the body that i's joint stands on. With I, 2B and f of the subtree of the
deeper row j (``coriolis_factor``: 2B w = v ×* I w + w ×* I v - I (v × w)), and i above it,

    ∂τ_i/∂q_j = S_i·(I S̈°_j + 2B Ṡ°_j + S_j ×* f)    ∂τ_j/∂q_i = S_j·(I S̈°_i + 2B Ṡ°_i)
    ∂τ_i/∂v_j = S_i·(I D_j + 2B S_j)                 ∂τ_j/∂v_i = S_j·(I D_i + 2B S_i),    D = Ṡ° + v × S

Between the rows of one joint these hold without the term of f. A rotor of row j adds its couple n J e and the couple's
rate to the forces of S_j, the rate also to Bᵀ S_j, and terms to f and 2B of the body that carries it (``rotors``). All
is in the root-aligned axes of ``coriolis``, each row about its own origin. Source: Singh, Russell, Wensing, Efficient
analytical derivatives of rigid-body dynamics using spatial vector algebra (2022).
"""

from __future__ import annotations

from ...algebra.articulated import Articulated
from ...algebra.coriolis_factor import (
    CoriolisFactor,
    add_coriolis_factor,
    coriolis_factor,
    coriolis_factor_at_parent,
    coriolis_times,
    coriolis_transpose_times,
)
from ...algebra.euclidean import Vec, add, cross, dot, neg, scale, unrotate, zero
from ...algebra.public_arrays import read_force
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
    put_vec,
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
    cross_force,
    cross_motion,
    force_at_parent,
    identity_pose,
    inertia_at_parent,
    momentum,
    motion_at_child,
    power,
    rotate_force,
    rotate_motion,
    scale_motion,
    sub_force,
    zero_motion,
)
from ...bodies.joints import joint_motion, place_joint
from ...bodies.kinds import CONTINUED
from ..momenta.coriolis import to_root_aligned_axes
from ..signatures import Array, Bodies, Config, Matrix, Record, Vector, Work
from ..spec import FEXT, FEXT_OPTIONAL, TAU, TURNED_Q, A, Argument, MassMatrix, Spec, V
from ..tree.aba import aba, acceleration_through_M, inverse_columns
from ..tree.ltdl import factor_tree, solve_inward, solve_outward
from ..tree.rotors import add_couple, rotor_factor, rotor_in_root_axes

WORK = table_dtype(
    X=Pose,  # pose of the row relative to its parent's, in root-aligned axes; outward
    S=Motion,  # motion subspace in root-aligned axes; outward
    I=Inertia,  # inertia in root-aligned axes, outward; of the subtree, inward
    v=Motion,  # velocity; outward
    a=Motion,  # acceleration less gravity; outward
    dS=Motion,  # Ṡ° = v_λ × S; outward
    ddS=Motion,  # S̈°; outward
    D=Motion,  # Ṡ° + v × S; outward
    B=CoriolisFactor,  # 2B, outward; of the subtree, inward
    f=Force,  # force that moves the body, outward; of the subtree, inward
)
WORK_FORWARD = table_dtype(
    X=Pose,  # as in WORK, as are the fields to f; before, aba has its own X, v and a in them
    S=Motion,
    I=Inertia,
    v=Motion,
    a=Motion,
    dS=Motion,
    ddS=Motion,
    D=Motion,
    B=CoriolisFactor,
    f=Force,
    c=Motion,  # of aba, as are the fields to u
    IA=Articulated,
    pA=Force,
    U=Force,
    d=float,
    u=float,
    F=Force,  # of minverse
    P=Motion,  # of minverse
)
WORK_STATIC = table_dtype(
    X=Pose,  # pose of the row relative to its parent's, in root-aligned axes; outward
    S=Motion,  # motion subspace in root-aligned axes; outward
    I=Inertia,  # inertia in root-aligned axes, outward; of the subtree, inward
    g=Vec,  # gravity in root-aligned axes; outward
    f=Force,  # force that holds the body against gravity and fext, outward; of the subtree, inward
)


@inline
def _gravity(bodies: Bodies, i: int, q: Config, X: Record) -> Vec:
    """Gravity in root-aligned axes, of the branch whose first joint starts at row i; X is reset to 1."""
    place_joint(bodies, i, q, X)
    g = unrotate(pose_of(X).R, vec_of(bodies[0].gravity))
    put_pose(X, identity_pose())
    return g


@inline
def motion_outward(bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, fext: Matrix) -> None:
    """v, a, 2B and f of every body, and Ṡ°, S̈°, D of every row."""
    to_root_aligned_axes(bodies, work, q)
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        if b.parent == 0:
            vp = zero_motion()
            ap = Motion(zero(), neg(_gravity(bodies, i, q, here.X)))
        else:
            p = vec_of(here.X.p)
            vp, ap = motion_at_child(p, motion_of(parent.v)), motion_at_child(p, motion_of(parent.a))
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
        B = coriolis_factor(I, vi)
        f = add_force(momentum(I, ai), coriolis_times(B, vi))
        if fext is not None and b.joint > 0:
            f = sub_force(f, rotate_force(R, read_force(fext[b.joint])))
        put_motion(here.v, vi)
        put_motion(here.a, ai)
        put_force(here.f, f)
        put_coriolis_factor(here.B, add_coriolis_factor(B, B))


@inline
def _pair(work: Work, i: int, j: int, F_dq: Force, F_dv: Force, F_S: Force, couple: Vec, D: Array) -> None:
    """Entries (i, j) and (j, i) of the derivatives, row i above j or j itself; the forces of j are about i's origin."""
    S, dS, ddS, Di = motion_of(work[i].S), motion_of(work[i].dS), motion_of(work[i].ddS), motion_of(work[i].D)
    M = power(S, F_S)
    D[0, j - 1, i - 1] = power(ddS, F_S) + dot(dS.w, couple)
    D[1, j - 1, i - 1] = power(Di, F_S) + dot(S.w, couple)
    D[2, j - 1, i - 1] = M
    D[0, i - 1, j - 1] = power(S, F_dq)
    D[1, i - 1, j - 1] = power(S, F_dv)
    D[2, i - 1, j - 1] = M


@inline
def rnea_derivatives(bodies: Bodies, work: Work, q: Config, v: Vector, a: Vector, fext: Matrix, D: Array) -> None:
    """Column and row of each subtree, by the module's formulas; fext may be None, for zero."""
    n = len(bodies) - 1
    D[:] = 0.0
    motion_outward(bodies, work, q, v, a, fext)

    for j in range(n, 0, -1):
        here, parent = work[j], work[bodies[j].parent]
        S, I, B, f = motion_of(here.S), inertia_of(here.I), coriolis_factor_of(here.B), force_of(here.f)
        F_S = momentum(I, S)
        F_dq = add_force(momentum(I, motion_of(here.ddS)), coriolis_times(B, motion_of(here.dS)))
        F_dv = add_force(momentum(I, motion_of(here.D)), coriolis_times(B, S))
        couple = coriolis_transpose_times(B, S)
        _pair(work, j, j, F_dq, F_dv, F_S, couple, D)
        D[2, j - 1, j - 1] = D[2, j - 1, j - 1] + bodies[j].armature
        i = j
        while bodies[i].kind == CONTINUED:
            i = bodies[i].parent
            _pair(work, i, j, F_dq, F_dv, F_S, couple, D)
        F_dq = add_force(F_dq, cross_force(S, f))
        while bodies[i].parent > 0:
            p = vec_of(work[i].X.p)
            F_dq, F_dv, F_S = force_at_parent(p, F_dq), force_at_parent(p, F_dv), force_at_parent(p, F_S)
            if i == j and bodies[j].geared:
                e, de = rotor_in_root_axes(bodies, work, j)
                F_dv, F_S, couple = add_couple(F_dv, de), add_couple(F_S, e), add(couple, de)
            i = bodies[i].parent
            _pair(work, i, j, F_dq, F_dv, F_S, couple, D)
            if i == bodies[j].parent and bodies[j].coupled:
                D[2, i - 1, j - 1] = D[2, i - 1, j - 1] + bodies[j].coupling
                D[2, j - 1, i - 1] = D[2, j - 1, i - 1] + bodies[j].coupling
        if bodies[j].parent > 0:
            p = vec_of(here.X.p)
            put_inertia(parent.I, add_inertia(inertia_of(parent.I), inertia_at_parent(p, I)))
            put_coriolis_factor(
                parent.B, add_coriolis_factor(coriolis_factor_of(parent.B), coriolis_factor_at_parent(p, B))
            )
            put_force(parent.f, add_force(force_of(parent.f), force_at_parent(p, f)))
            if bodies[j].geared:
                add_rotor(bodies, work, j, v, a)


@inline
def add_rotor(bodies: Bodies, work: Work, j: int, v: Vector, a: Vector) -> None:
    """Add the rotor of row j to 2B and f of the body that carries it."""
    parent = work[bodies[j].parent]
    e, de = rotor_in_root_axes(bodies, work, j)
    put_coriolis_factor(parent.B, add_coriolis_factor(coriolis_factor_of(parent.B), rotor_factor(2.0 * v[j - 1], e)))
    put_force(parent.f, add_couple(force_of(parent.f), add(scale(a[j - 1], e), scale(v[j - 1], de))))


@inline
def static_torque_derivatives(bodies: Bodies, work: Work, q: Config, fext: Matrix, D: Array) -> None:
    """The same at rest, where Ṡ° = 0 and S̈° = -g × S has only a linear part; fext may be None, for zero."""
    n = len(bodies) - 1
    D[:] = 0.0
    to_root_aligned_axes(bodies, work, q)
    for i in range(1, n + 1):
        b, here = bodies[i], work[i]
        g = _gravity(bodies, i, q, here.X) if b.parent == 0 else vec_of(work[b.parent].g)
        I = inertia_of(here.I)
        f = momentum(I, Motion(zero(), neg(g)))
        if fext is not None and b.joint > 0:
            f = sub_force(f, rotate_force(pose_of(here.X).R, read_force(fext[b.joint])))
        put_vec(here.g, g)
        put_force(here.f, f)

    for j in range(n, 0, -1):
        here, parent = work[j], work[bodies[j].parent]
        S, I, f, g = motion_of(here.S), inertia_of(here.I), force_of(here.f), vec_of(here.g)
        f_S = momentum(I, S).f  # only the linear part, the same about every origin, pairs with S̈°
        F_dq = momentum(I, Motion(zero(), cross(S.w, g)))
        D[j - 1, j - 1] = power(S, F_dq)
        i = j
        while bodies[i].kind == CONTINUED:
            i = bodies[i].parent
            D[j - 1, i - 1] = dot(cross(motion_of(work[i].S).w, g), f_S)
            D[i - 1, j - 1] = power(motion_of(work[i].S), F_dq)
        F_dq = add_force(F_dq, cross_force(S, f))
        while bodies[i].parent > 0:
            F_dq = force_at_parent(vec_of(work[i].X.p), F_dq)
            i = bodies[i].parent
            D[j - 1, i - 1] = dot(cross(motion_of(work[i].S).w, g), f_S)
            D[i - 1, j - 1] = power(motion_of(work[i].S), F_dq)
        if bodies[j].parent > 0:
            p = vec_of(here.X.p)
            put_inertia(parent.I, add_inertia(inertia_of(parent.I), inertia_at_parent(p, I)))
            put_force(parent.f, add_force(force_of(parent.f), force_at_parent(p, f)))


@inline
def _negative_product(A: Matrix, B: Matrix, out: Matrix) -> None:
    """out = -A B, adding four rows of B at a time: loops over a row become SIMD code, faster than row by row."""
    n = len(A)
    for i in range(n):
        row = out[i]
        for j in range(n):
            row[j] = 0.0
        for m in range(0, n - 3, 4):
            w, x, y, z = A[i, m], A[i, m + 1], A[i, m + 2], A[i, m + 3]
            a, b, c, d = B[m], B[m + 1], B[m + 2], B[m + 3]
            for j in range(n):
                row[j] = row[j] - w * a[j] - x * b[j] - y * c[j] - z * d[j]
        for m in range(n - n % 4, n):
            x, a = A[i, m], B[m]
            for j in range(n):
                row[j] = row[j] - x * a[j]


@inline
def aba_derivatives(
    bodies: Bodies,
    work: Work,
    q: Config,
    v: Vector,
    tau: Vector,
    fext: Matrix,
    D: Array,
    pivots: Vector,
    a: Vector,
    inverse: Matrix,
) -> None:
    """-M⁻¹ ∂τ/∂q, -M⁻¹ ∂τ/∂v and M⁻¹ at the acceleration of ABA; fext may be None, for zero.

    a (nv), inverse (nv, nv), written: the acceleration and M⁻¹
    """
    aba(bodies, work, q, v, tau, fext, a, pivots)
    inverse_columns(bodies, work, inverse)
    rnea_derivatives(bodies, work, q, v, a, fext, D)
    _times_inverse(inverse, D)


@inline_or_by_rows
def aba_derivatives_by_factor(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, D: Array, pivots: Vector, a: Vector,
    inverse: Matrix,
) -> None:  # fmt: skip
    """``aba_derivatives`` by M = LᵀD L, for programs: for 7 joints 4218 operations instead of 5355, as accurate.

    The derivatives at zero acceleration include M, and leave the bias in the forces of the subtrees. In a program the
    terms that do not depend on the acceleration are computed once; a kernel would compute them twice.
    """
    n = len(bodies) - 1
    for i in range(n):
        a[i] = 0.0
    rnea_derivatives(bodies, work, q, v, a, fext, D)
    L = D[2]
    factor_tree(bodies, L)
    for i in range(1, n + 1):
        bias = power(motion_of(work[i].S), force_of(work[i].f))
        if bodies[i].geared:
            e, _ = rotor_in_root_axes(bodies, work, i)
            bias = bias + dot(e, motion_of(work[bodies[i].parent].a).w)
        a[i - 1] = tau[i - 1] - bias
        pivots[i - 1] = L[i - 1, i - 1]
        L[i - 1, i - 1] = 1.0 / L[i - 1, i - 1]
    solve_inward(bodies, L, a)
    columns, scaled = D[0], D[1]  # of L⁻¹, and by 1/D
    for k in range(n):
        a[k] = L[k, k] * a[k]
        for i in range(n):
            columns[k, i] = 0.0
        columns[k, k] = 1.0
        solve_outward(bodies, L, columns[k])
        for i in range(n):
            scaled[k, i] = L[k, k] * columns[k, i]
    solve_outward(bodies, L, a)
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(j + 1):
                total = total + columns[k, i] * scaled[k, j]
            inverse[i, j] = total
            inverse[j, i] = total
    rnea_derivatives(bodies, work, q, v, a, fext, D)
    _times_inverse(inverse, D)


@inline
def _times_inverse(inverse: Matrix, D: Array) -> None:
    """Turn derivatives of τ by q, v, a into derivatives of a by q, v, τ."""
    n = len(inverse)
    for k in range(2):
        by = D[2]  # as scratch: M is not needed
        for i in range(n):
            for j in range(n):
                by[i, j] = D[k, i, j]
        _negative_product(inverse, by, D[k])
    for i in range(n):
        for j in range(n):
            D[2, i, j] = inverse[i, j]


def aba_derivatives_through_M(M: MassMatrix, q: Array, v: Array, tau: Array, fext: Array) -> tuple[Array, Array, Array]:
    """-M⁻¹ ∂rnea/∂q, -M⁻¹ ∂rnea/∂v and M⁻¹, at the accelerations of ABA."""
    a = acceleration_through_M(M, q, v, tau, fext)
    by = M.call("rnea_derivatives", q, v, a, fext)
    return -M.inverse @ by[:, 0], -M.inverse @ by[:, 1], M.inverse


_SOURCE = "Singh, Russell, Wensing, Efficient analytical derivatives of rigid-body dynamics (2022)."
_ALONG = "along integrate(q, e_k)"
_BY_Q = "N m/rad | N | N/m"
SPECS = (
    Spec(
        "rnea_derivatives", rnea_derivatives, WORK, (TURNED_Q, V, A, FEXT_OPTIONAL),
        Argument(
            "dtau", (3, "nv", "nv"), f"{_BY_Q}; N m s/rad | N s | N s/m; kg m² | kg m | kg",
            f"∂tau/∂q {_ALONG}, ∂tau/∂v and ∂tau/∂a = M",
        ),
        "Derivatives of the inverse dynamics tau = rnea(q, v, a): ``dtau_dq, dtau_dv, M = rnea_derivatives(...)``.",
        _SOURCE, regroup=True,
    ),
    Spec(
        "aba_derivatives", aba_derivatives, WORK_FORWARD, (TURNED_Q, V, TAU, FEXT_OPTIONAL),
        Argument(
            "da", (3, "nv", "nv"), "1/s² | 1/(m s²) | m/s²; 1/s | 1/(m s) | m/s; 1/(kg m²) | 1/(kg m) | 1/kg",
            f"∂a/∂q {_ALONG}, ∂a/∂v and ∂a/∂tau = M⁻¹",
        ),
        "Derivatives of the forward dynamics a = aba(q, v, tau): ``da_dq, da_dv, Minv = aba_derivatives(...)``.\n\n"
        "    Their program grows with nv³: above nv = 25 batches run sample by sample. A program that ``specialize``\n"
        "    makes for such a robot is faster, but takes long to compile.",
        _SOURCE, pivots=True, regroup=True, term_shape=("nv",) * 3, scratch=(("nv",), ("nv", "nv")),
        through_M=aba_derivatives_through_M,
    ),
    Spec(
        "generalized_gravity_derivatives", static_torque_derivatives, WORK_STATIC, (TURNED_Q, None),
        Argument("dg", ("nv", "nv"), _BY_Q, f"∂g_i/∂q_k {_ALONG}"),
        "Derivatives of the gravity torque g(q): the stiffness due to gravity.", _SOURCE, regroup=True,
    ),
    Spec(
        "static_torque_derivatives", static_torque_derivatives, WORK_STATIC, (TURNED_Q, FEXT),
        Argument("dtau", ("nv", "nv"), _BY_Q, f"∂tau_i/∂q_k {_ALONG}, each force fixed in its joint's frame"),
        "Derivatives of the torque g(q) - Σ Jᵀ fext that holds the robot still.", _SOURCE, regroup=True,
    ),
)  # fmt: skip

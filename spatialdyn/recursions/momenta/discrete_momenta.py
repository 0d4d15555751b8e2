"""Momenta of discrete mechanics at the two ends of a step, in O(n) on the joints' group.

In a step each body moves from its pose T_i to T_i exp(h V_i). The discrete Lagrangian, h times the kinetic energy
Σ ½ V_i·I_i V_i less the mean of the potential energy at both ends, has the momenta

    μ⁻_i = (dexp⁻¹ at +h V_i)ᵀ I_i V_i    at the beginning, in the body's frame there
    μ⁺_i = (dexp⁻¹ at -h V_i)ᵀ I_i V_i    at the end, in the body's frame there

which the inward sweep of the RNEA, Jᵀ, projects on the joints. Armatures add armature ξ to both, ξ the displacement of
the joints. Displacements of bodies are stored as (quaternion, translation): both keep their relative accuracy for any
small step, so the relative rounding error of a momentum is 1e-16, not 1e-16 / h.

Source: Lee, Liu, Park, Srinivasa, A linear-time variational integrator for multibody systems (2016); the form in (q, p)
and on joints of several freedoms is derived here.
"""

from __future__ import annotations

from ...algebra.euclidean import Vec, add, cross, dot, scale, unrotate, zero
from ...algebra.lie import Quat, Tangent, exp_rotation, exp_travel, log_jacobian, log_rotation, log_travel, product
from ...algebra.records import force_of, inertia_of, motion_of, pose_of, put_force, put_vec, table_dtype, vec_of
from ...algebra.scalars import Scalar, inline, inline_or_by_rows, select
from ...algebra.spatial import Force, Motion, Pose, add_force, force_to_parent, momentum, power, zero_force
from ...bodies.joints import joint_motion, place_joint
from ...bodies.kinds import CONTINUED
from ..coordinates.configuration import integrate
from ..signatures import Array, Bodies, Config, Matrix, Record, Vector, Work
from ..spec import FEXT_OPTIONAL, TAU, Argument, Q, Spec
from ..tree.rotors import of_other
from .hamilton import momentum_rate

WORK_BEFORE = table_dtype(X=Pose, x=float, y=float, z=float, w=float, d=Vec, p=Force)
WORK_AFTER = table_dtype(X=Pose, p=Force)
WORK = table_dtype(X=Pose, x=float, y=float, z=float, w=float, d=Vec, p=Force, v=Motion, g=Vec, f=Force)


@inline_or_by_rows
def sum_before(bodies: Bodies, work: Work, q: Config, xi: Vector, moved: Matrix, out: Vector) -> Scalar:
    """h J(q)ᵀ μ⁻: the momenta at the beginning of a step of unit length.

    q      (nq)         coordinates at the beginning of the step
    xi     (nv)         displacement of the joints
    moved  (rows + 1, 6)  written: the twist log(T⁻¹ T⁺) = h V of every body, angular first
    out    (nv)         written
    Returns the least cosine of half the angle by which a body turns.
    """
    least = 1.0
    _put_displacement(work[0], Quat(0.0, 0.0, 0.0, 1.0), zero())
    put_force(work[0].p, zero_force())
    for i in range(1, len(bodies)):
        b, here, parent = bodies[i], work[i], work[bodies[i].parent]
        place_joint(bodies, i, q, here.X)
        X = pose_of(here.X)
        a, d = _carried(X, Quat(parent.x, parent.y, parent.z, parent.w), vec_of(parent.d))
        if b.kind != CONTINUED:
            m = joint_motion(bodies, i, xi)
            t = exp_travel(m)
            a, d = product(a, exp_rotation(m.w)), add(add(d, t), _turned(a, t))
        _put_displacement(here, a, d)
        put_force(here.p, zero_force())
        if b.joint > 0:
            least = select(least - a.w, a.w, least)
            w = log_rotation(a)
            V = Motion(w, log_travel(w, d))
            _put_twist(moved[i], V)
            put_force(here.p, _dual(log_jacobian(V, -1.0), -1.0, momentum(inertia_of(b.inertia), V)))
        if b.geared:
            _add_spin(bodies, work, i, moved, xi, -1.0)
    _sum_inward(bodies, work, out)
    _add_rotors(bodies, xi, out)
    _add_along(bodies, moved, out)
    return least


@inline_or_by_rows
def momenta_after(bodies: Bodies, work: Work, q: Config, xi: Vector, moved: Matrix, out: Vector) -> int:
    """h J(q⁺)ᵀ μ⁺, the momenta at the end of a step of unit length; q is q⁺, and ``moved`` is read."""
    put_force(work[0].p, zero_force())
    for i in range(1, len(bodies)):
        b, here = bodies[i], work[i]
        place_joint(bodies, i, q, here.X)
        put_force(here.p, zero_force())
        if b.joint > 0:
            V = _twist(moved[i])
            put_force(here.p, _dual(log_jacobian(V, 1.0), 1.0, momentum(inertia_of(b.inertia), V)))
        if b.geared:
            _add_spin(bodies, work, i, moved, xi, 1.0)
    _sum_inward(bodies, work, out)
    _add_rotors(bodies, xi, out)
    _add_along(bodies, moved, out)
    return 0


@inline
def _add_spin(bodies: Bodies, work: Work, i: int, moved: Matrix, xi: Vector, side: float) -> None:
    """Add the momentum n J ξ e of the rotor of row i to that of the body that carries it."""
    parent = work[bodies[i].parent]
    spun = Force(scale(xi[i - 1], vec_of(bodies[i].rotor)), zero())
    V = _twist(moved[bodies[i].parent])
    put_force(parent.p, add_force(force_of(parent.p), _dual(log_jacobian(V, side), side, spun)))


@inline
def _add_along(bodies: Bodies, moved: Matrix, out: Vector) -> None:
    """out += n J e·w of the rotors, w the turn of the carrying body: the discrete energy has the term n J ξ e·w."""
    for i in range(1, len(bodies)):
        if bodies[i].geared:
            out[i - 1] += dot(vec_of(bodies[i].rotor), _twist(moved[bodies[i].parent]).w)


@inline
def _sum_inward(bodies: Bodies, work: Work, out: Vector) -> None:
    """out_i = S_i · (sum of the momenta of the subtree of row i)."""
    for i in range(len(bodies) - 1, 0, -1):
        here, parent = work[i], work[bodies[i].parent]
        p = force_of(here.p)
        out[i - 1] = power(motion_of(bodies[i].S), p)
        put_force(parent.p, add_force(force_of(parent.p), force_to_parent(pose_of(here.X), p)))


@inline
def _add_rotors(bodies: Bodies, xi: Vector, out: Vector) -> None:
    """out += armature ξ, and the terms of motors shared by two joints: the same at both ends of a step, on every joint.

    This matches M a + C v, where an armature multiplies the acceleration only. For a joint that turns its own axes, a
    Lagrangian ½ armature v² would also give the momentum's rate the term ω × p, by the dual of dexp⁻¹.
    """
    for i in range(1, len(bodies)):
        out[i - 1] += bodies[i].armature * xi[i - 1] + of_other(bodies, i, xi)


@inline
def _dual(T: Tangent, side: float, f: Force) -> Force:
    """side Tᵀ f."""
    return Force(
        scale(side, add(unrotate(T.J, f.n), unrotate(T.K, f.f))),
        scale(side, unrotate(T.J, f.f)),
    )


@inline
def _turned(a: Quat, p: Vec) -> Vec:
    """(R(a) - 1) p, accurate for a small rotation."""
    u = Vec(a.x, a.y, a.z)
    s = cross(u, p)
    return scale(2.0, add(scale(a.w, s), cross(u, s)))


@inline
def _carried(X: Pose, a: Quat, d: Vec) -> tuple[Quat, Vec]:
    """A displacement (a, d) of the parent frame, in the frame X: X⁻¹ (a, d) X."""
    u = unrotate(X.R, Vec(a.x, a.y, a.z))
    return Quat(u.x, u.y, u.z, a.w), unrotate(X.R, add(d, _turned(a, X.p)))


@inline
def _put_displacement(here: Record, a: Quat, d: Vec) -> None:
    here.x, here.y, here.z, here.w = a.x, a.y, a.z, a.w
    put_vec(here.d, d)


@inline
def _put_twist(row: Vector, m: Motion) -> None:
    row[0], row[1], row[2] = m.w.x, m.w.y, m.w.z
    row[3], row[4], row[5] = m.v.x, m.v.y, m.v.z


@inline
def _twist(row: Vector) -> Motion:
    return Motion(Vec(row[0], row[1], row[2]), Vec(row[3], row[4], row[5]))


# --- for derivatives ------------------------------------------------------------------------------------


@inline
def momenta_at_both_ends(
    bodies: Bodies, work: Work, q: Config, xi: Vector, tau: Vector, fext: Array, dt: Vector, out: Matrix, q1: Config,
    moved: Matrix, force: Vector, still: Vector,
) -> None:  # fmt: skip
    """p⁻ and p⁺ of a step of ``variational``, under a torque that is constant over the step."""
    h = dt[0]
    still[:] = 0.0
    sum_before(bodies, work, q, xi, moved, out[0])
    momentum_rate(bodies, work, q, still, tau, fext, force)
    for i in range(len(xi)):
        out[0, i] = out[0, i] / h - 0.5 * h * force[i]
    integrate(bodies, q, xi, q1)
    momenta_after(bodies, work, q1, xi, moved, out[1])
    momentum_rate(bodies, work, q1, still, tau, fext, force)
    for i in range(len(xi)):
        out[1, i] = out[1, i] / h + 0.5 * h * force[i]


@inline
def momenta_and_turn(
    bodies: Bodies, work: Work, q: Config, xi: Vector, out: Vector, q1: Config, moved: Matrix
) -> None:  # fmt: skip
    """h J(q)ᵀ μ⁻, h J(q⁺)ᵀ μ⁺, and the least cosine of half the angle by which a body turns."""
    n = len(xi)
    out[2 * n] = sum_before(bodies, work, q, xi, moved, out[:n])
    integrate(bodies, q, xi, q1)
    momenta_after(bodies, work, q1, xi, moved, out[n : 2 * n])


XI = Argument("xi", ("nv",), "rad | m", "displacement of the joints in a step")
H = Argument("dt", (1,), "s", "step")
MOMENTA = Spec(
    "momenta_at_both_ends", momenta_at_both_ends, WORK, (Q, XI, TAU, FEXT_OPTIONAL, H),
    Argument("p", (2, "nv"), "kg m²/s | kg m/s", "momenta before and after the step"),
    "Discrete Legendre transforms.", "see ``recursions.momenta.discrete_momenta``",
    scratch=(("nq",), ("nv+1", 6), ("nv",), ("nv",)), composed=True,
)  # fmt: skip
ENDS = Spec(
    "momenta_and_turn", momenta_and_turn, WORK, (Q, XI),
    Argument("ends", ("nv+nv+1",), "kg m² | kg m", "momenta of a step of unit length, and how far bodies turn"),
    "Momenta of discrete mechanics.", "see ``recursions.momenta.discrete_momenta``",
    scratch=(("nq",), ("nv+1", 6)), composed=True,
)  # fmt: skip

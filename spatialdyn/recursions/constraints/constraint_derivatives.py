"""Derivatives of J a + J̇ v and of Jᵀ λ of a table of constraints, with respect to configuration and velocity.

Seen from frame b, the joints from b to a are a chain, whose row k moves all beyond it by T_k = ±S_k; of a joint's two
bodies one is near, on b's side, and one far. With V and A the spatial velocity and acceleration of bodies seen from b,
about a's origin, and T v the joint's sum over its rows,

    V_far = V_near + T v,    A_far = A_near + T a + V_near × T v

A displacement of joint k and the motion commute if T_k turns with the body λ that the joint stands on, which is near
on a's side and far on b's: the rate of T is V_λ × T, and its second rate A_λ × T + V_λ × (V_λ × T). By these a's pose
R, r in b and its rates u = ṙ, w, u̇, ẇ change by

    δR = z × R    δr = s    δw = ż + z × w    δu = ṡ + z × u    δẇ = z̈ + ż × w + z × ẇ    δu̇ = s̈ + 2 ż × u + z × u̇

with (z, s) = T. All vectors are in b's axes. A derivation of our own.
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import Mat3, Vec, add, cross, dot, identity, neg, rotate, scale, sub, unrotate, zero
from ...algebra.records import mat3_of, motion_of, put_motion, table_dtype, vec_of
from ...algebra.scalars import Scalar, inline, sqrt
from ...algebra.spatial import (
    Force,
    Motion,
    Pose,
    add_force,
    add_motion,
    cross_motion,
    power,
    scale_force,
    scale_motion,
    sub_motion,
    zero_force,
    zero_motion,
)
from ...bodies.constraint_table import ALIGN, DISTANCE, ORIENT, POINT, ROLLING, TERM
from ..signatures import Array, Bodies, Config, Record, Vector, Work
from ..spec import A, Argument, Q, Spec, V
from .constraint_rows import (
    CONSTRAINTS_ARGUMENT,
    Seen,
    half_minus,
    line,
    place_rows,
    seen,
    slope_to_ground,
    to_ground,
    wrench,
)

WORK = table_dtype(
    X=Pose,  # of constraint_rows, as are the fields to o
    R=Mat3,
    o=Vec,
    S=Motion,  # of the rows between the frames of a constraint, as are the fields that follow
    near=Motion,  # V of the joint's near body
    far=Motion,  # V of its far body
)
ON_A, ON_B = 0, 1  # sides of a joint


class At(NamedTuple):
    """Frame a in b: R, r and their rates."""

    R: Mat3
    r: Vec
    u: Vec
    w: Vec
    du: Vec
    dw: Vec


class Change(NamedTuple):
    """Changes of the fields of ``At``; the change of R as a rotation vector."""

    turn: Vec
    r: Vec
    u: Vec
    w: Vec
    du: Vec
    dw: Vec


@inline
def constraint_derivatives(
    bodies: Bodies,
    work: Work,
    q: Config,
    v: Vector,
    a: Vector,
    force: Vector,
    constraints: Record,
    rate: Vector,
    D: Array,
) -> None:
    """∂(J a + J̇ v)/∂q, ∂(J a + J̇ v)/∂v (nc, nv) each and ∂(Jᵀ force)/∂q (nv, nv), one below the other.

    With a rate 1/T, of J a + J̇ v + 2 J v / T + φ / T²; rate may be None.
    """
    D[:] = 0.0
    place_rows(bodies, work, q)
    nc = len(force)
    for m in range(1, len(constraints)):
        c = constraints[m]
        if c.kind == TERM:
            if rate is not None:
                k = c.row_a - 1
                D[nc + c.first, k] = D[nc + c.first, k] + 2.0 * rate * c.factor
                if c.positions == 1:
                    D[c.first, k] = D[c.first, k] + rate * rate * c.factor
        else:
            s = seen(bodies, work, c)
            _write_twists(bodies, work, c, s)
            end = _walk(bodies, work, c, v, a)
            _write_columns(bodies, work, c, s, end, v, a, force, rate, D)


@inline
def _write_twists(bodies: Bodies, work: Work, c: Record, s: Seen) -> None:
    """T of the rows between the frames."""
    i, j = c.row_a, c.row_b
    to_a = rotate(mat3_of(work[i].R), vec_of(c.Xa.p))
    from_b = add(rotate(mat3_of(work[j].R), vec_of(c.Xb.p)), s.r)
    while i != j:
        if i > j:
            put_motion(work[i].S, _twist(bodies, work, i, to_a, s))
            to_a = add(to_a, vec_of(work[i].o))
            i = bodies[i].parent
        else:
            put_motion(work[j].S, scale_motion(-1.0, _twist(bodies, work, j, from_b, s)))
            from_b = add(from_b, vec_of(work[j].o))
            j = bodies[j].parent


@inline
def _twist(bodies: Bodies, work: Work, i: int, arm: Vec, s: Seen) -> Motion:
    """S of row i at the end of an arm from its origin, in b's axes."""
    S, R = motion_of(bodies[i].S), mat3_of(work[i].R)
    w = rotate(R, S.w)
    return Motion(unrotate(s.B, w), unrotate(s.B, add(rotate(R, S.v), cross(w, arm))))


@inline
def _joint_twist(bodies: Bodies, work: Work, i: int, x: Vector) -> Motion:
    """Σ T x over the rows of the joint that starts at row i; zero on its other rows."""
    total = zero_motion()
    for k in range(i, i + bodies[i].dofs):
        total = add_motion(total, scale_motion(x[k - 1], motion_of(work[k].S)))
    return total


@inline
def _walk(bodies: Bodies, work: Work, c: Record, v: Vector, a: Vector) -> tuple[Motion, Motion]:
    """V and A of frame a; near, far and A of the rows between the frames are written."""
    V = zero_motion()
    i, j = c.row_a, c.row_b
    while i != j:
        if i > j:
            V = add_motion(V, scale_motion(v[i - 1], motion_of(work[i].S)))
            i = bodies[i].parent
        else:
            V = add_motion(V, scale_motion(v[j - 1], motion_of(work[j].S)))
            j = bodies[j].parent
    far, near, total = V, zero_motion(), zero_motion()
    i, j = c.row_a, c.row_b
    while i != j:
        if i > j:
            vJ = _joint_twist(bodies, work, i, v)
            put_motion(work[i].far, far)
            far = sub_motion(far, vJ)
            put_motion(work[i].near, far)
            total = add_motion(total, add_motion(_joint_twist(bodies, work, i, a), cross_motion(far, vJ)))
            i = bodies[i].parent
        else:
            vJ = _joint_twist(bodies, work, j, v)
            put_motion(work[j].near, near)
            total = add_motion(total, add_motion(_joint_twist(bodies, work, j, a), cross_motion(near, vJ)))
            near = add_motion(near, vJ)
            put_motion(work[j].far, near)
            j = bodies[j].parent
    return V, total


@inline
def _write_columns(
    bodies: Bodies,
    work: Work,
    c: Record,
    s: Seen,
    end: tuple[Motion, Motion],
    v: Vector,
    a: Vector,
    force: Vector,
    rate: Vector,
    D: Array,
) -> None:
    """The columns of the joints between the frames."""
    V, total = end
    x = At(s.R, unrotate(s.B, s.r), V.v, V.w, add(total.v, cross(V.w, V.v)), total.w)
    F = zero_force()
    for k in range(c.count):
        F = add_force(F, scale_force(force[c.first + k], _in_b(s, wrench(c, s, k))))
    A_far, A_near = total, zero_motion()
    i, j = c.row_a, c.row_b
    while i != j:
        if i > j:
            vJ, near = _joint_twist(bodies, work, i, v), motion_of(work[i].near)
            A_far = sub_motion(A_far, add_motion(_joint_twist(bodies, work, i, a), cross_motion(near, vJ)))
            for k in range(i, i + bodies[i].dofs):
                _write_column(bodies, work, c, s, x, V, F, i, k, ON_A, near, A_far, force, rate, D)
            i = bodies[i].parent
        else:
            vJ, near = _joint_twist(bodies, work, j, v), motion_of(work[j].near)
            A_near = add_motion(A_near, add_motion(_joint_twist(bodies, work, j, a), cross_motion(near, vJ)))
            for k in range(j, j + bodies[j].dofs):
                _write_column(bodies, work, c, s, x, V, F, j, k, ON_B, motion_of(work[j].far), A_near, force, rate, D)
            j = bodies[j].parent


@inline
def _in_b(s: Seen, F: Force) -> Force:
    return Force(unrotate(s.B, F.n), unrotate(s.B, F.f))


@inline
def _write_column(
    bodies: Bodies,
    work: Work,
    c: Record,
    s: Seen,
    x: At,
    V: Motion,
    F: Force,
    first: int,
    k: int,
    side: int,
    Vl: Motion,
    Al: Motion,
    force: Vector,
    rate: Vector,
    D: Array,
) -> None:
    """The column of row k, of the joint that starts at row ``first`` and stands on a body of V and A seen from b."""
    nc = len(force)
    T, near, far = motion_of(work[k].S), motion_of(work[first].near), motion_of(work[first].far)
    dT = cross_motion(Vl, T)
    ddT = add_motion(cross_motion(Al, T), cross_motion(Vl, dT))
    by_q = Change(
        T.w,
        T.v,
        add(dT.v, cross(T.w, x.u)),
        add(dT.w, cross(T.w, x.w)),
        add(ddT.v, add(scale(2.0, cross(dT.w, x.u)), cross(T.w, x.du))),
        add(ddT.w, add(cross(dT.w, x.w), cross(T.w, x.dw))),
    )
    E = add_motion(cross_motion(near, T), cross_motion(T, sub_motion(V, far)))
    by_v = Change(zero(), zero(), T.v, T.w, add(E.v, add(cross(T.w, x.u), cross(x.w, T.v))), E.w)
    for e in range(c.count):
        row = c.first + e
        D[row, k - 1] = _acceleration_change(c, s, x, by_q, e)
        D[nc + row, k - 1] = _acceleration_change(c, s, x, by_v, e)
        if rate is not None:
            J = power(T, _in_b(s, wrench(c, s, e)))
            by_pose = _velocity_change(c, s, x, by_q, e)
            D[row, k - 1] = D[row, k - 1] + 2.0 * rate * by_pose + rate * rate * J * c.positions
            D[nc + row, k - 1] = D[nc + row, k - 1] + 2.0 * rate * J
    dF = _load_change(c, s, x, by_q, force)
    dF = Force(add(dF.n, cross(T.v, F.f)), dF.f)
    i, j = c.row_a, c.row_b
    while i != j:
        if i > j:
            Ti = motion_of(work[i].S)
            change = power(Ti, dF)
            if side == ON_B or first <= i:  # the displacement carries row i
                change = change + power(cross_motion(T, Ti), F)
            D[2 * nc + i - 1, k - 1] = D[2 * nc + i - 1, k - 1] + change
            i = bodies[i].parent
        else:
            Ti = motion_of(work[j].S)
            change = power(Ti, dF)
            if side == ON_B and first > j:
                change = change + power(cross_motion(T, Ti), F)
            D[2 * nc + j - 1, k - 1] = D[2 * nc + j - 1, k - 1] + change
            j = bodies[j].parent


# --- changes of the rows of a constraint -----------------------------------------------------------------


@inline
def _acceleration_change(c: Record, s: Seen, x: At, d: Change, k: int) -> Scalar:
    """The change of equation k of φ̈."""
    D, R = mat3_of(c.D), x.R
    if c.kind == POINT:
        return dot(line(D, k), d.du)
    if c.kind == ORIENT:
        half, E, Rw = _half(R), half_minus(R), rotate(R, x.w)
        total = add(rotate(E, d.dw), _half_minus_change(R, half, d.turn, x.dw))
        total = sub(total, scale(dot(d.w, half) + dot(x.w, rotate(E, d.turn)), x.w))
        total = sub(total, scale(dot(x.w, half), d.w))
        turned = add(cross(d.w, Rw), cross(x.w, add(cross(d.turn, Rw), rotate(R, d.w))))
        return dot(line(identity(), k), sub(total, scale(0.5, turned)))
    if c.kind == ALIGN:
        n = rotate(R, line(D, 2))
        dn, wn = cross(d.turn, n), cross(x.w, n)
        total = add(cross(d.dw, n), cross(x.dw, dn))
        total = add(total, add(cross(d.w, wn), cross(x.w, add(cross(d.w, n), cross(x.w, dn)))))
        return dot(line(D, k), total)
    if c.kind == DISTANCE:
        return (2.0 * dot(x.u, d.u) + dot(d.r, x.du) + dot(x.r, d.du)) / c.value
    axis = rotate(s.A, line(D, 0))
    y, dy = cross(x.w, axis), cross(d.turn, axis)
    rate, change = slope_to_ground(c, s, y), slope_to_ground(c, s, dy)
    bend = add(_bend_to_ground(c, s, y, dy), slope_to_ground(c, s, add(cross(d.w, axis), cross(x.w, dy))))
    total = add(d.du, add(cross(d.dw, to_ground(c, s)), cross(x.dw, change)))
    return dot(line(identity(), k), add(total, add(cross(d.w, rate), cross(x.w, bend))))


@inline
def _velocity_change(c: Record, s: Seen, x: At, d: Change, k: int) -> Scalar:
    """The change of equation k of φ̇."""
    D = mat3_of(c.D)
    if c.kind == POINT:
        return dot(line(D, k), d.u)
    if c.kind == ORIENT:
        change = add(rotate(half_minus(x.R), d.w), _half_minus_change(x.R, _half(x.R), d.turn, x.w))
        return dot(line(identity(), k), change)
    if c.kind == ALIGN:
        n = rotate(x.R, line(D, 2))
        return dot(line(D, k), add(cross(d.w, n), cross(x.w, cross(d.turn, n))))
    if c.kind == DISTANCE:
        return (dot(d.r, x.u) + dot(x.r, d.u)) / c.value
    axis = rotate(s.A, line(D, 0))
    change = slope_to_ground(c, s, cross(d.turn, axis))
    return dot(line(identity(), k), add(d.u, add(cross(d.w, to_ground(c, s)), cross(x.w, change))))


@inline
def _load_change(c: Record, s: Seen, x: At, d: Change, force: Vector) -> Force:
    """The change of the wrench of all equations, at the origin of a and in b's axes."""
    if c.kind == ORIENT:
        f = _forces(c, force)
        turned = scale(0.5, unrotate(x.R, cross(d.turn, f)))
        return Force(sub(turned, scale(dot(d.turn, _half(x.R)), f)), zero())
    if c.kind == ALIGN:
        D = mat3_of(c.D)
        across = add(scale(force[c.first], line(D, 0)), scale(force[c.first + 1], line(D, 1)))
        return Force(cross(cross(d.turn, rotate(x.R, line(D, 2))), across), zero())
    if c.kind == DISTANCE:
        return Force(zero(), scale(force[c.first] / c.value, d.r))
    if c.kind == ROLLING:
        axis = rotate(s.A, line(mat3_of(c.D), 0))
        return Force(cross(slope_to_ground(c, s, cross(d.turn, axis)), _forces(c, force)), zero())
    return zero_force()


@inline
def _forces(c: Record, force: Vector) -> Vec:
    """The forces of three equations."""
    return Vec(force[c.first], force[c.first + 1], force[c.first + 2])


@inline
def _half(R: Mat3) -> Vec:
    """The vector of (R - Rᵀ) / 2."""
    return Vec(0.5 * (R.zy - R.yz), 0.5 * (R.xz - R.zx), 0.5 * (R.yx - R.xy))


@inline
def _half_minus_change(R: Mat3, half: Vec, turn: Vec, y: Vec) -> Vec:
    """The change of E of ``half_minus`` under a turn of R, times y."""
    return sub(scale(-dot(turn, half), y), scale(0.5, cross(turn, rotate(R, y))))


@inline
def _bend_to_ground(c: Record, s: Seen, y: Vec, z: Vec) -> Vec:
    """The second derivative of ``to_ground`` with respect to the axis, along y and z."""
    u, n = rotate(s.A, line(mat3_of(c.D), 0)), line(mat3_of(c.D), 1)
    along, by_y, by_z = dot(n, u), dot(n, y), dot(n, z)
    square = 1.0 - along * along
    up = sub(n, scale(along, u))
    up_y, up_z = neg(add(scale(by_y, u), scale(along, y))), neg(add(scale(by_z, u), scale(along, z)))
    both = neg(add(scale(by_y, z), scale(by_z, y)))
    mixed = scale(along / square, add(scale(by_z, up_y), scale(by_y, up_z)))
    own = scale(by_y * by_z * (1.0 + 3.0 * along * along / square) / square, up)
    return scale(-c.value / sqrt(square), add(both, add(mixed, own)))


DERIVATIVES = Spec(
    "constraint_derivatives", constraint_derivatives, WORK,
    (
        Q, V, A, Argument("force", ("nc",), "N | N m", "of each equation"), CONSTRAINTS_ARGUMENT,
        Argument("rate", (), "1/s", "1/T of the stabilization", optional=True),
    ),
    Argument(
        "D", ("nc+nc+nv", "nv"), "1/s² ...",
        "∂(J a + J̇ v)/∂q along integrate(q, e_k), ∂(J a + J̇ v)/∂v, ∂(Jᵀ force)/∂q, one below the other",
    ),
    "Derivatives of constraints: of J a + J̇ v by q and v, and of Jᵀ force by q.",
    "after Featherstone, RBDA (2008), sections 2.9 and 8.1.",
)  # fmt: skip

"""J(q), φ(q) and the drift J̇ v of a table of constraints (``bodies.constraint_table``).

A constraint on the pose of frame a in frame b has a wrench F for each of its equations, at the origin of a and turning
with b, and J v is F paired with the velocity of a relative to b: F·S for the rows that carry only a, -F·S for the rows
that carry only b. Rows that carry both drop out exactly, also far from the world's origin. With r from the origin of b
to that of a, u the velocity of a's origin seen from b, and w = ω_a - ω_b,

    u = ṙ - ω_b × r,    u̇ = r̈ - α_b × r - ω_b × (ω_b × r) - 2 ω_b × u,    ẇ = α_a - α_b - ω_b × ω_a

are their rates seen from b; all vectors are in world axes.
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import (
    Mat3,
    Vec,
    acceleration_matrix,
    add,
    cross,
    dot,
    identity,
    matmul,
    neg,
    rotate,
    scale,
    sub,
    transpose,
    unrotate,
    zero,
)
from ...algebra.records import mat3_of, motion_of, pose_of, put_mat3, put_vec, table_dtype, vec_of
from ...algebra.scalars import Scalar, inline, inline_or_by_rows, sqrt
from ...algebra.spatial import Force, Pose
from ...bodies.constraint_table import ALIGN, CONSTRAINTS, DISTANCE, ORIENT, POINT, TERM
from ...bodies.joints import place_joint
from ..signatures import Array, Bodies, Config, Matrix, Record, Vector, Work
from ..spec import Argument, Q, Spec, V
from ..tree.rnea import classical_motion, put_world

WORK = table_dtype(
    X=Pose,  # pose of the row in its parent; outward
    R=Mat3,  # its axes in the world; outward
    o=Vec,  # from its parent's origin to its own, in world axes; outward
    w=Vec,  # of rnea, as are the fields that follow
    dw=Vec,
    dv=Vec,
)


class Seen(NamedTuple):
    """Frame a seen from frame b: their axes A and B in the world, R = Bᵀ A, and r from b to a in world axes."""

    A: Mat3
    B: Mat3
    R: Mat3
    r: Vec


class Rates(NamedTuple):
    """Rates of ``Seen``, as the module's docstring defines them: u, u̇, w, ẇ and ω_a, in world axes."""

    u: Vec
    du: Vec
    w: Vec
    dw: Vec
    wa: Vec


@inline_or_by_rows
def place_rows(bodies: Bodies, work: Work, q: Config) -> None:
    """Write X, R and o of every row."""
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
    turn_rows(bodies, work)


@inline
def turn_rows(bodies: Bodies, work: Work) -> None:
    """Write R and o of every row, whose X is written."""
    put_mat3(work[0].R, identity())
    carry_axes(bodies, work)


@inline_or_by_rows
def carry_axes(bodies: Bodies, work: Work) -> None:
    """As ``turn_rows``, in the axes given by R of row 0, whose columns are the world's axes."""
    for i in range(1, len(bodies)):
        R, X = mat3_of(work[bodies[i].parent].R), pose_of(work[i].X)
        put_mat3(work[i].R, matmul(R, X.R))
        put_vec(work[i].o, rotate(R, X.p))


@inline_or_by_rows
def place_bias(bodies: Bodies, work: Work, v: Vector) -> None:
    """Write w, dw and dv of every row at zero joint acceleration, as ``rnea`` does without gravity; X is written."""
    m = put_world(work, zero())
    for i in range(1, len(bodies)):
        m = classical_motion(bodies, work, i, v, None, m)


@inline
def seen(bodies: Bodies, work: Work, c: Record) -> Seen:
    """Frame a seen from frame b, using only the rows that do not carry both."""
    Xa, Xb = pose_of(c.Xa), pose_of(c.Xb)
    Ra, Rb = mat3_of(work[c.row_a].R), mat3_of(work[c.row_b].R)
    r = sub(rotate(Ra, Xa.p), rotate(Rb, Xb.p))
    i, j = c.row_a, c.row_b
    while i != j:
        if i > j:
            r = add(r, vec_of(work[i].o))
            i = bodies[i].parent
        else:
            r = sub(r, vec_of(work[j].o))
            j = bodies[j].parent
    A, B = matmul(Ra, Xa.R), matmul(Rb, Xb.R)
    return Seen(A, B, matmul(transpose(B), A), r)


@inline
def line(A: Mat3, k: int) -> Vec:
    """Row k of a matrix."""
    if k == 0:
        return Vec(A.xx, A.xy, A.xz)
    if k == 1:
        return Vec(A.yx, A.yy, A.yz)
    return Vec(A.zx, A.zy, A.zz)


@inline
def half_minus(R: Mat3) -> Mat3:
    """E = (tr R - R) / 2: with R turning at w, the vector of (R - Rᵀ) / 2 grows by E w."""
    t = R.xx + R.yy + R.zz
    return Mat3(
        0.5 * (t - R.xx), -0.5 * R.xy, -0.5 * R.xz,
        -0.5 * R.yx, 0.5 * (t - R.yy), -0.5 * R.yz,
        -0.5 * R.zx, -0.5 * R.zy, 0.5 * (t - R.zz),
    )  # fmt: skip


@inline
def to_ground(c: Record, s: Seen) -> Vec:
    """From the centre of a wheel, or of a sphere, to its point on the ground: the lowest point of its rim."""
    u, n = rotate(s.A, line(mat3_of(c.D), 0)), line(mat3_of(c.D), 1)
    along = dot(n, u)
    return scale(-c.value / sqrt(1.0 - along * along), sub(n, scale(along, u)))


@inline
def slope_to_ground(c: Record, s: Seen, du: Vec) -> Vec:
    """Rate of ``to_ground`` if the wheel's axis changes at du: the lowest point then moves along the rim."""
    u, n = rotate(s.A, line(mat3_of(c.D), 0)), line(mat3_of(c.D), 1)
    along, rate = dot(n, u), dot(n, du)
    square = 1.0 - along * along
    up = sub(n, scale(along, u))
    dup = neg(add(scale(rate, u), scale(along, du)))
    return scale(-c.value / sqrt(square), add(dup, scale(along * rate / square, up)))


@inline
def rate_to_ground(c: Record, s: Seen, w: Vec) -> Vec:
    """Rate of ``to_ground`` for a body that turns at w."""
    return slope_to_ground(c, s, cross(w, rotate(s.A, line(mat3_of(c.D), 0))))


@inline
def wrench(c: Record, s: Seen, k: int) -> Force:
    """F of equation k of a row, at the origin of a, in world axes."""
    D = mat3_of(c.D)
    if c.kind == POINT:
        return Force(zero(), rotate(s.B, line(D, k)))
    if c.kind == ORIENT:
        return Force(rotate(s.B, line(half_minus(s.R), k)), zero())
    if c.kind == ALIGN:
        return Force(rotate(s.B, cross(rotate(s.R, line(D, 2)), line(D, k))), zero())
    if c.kind == DISTANCE:
        return Force(zero(), scale(1.0 / c.value, s.r))
    e = line(identity(), k)
    return Force(cross(to_ground(c, s), e), e)


@inline_or_by_rows
def write_jacobian(bodies: Bodies, work: Work, constraints: Record, J: Matrix) -> None:
    """J (nc, nv), from R and o of every row."""
    for k in range(len(J)):
        for i in range(len(bodies) - 1):
            J[k, i] = 0.0
    for m in range(1, len(constraints)):
        c = constraints[m]
        if c.kind == TERM:
            J[c.first, c.row_a - 1] = J[c.first, c.row_a - 1] + c.factor
        else:
            s = seen(bodies, work, c)
            for k in range(c.count):
                F = wrench(c, s, k)
                i, j = c.row_a, c.row_b
                to_a = rotate(mat3_of(work[i].R), vec_of(c.Xa.p))  # from the origin of row i to that of a
                from_b = add(rotate(mat3_of(work[j].R), vec_of(c.Xb.p)), s.r)
                while i != j:
                    if i > j:
                        J[c.first + k, i - 1] = pair(F, bodies, work, i, to_a)
                        to_a = add(to_a, vec_of(work[i].o))
                        i = bodies[i].parent
                    else:
                        J[c.first + k, j - 1] = -pair(F, bodies, work, j, from_b)
                        from_b = add(from_b, vec_of(work[j].o))
                        j = bodies[j].parent


@inline
def pair(F: Force, bodies: Bodies, work: Work, i: int, arm: Vec) -> Scalar:
    """F·S of row i; arm leads from its origin to the point where F acts."""
    S, R = motion_of(bodies[i].S), mat3_of(work[i].R)
    w = rotate(R, S.w)
    return dot(F.n, w) + dot(F.f, add(rotate(R, S.v), cross(w, arm)))


@inline_or_by_rows
def write_error(bodies: Bodies, work: Work, constraints: Record, q: Config, phi: Vector) -> None:
    """φ (nc), 0 for equations of velocities, from R and o of every row."""
    for m in range(1, len(constraints)):
        c = constraints[m]
        for k in range(c.count):
            phi[c.first + k] = 0.0
        if c.kind == TERM:
            if c.positions == 1:
                phi[c.first] = phi[c.first] + (c.factor * q[c.q_index] + c.value)
        elif c.positions == 1:
            s, D = seen(bodies, work, c), mat3_of(c.D)
            for k in range(c.count):
                if c.kind == POINT:
                    phi[c.first + k] = dot(line(D, k), unrotate(s.B, s.r))
                elif c.kind == ORIENT:
                    R = s.R
                    half = Vec(0.5 * (R.zy - R.yz), 0.5 * (R.xz - R.zx), 0.5 * (R.yx - R.xy))
                    phi[c.first + k] = dot(line(identity(), k), half)
                elif c.kind == ALIGN:
                    phi[c.first + k] = dot(line(D, k), rotate(s.R, line(D, 2)))
                else:
                    phi[c.first + k] = 0.5 * (dot(s.r, s.r) / c.value - c.value)


@inline
def point_acceleration(here: Record, X: Record) -> Vec:
    """Acceleration of the origin of a frame at pose X in a body, in the body's axes, less gravity."""
    U = acceleration_matrix(vec_of(here.w), vec_of(here.dw))
    return add(vec_of(here.dv), rotate(U, vec_of(X.p)))


@inline
def rates(bodies: Bodies, work: Work, c: Record, s: Seen, v: Vector) -> Rates:
    """Rates of frame a seen from b at zero joint acceleration, from R, o, w, dw and dv of every row."""
    Ra, Rb = mat3_of(work[c.row_a].R), mat3_of(work[c.row_b].R)
    wa, wb = rotate(Ra, vec_of(work[c.row_a].w)), rotate(Rb, vec_of(work[c.row_b].w))
    aa, ab = rotate(Ra, vec_of(work[c.row_a].dw)), rotate(Rb, vec_of(work[c.row_b].dw))
    pa, pb = rotate(Ra, vec_of(c.Xa.p)), rotate(Rb, vec_of(c.Xb.p))
    at_a, at_b = (
        rotate(Ra, point_acceleration(work[c.row_a], c.Xa)),
        rotate(Rb, point_acceleration(work[c.row_b], c.Xb)),
    )
    u, to_a, from_b, i, j = zero(), pa, add(pb, s.r), c.row_a, c.row_b
    while i != j:
        if i > j:
            S, R = motion_of(bodies[i].S), mat3_of(work[i].R)
            u = add(u, scale(v[i - 1], add(rotate(R, S.v), cross(rotate(R, S.w), to_a))))
            to_a = add(to_a, vec_of(work[i].o))
            i = bodies[i].parent
        else:
            S, R = motion_of(bodies[j].S), mat3_of(work[j].R)
            u = sub(u, scale(v[j - 1], add(rotate(R, S.v), cross(rotate(R, S.w), from_b))))
            from_b = add(from_b, vec_of(work[j].o))
            j = bodies[j].parent
    du = sub(sub(at_a, at_b), add(cross(ab, s.r), cross(wb, add(cross(wb, s.r), scale(2.0, u)))))
    return Rates(u, du, sub(wa, wb), sub(sub(aa, ab), cross(wb, wa)), wa)


@inline_or_by_rows
def write_drift(bodies: Bodies, work: Work, constraints: Record, v: Vector, gamma: Vector) -> None:
    """J̇ v (nc): the second derivative of φ at zero joint acceleration."""
    for m in range(1, len(constraints)):
        c = constraints[m]
        if c.kind == TERM:
            if c.count == 1:
                gamma[c.first] = 0.0
        else:
            s, D = seen(bodies, work, c), mat3_of(c.D)
            x = rates(bodies, work, c, s, v)
            w, dw, B = unrotate(s.B, x.w), unrotate(s.B, x.dw), s.B
            for k in range(c.count):
                if c.kind == POINT:
                    gamma[c.first + k] = dot(line(D, k), unrotate(B, x.du))
                elif c.kind == ORIENT:
                    gamma[c.first + k] = dot(line(identity(), k), turning(s.R, w, dw))
                elif c.kind == ALIGN:
                    z, e = rotate(s.R, line(D, 2)), line(D, k)
                    gamma[c.first + k] = dot(dw, cross(z, e)) + dot(e, cross(w, cross(w, z)))
                elif c.kind == DISTANCE:
                    gamma[c.first + k] = (dot(x.u, x.u) + dot(s.r, x.du)) / c.value
                else:
                    to, rate = to_ground(c, s), rate_to_ground(c, s, x.wa)
                    gamma[c.first + k] = dot(line(identity(), k), add(x.du, add(cross(x.dw, to), cross(x.wa, rate))))


@inline
def turning(R: Mat3, w: Vec, dw: Vec) -> Vec:
    """E ẇ + Ė w with E of ``half_minus``: from Ṙ = w~ R follows tr Ṙ = -2 w·φ, φ the vector of (R - Rᵀ) / 2."""
    half = Vec(0.5 * (R.zy - R.yz), 0.5 * (R.xz - R.zx), 0.5 * (R.yx - R.xy))
    rate = add(scale(-dot(w, half), w), scale(-0.5, cross(w, rotate(R, w))))
    return add(rotate(half_minus(R), dw), rate)


@inline
def constraint_jacobian(bodies: Bodies, work: Work, q: Config, constraints: Record, J: Matrix) -> None:
    """J (nc, nv)."""
    place_rows(bodies, work, q)
    write_jacobian(bodies, work, constraints, J)


@inline
def constraint_error(bodies: Bodies, work: Work, q: Config, constraints: Record, phi: Vector) -> None:
    """φ (nc)."""
    place_rows(bodies, work, q)
    write_error(bodies, work, constraints, q, phi)


@inline
def constraint_drift(bodies: Bodies, work: Work, q: Config, v: Vector, constraints: Record, gamma: Array) -> None:
    """J̇ v (nc)."""
    place_rows(bodies, work, q)
    place_bias(bodies, work, v)
    write_drift(bodies, work, constraints, v, gamma)


CONSTRAINTS_ARGUMENT = Argument("constraints", (), "", "what is held", static=True, table=CONSTRAINTS, sizes=("nc",))
_SOURCE = "after Featherstone, RBDA (2008), sections 3.2 and 8.1."
JACOBIAN = Spec(
    "constraint_jacobian", constraint_jacobian, WORK, (Q, CONSTRAINTS_ARGUMENT),
    Argument("J", ("nc", "nv"), "m/rad | 1", "a row for each equation"),
    "Jacobian J(q) of constraints: φ̇ = J v.", _SOURCE,
)  # fmt: skip
ERROR = Spec(
    "constraint_error", constraint_error, WORK, (Q, CONSTRAINTS_ARGUMENT),
    Argument("phi", ("nc",), "m | rad", "0 where a constraint is met, and for equations of velocities"),
    "Errors φ(q) of constraints, 0 where they are met.", _SOURCE,
)  # fmt: skip
DRIFT = Spec(
    "constraint_drift", constraint_drift, WORK, (Q, V, CONSTRAINTS_ARGUMENT),
    Argument("gamma", ("nc",), "m/s² | rad/s²", "J̇ v: J a + gamma is φ̈"),
    "J̇ v of constraints, the φ̈ at zero joint acceleration.", _SOURCE,
)  # fmt: skip

"""The points and joints on which impulses act: gaps, rows of J, and the terms of their laws.

Rows 3 p to 3 p + 2 of J are those of point p, its normal first, then two along the ground; row 3 np + l is that of
joint l, with limits. With M = LᵀD L, Y = J L⁻¹, Z = Y D⁻¹ and w = L (v⁺ - v): G = J M⁻¹ Jᵀ = Y Zᵀ, and u = J v + Y w.
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import Vec, add, cross, rotate, sub
from ...algebra.heights import bilinear
from ...algebra.records import mat3_of, motion_of, put_mat3, vec_of
from ...algebra.scalars import Scalar, inline, inline_or_by_rows, select, sqrt
from ...bodies.contact_table import CONTACTS, HEIGHTS
from ..constraints.constraint_rows import carry_axes
from ..constraints.dense import add_product
from ..signatures import Array, Bodies, Config, Matrix, Number, Record, Vector, Work
from ..spec import Argument


class Contact(NamedTuple):
    """Points and joints that may touch, the ground and the coefficients of contact."""

    contacts: Record  # the table of points and joints
    heights: Record  # of the ground; None: a plane
    mu: Vector  # (np)
    restitution: Vector  # (np); None: no point bounces
    start: Vector = None  # (rows) λ to begin with; None: 0


RISE = 0.2  # share of its depth by which a point in the ground rises in a step
SLOWEST = 1e-2  # [s] shortest time of that rise: in ever shorter steps the point would be thrown out
BOUNCING = 1e-2  # [m/s] speed of approach from which a point bounces; a slower point comes to rest, unless its speed
PRESSED = 10.0  # is above PRESSED times the velocity that forces add in the step
REST = 1e-5  # [m/s] and above REST


@inline
def place_points(bodies: Bodies, work: Work, contacts: Record, heights: Record, gap: Vector, T: Array) -> None:
    """R and o of every row in the ground's axes, whose X is written; then as ``write_gaps``."""
    put_mat3(work[0].R, mat3_of(contacts[0].axes))
    carry_axes(bodies, work)
    write_gaps(bodies, work, contacts, heights, gap, T)


@inline_or_by_rows
def write_gaps(bodies: Bodies, work: Work, contacts: Record, heights: Record, gap: Vector, T: Array) -> None:
    """gap (np), from R and o of every row; over heights T is written too.

    The heights are those of a sphere's centre when it touches the ground, so their slope is the ground's at the point
    of contact.
    """
    for p in range(contacts[0].np):
        c = contacts[1 + p]
        i = c.row
        at = rotate(mat3_of(work[i].R), vec_of(c.p))
        while i > 0:
            at = add(at, vec_of(work[i].o))
            i = bodies[i].parent
        if heights is None:
            gap[p] = at.x - (contacts[0].height + c.radius)
        else:
            each = 1.0 / heights[0].spacing
            x, y = (at.y - heights[0].x) * each, (at.z - heights[0].y) * each
            level, along, across = bilinear(x, y, heights, c.heights)
            slope_axes(along * each, across * each, T[p])
            gap[p] = (at.x - level) * T[p, 0, 0]


@inline
def slope_axes(along: Scalar, across: Scalar, T: Matrix) -> None:
    """T (3, 3), rows in the axes (z, x, y): the normal of a slope, its direction along x, the direction across both."""
    steep = 1.0 + along * along
    a, n = 1.0 / sqrt(steep), 1.0 / sqrt(steep + across * across)
    T[0, 0], T[0, 1], T[0, 2] = n, -along * n, -across * n
    T[1, 0], T[1, 1], T[1, 2] = along * a, a, 0.0
    T[2, 0], T[2, 1], T[2, 2] = across * n * a, -along * across * n * a, steep * n * a


@inline
def untilted(T: Matrix, f: Vec) -> Vec:
    """Tᵀ f."""
    return Vec(
        T[0, 0] * f.x + T[1, 0] * f.y + T[2, 0] * f.z,
        T[0, 1] * f.x + T[1, 1] * f.y + T[2, 1] * f.z,
        T[0, 2] * f.x + T[1, 2] * f.y + T[2, 2] * f.z,
    )


@inline
def write_rows(bodies: Bodies, work: Work, contacts: Record, heights: Record, T: Array, J: Matrix) -> None:
    """J (3 np + nl, nv) of the lowest points, in the ground's axes, then of joints; from R and o of every row."""
    points = contacts[0].np
    write_point_rows(bodies, work, contacts, heights, T, J)
    for l in range(contacts[0].nl + contacts[0].nd):
        J[3 * points + l, contacts[1 + points + l].row - 1] = 1.0


@inline_or_by_rows
def write_point_rows(bodies: Bodies, work: Work, contacts: Record, heights: Record, T: Array, J: Matrix) -> None:
    """The rows of points, as of ``write_rows``; those of joints are 0."""
    for k in range(len(J)):
        for i in range(len(bodies) - 1):
            J[k, i] = 0.0
    for p in range(contacts[0].np):
        c = contacts[1 + p]
        i = c.row
        to = rotate(mat3_of(work[i].R), vec_of(c.p))  # from row i's origin
        if heights is None:
            to = sub(to, Vec(c.radius, 0.0, 0.0))
        else:
            to = sub(to, Vec(c.radius * T[p, 0, 0], c.radius * T[p, 0, 1], c.radius * T[p, 0, 2]))
        while i > 0:
            S, R = motion_of(bodies[i].S), mat3_of(work[i].R)
            u = add(rotate(R, S.v), cross(rotate(R, S.w), to))
            if heights is not None:
                u = times(T[p], u)
            J[3 * p, i - 1], J[3 * p + 1, i - 1], J[3 * p + 2, i - 1] = u.x, u.y, u.z
            to = add(to, vec_of(work[i].o))
            i = bodies[i].parent


# --- the law --------------------------------------------------------------------------------------------


@inline
def rising(depth: Scalar, dt: Number) -> Scalar:
    """The velocity at which a point in the ground, or a joint beyond a limit, returns; ``depth`` is negative."""
    within = (1.0 / RISE) * dt
    return depth * (1.0 / select(within - SLOWEST, within, SLOWEST))


@inline
def target(gap: Scalar, before: Scalar, free: Scalar, dt: Number, restitution: Number) -> tuple[Scalar, Scalar]:
    """c of a point's normal, and its restitution if it bounces, else 0. u_n + c is 0 for a point that just reaches the
    ground, rises out of it, or comes to rest before it bounces.

    A point bounces if it would reach the ground within the step fast enough, or if it leaves the ground as fast and
    another point's impact throws it down; forces alone throw down only a point at rest. Fast is relative to the
    velocity that forces add in the step, so that all points of a body without load bounce.

    before, free  velocities along the normal before the step, and after it without impulses
    """
    pressed = PRESSED * (before - free)
    fast = select(pressed - REST, select(pressed - BOUNCING, BOUNCING, pressed), REST)
    open_ = gap * (1.0 / dt)
    reaches = select(-(open_ + free), select(-before - fast, 1.0, 0.0), 0.0)
    c = select(restitution * reaches, 0.0, select(gap, open_, rising(gap, dt)))
    return c, restitution * select(before - fast, 1.0, reaches)


@inline
def velocity(Y: Matrix, b: Vector, w: Vector, k: int) -> Scalar:
    """b_k + Y_k w."""
    return add_product(b[k], Y, w, k)


@inline
def velocity_of_point(Y: Matrix, b: Vector, w: Vector, p: int) -> Vec:
    """The three velocities of a point."""
    return Vec(velocity(Y, b, w, 3 * p), velocity(Y, b, w, 3 * p + 1), velocity(Y, b, w, 3 * p + 2))


@inline
def force_of_point(force: Vector, p: int) -> Vec:
    """The three impulses of a point."""
    return Vec(force[3 * p], force[3 * p + 1], force[3 * p + 2])


@inline
def work_of_row(Y: Matrix, before: Vector, w: Vector, k: int, impulse: Scalar) -> Scalar:
    """½ λ (u⁻ + u⁺) of a row's velocities before and after a step."""
    return 0.5 * impulse * (before[k] + velocity(Y, before, w, k))


@inline
def push(Z: Matrix, k: int, change: Scalar, w: Vector) -> None:
    """Add to w the effect D⁻¹ Y_kᵀ of a change of λ_k."""
    for i in range(len(w)):
        w[i] = w[i] + Z[k, i] * change


@inline
def times(B: Matrix, f: Vec) -> Vec:
    """B (3, 3) times a vector."""
    return Vec(
        B[0, 0] * f.x + B[0, 1] * f.y + B[0, 2] * f.z,
        B[1, 0] * f.x + B[1, 1] * f.y + B[1, 2] * f.z,
        B[2, 0] * f.x + B[2, 1] * f.y + B[2, 2] * f.z,
    )


@inline
def allowed(c: Record, q: Config, dt: Number) -> tuple[Scalar, Scalar]:
    """The least and the largest velocity at which a joint stays within its limits in the step."""
    above, below = q[c.q_index] - c.lower, c.upper - q[c.q_index]
    each = 1.0 / dt
    return -select(above, above * each, rising(above, dt)), select(below, below * each, rising(below, dt))


@inline
def product(Y: Matrix, Z: Matrix, k: int, l: int) -> Scalar:
    """G_kl."""
    s = 0.0
    for i in range(Y.shape[1]):
        s = s + Y[k, i] * Z[l, i]
    return s


@inline
def write_block(Y: Matrix, Z: Matrix, p: int, B: Matrix) -> None:
    """B (3, 3), a point's own block of G."""
    for i in range(3):
        for j in range(i + 1):
            s = product(Y, Z, 3 * p + i, 3 * p + j)
            B[i, j] = s
            B[j, i] = s


CONTACTS_ARGUMENT = Argument(
    "contacts", (), "", "what may touch", static=True, table=CONTACTS, sizes=("np", "nl", "nd")
)
HEIGHTS_ARGUMENT = Argument("heights", (), "", "of the ground", static=True, table=HEIGHTS)
MU = Argument("mu", ("np",), "1", "coefficient of friction of each point")
RESTITUTION = Argument("restitution", ("np",), "1", "of each point, from 0 to 1")
IMPULSE = Argument("impulse", ("np+np+np",), "N s", "on each point, in the world's axes")
GAP = Argument("gap", ("np",), "m", "distance from the ground before the step, negative in it")
STOP = Argument("stop", ("nl",), "N m s | N s", "on each joint with limits, positive from the lower one")
ENERGY = Argument("energy", ("np+nl",), "J", "work of the impulses of each point and joint")

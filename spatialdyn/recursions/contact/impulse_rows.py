"""The rows of a step's impulses: their responses, the law of each point and joint, and sweeps over them.

The rows are those of ``contact_rows``; with w0 the w without impulses, w = w0 + Zᵀ λ and u = b + Y w.

In a sweep (Gauss-Seidel) each point and joint in turn gets the impulse that solves its own law for the other impulses.

Source: the law as in ``contact``.
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import Vec, sub
from ...algebra.scalars import EPS, Scalar, inline, select, sqrt
from ..constraints.constrained import DEPENDENT
from ..constraints.dense import add_product
from ..joints.friction import magnitude
from ..signatures import Array, Bodies, Config, Matrix, Number, Vector, Work
from ..tree.ltdl import solve_inward
from .contact_rows import (
    Contact,
    allowed,
    force_of_point,
    place_points,
    product,
    push,
    target,
    times,
    velocity,
    velocity_of_point,
    write_block,
    write_rows,
)
from .coulomb_cone import factor_block, largest_eigenvalue, point_impulse, squared_residual

ROWS = "np+np+np+nl+nd"
RES, LEAST, ROUND, EPSILON, COUNT, PHASE, CAREFUL, GRIP, JAMS, SHARE, STOPS = range(11)  # of ``state``
HEAVY = 1e-4  # times a row's response and the largest inertia: above 1, the row's proximal term shrinks


class Impulses(NamedTuple):
    """Scratch of rows, their impulses and the solver."""

    L: Matrix = ("nv", "nv")  # M, then its factors, D on the diagonal
    M: Matrix = ("nv", "nv")  # both triangles
    J: Matrix = (ROWS, "nv")
    Y: Matrix = (ROWS, "nv")  # J, then J L⁻¹
    Z: Matrix = (ROWS, "nv")  # Y D⁻¹, less what constraints take
    b: Vector = (ROWS,)  # velocities J v, with a point's target c
    before: Vector = (ROWS,)  # velocities at the beginning
    force: Vector = (ROWS,)  # λ
    total: Vector = (ROWS,)  # of all phases
    best: Vector = (ROWS,)  # λ of the least residual
    f: Vector = (ROWS,)  # of Newton's step
    first: Vector = (ROWS,)  # sum of the phases before, while λ is of the last phase; else 0
    own: Vector = (ROWS,)  # a row's own response; of joints
    each: Vector = ("nl+nd",)  # inverse of own, 0 for a joint that no impulse moves
    least: Vector = ("nl",)  # least velocities at which joints stay within their limits in the step
    most: Vector = ("nl",)
    wide: Vector = ("np",)  # the largest response of a point across its normal
    size: Vector = (ROWS,)  # the same without constraints; also of points
    slopes: Array = ("np", 3, 3)  # the axes of the ground at each point, see ``slope_axes``
    B: Array = ("np", 3, 3)  # each point's own block of G
    factors: Array = ("np", 5, 3)  # of B, and scratch of solving
    C: Array = ("np", 3, 3)  # of Newton's step
    bounces: Vector = ("np",)  # e of a point that bounces, else 0
    lower: Vector = ("np",)  # the least λ_n: e λ_c in the phase after λ_c, else 0
    next: Vector = ("np",)  # the least λ_n of the next phase
    load: Vector = ("np",)  # the part of λ_c that only holds the point against the forces of the step
    firm: Vector = ("np+nl+nd",)  # divides ε: large for points and joints that are light beside their load
    level: Vector = ("nl+nd",)  # h F(v) of each joint
    rests: Vector = ("nl+nd",)  # 1 of a joint at rest after the step, else 0
    held: Vector = ("nl+nd",)  # 1 of a joint that Newton's step takes to stick or stop
    goal: Vector = ("nl+nd",)  # velocity of a held joint, impulse of another
    off: Vector = ("nl+nd",)  # residuals of joints
    free: Vector = ("nv",)  # w without impulses
    x: Vector = ("nv",)  # change of v
    begun: Vector = ("nv",)  # change of v in the step not due to forces, of ``add_begun``
    K: Matrix = ("nv", "nv")
    T: Matrix = (3, 3)  # derivative of a point's impulse
    N: Matrix = (3, 3)
    CJ: Matrix = (3, "nv")
    root: Vector = (4,)  # of ``find_root``
    state: Vector = (11,)  # residual, the least so far, round, ε, count, phases done, what differs in rounds
    left: Vector = (1,)  # of loops: residuals less the tolerance
    sweeping: Vector = (1,)
    stepping: Vector = (1,)
    thrown: Vector = (1,)  # above 0 of a step that is taken back
    phase: Vector = (1,)  # above 0 before a phase
    disc: Vector = (5,)  # of ``disc_impulse``
    solved: Vector = (5,)  # of ``point_impulse``
    share: Vector = (1,)  # of ``squared_residual``


class JointState(NamedTuple):
    """Velocities of a joint, and which part of its law holds."""

    u: Scalar  # with its impulse
    free: Scalar  # without
    wanted: Scalar  # by its law
    rests: Scalar  # 1 if it rests, else 0
    stays: Scalar  # 1 if friction or a limit holds it, else 0


@inline
def write_responses(
    bodies: Bodies, work: Work, contact: Contact, v: Vector, gap: Vector, s: Impulses
) -> None:  # fmt: skip
    """Gaps, and of the rows velocities without impulses, Y, Z and size; from the places that ``crba`` leaves."""
    n = len(bodies) - 1
    place_points(bodies, work, contact.contacts, contact.heights, gap, s.slopes)
    write_rows(bodies, work, contact.contacts, contact.heights, s.slopes, s.Y)
    for k in range(len(s.b)):
        s.b[k] = add_product(0.0, s.Y, v, k)
        s.before[k] = s.b[k]
        for i in range(n):
            s.J[k, i] = s.Y[k, i]
        solve_inward(bodies, s.L, s.Y[k])
        for i in range(n):
            s.Z[k, i] = s.Y[k, i] * (1.0 / s.L[i, i])
        s.size[k] = product(s.Y, s.Z, k, k)


@inline
def keep_inertia(s: Impulses) -> None:
    """M of the step, before it is factored."""
    for i in range(len(s.M)):
        for j in range(i + 1):
            s.M[i, j], s.M[j, i] = s.L[i, j], s.L[i, j]


@inline
def open_laws(
    q: Config, dt: Number, contact: Contact, gap: Vector, w: Vector, s: Impulses
) -> None:  # fmt: skip
    """Write the data that stay the same in all sweeps: blocks of G, their factors, targets in b; w0 in ``free``."""
    n, points, heaviest = len(w), contact.contacts[0].np, 0.0
    for i in range(n):
        s.free[i] = w[i]
        heaviest = select(s.L[i, i] - heaviest, s.L[i, i], heaviest)
    for p in range(points):
        k = 3 * p
        write_block(s.Y, s.Z, p, s.B[p])
        factor_block(s.B[p], s.size[k] + s.size[k + 1] + s.size[k + 2], n, s.factors[p])
        s.wide[p] = largest_eigenvalue(s.B[p])
        s.firm[p] = stiffness(s.size[k] * heaviest)
        free = velocity(s.Y, s.b, w, k)
        load = select(s.b[k] - free, s.b[k] - free, 0.0)
        s.load[p] = load * s.factors[p, 0, 0]
        s.lower[p] = 0.0
        c, s.bounces[p] = target(gap[p], s.b[k], free, dt, entry(contact.restitution, p))
        s.b[k] = s.b[k] + c
    for j in range(len(s.level)):
        k = 3 * points + j
        s.own[k] = product(s.Y, s.Z, k, k)
        s.each[j] = inverse(s.own[k], s.size[k], n)
        s.firm[points + j] = stiffness(s.own[k] * heaviest)
        if j < len(s.least):
            s.least[j], s.most[j] = allowed(contact.contacts[1 + points + j], q, dt)
        s.held[j], s.goal[j], s.rests[j] = 0.0, 0.0, 0.0


@inline
def entry(x: Vector, k: int) -> Scalar:
    """x_k; 0 if x is None."""
    return 0.0 if x is None else x[k]


@inline
def stiffness(ratio: Scalar) -> Scalar:
    """The factor by which ε of a row is smaller, from the row's response times the largest inertia.

    ε is relative to a row's own response. Without this factor, a joint that holds a trunk 1e5 times as heavy as a leg
    would yield in every step by far more than the weight.
    """
    heavy = HEAVY * ratio
    return select(heavy - 1.0, heavy, 1.0)


@inline
def respond(w: Vector, s: Impulses) -> None:
    """W = w0 + Zᵀ λ."""
    for i in range(len(w)):
        w[i] = s.free[i]
    for k in range(len(s.force)):
        push(s.Z, k, s.force[k], w)


@inline
def sweep(contact: Contact, held: bool, w: Vector, s: Impulses) -> None:
    """New impulses of each point and joint in turn, and w with them."""
    sweep_points(contact, held, w, s)
    sweep_joints(w, s)


@inline
def sweep_joints(w: Vector, s: Impulses) -> None:
    """Those of joints."""
    for j in range(len(s.level)):
        k, x = 3 * len(s.lower) + j, joint_state(j, w, s)
        was = s.force[k]
        s.force[k] = (x.wanted - x.free) * s.each[j] - s.first[k]
        push(s.Z, k, s.force[k] - was, w)


@inline
def sweep_points(contact: Contact, held: bool, w: Vector, s: Impulses) -> None:
    """Those of points."""
    for p in range(len(s.lower)):
        now, _, solved, _, _ = solve_point(p, contact.mu[p], held, w, s)
        k = 3 * p
        s.force[k], s.force[k + 1], s.force[k + 2] = solved.x, solved.y, solved.z
        push(s.Z, k, solved.x - now.x, w)
        push(s.Z, k + 1, solved.y - now.y, w)
        push(s.Z, k + 2, solved.z - now.z, w)


@inline
def solve_point(
    p: int, mu: Number, held: bool, w: Vector, s: Impulses
) -> tuple[Vec, Vec, Vec, Scalar, Scalar]:  # fmt: skip
    """λ of a point, its velocity without that, and what ``point_impulse`` returns for it."""
    now = force_of_point(s.force, p)
    r = sub(velocity_of_point(s.Y, s.b, w, p), times(s.B[p], now))
    solved, sticks, slides = point_impulse(
        s.B[p], s.factors[p], r, mu, s.lower[p], s.root, s.disc, s.solved, held
    )  # fmt: skip
    return now, r, solved, sticks, slides


@inline
def residual(contact: Contact, w: Vector, s: Impulses) -> Scalar:
    """The largest residual of all rows; those of joints are written to ``off``."""
    of_points, of_joints = residual_of_points(contact, w, s), residual_of_joints(w, s)
    return select(of_joints - of_points, of_joints, of_points)


@inline
def residual_of_points(contact: Contact, w: Vector, s: Impulses) -> Scalar:
    """The largest residual of points."""
    worst = 0.0
    for p in range(len(s.lower)):
        x = square_of_point(p, contact.mu[p], w, s)
        worst = select(x - worst, x, worst)
    return sqrt(worst)


@inline
def square_of_point(p: int, mu: Number, w: Vector, s: Impulses) -> Scalar:
    """The square of a point's residual."""
    u, f = velocity_of_point(s.Y, s.b, w, p), force_of_point(s.force, p)
    return squared_residual(s.B[p, 0, 0], s.wide[p], u, mu, f, s.lower[p], s.share)


@inline
def residual_of_joints(w: Vector, s: Impulses) -> Scalar:
    """The largest of joints; all are written in ``off``."""
    worst = 0.0
    for j in range(len(s.level)):
        x = joint_state(j, w, s)
        s.off[j] = magnitude(x.u - x.wanted)
        worst = select(s.off[j] - worst, s.off[j], worst)
    return worst


@inline
def beyond_limits(w: Vector, s: Impulses) -> Scalar:
    """The largest residual of joints without impulses and friction: by how much one passes a limit; 0 if none does."""
    worst = 0.0
    for j in range(len(s.least)):
        u = velocity(s.Y, s.b, w, 3 * len(s.lower) + j)
        low, high = s.least[j] - u, u - s.most[j]
        worst = select(low - worst, low, worst)
        worst = select(high - worst, high, worst)
    return worst


@inline
def inverse(x: Scalar, size: Scalar, n: int) -> Scalar:
    """1 / x of a row's own response x, 0 for a row that no impulse moves."""
    moves = x - (DEPENDENT * n) * EPS * size
    return select(moves, 1.0 / select(moves, x, 1.0), 0.0)


@inline
def joint_state(j: int, w: Vector, s: Impulses) -> JointState:
    """The JointState of a joint, which dry friction slows by at most ``level``."""
    k = 3 * len(s.lower) + j
    u, level = velocity(s.Y, s.b, w, k), s.own[k] * s.level[j]
    free = u - s.own[k] * (s.first[k] + s.force[k])
    moved = select(free - level, free - level, select(-free - level, free + level, 0.0))
    sticks = select(level - magnitude(free), 1.0, 0.0)  # 0 of NaN
    if j >= len(s.least):  # no limits
        return JointState(u, free, moved, sticks, sticks)
    low, high = s.least[j] - moved, moved - s.most[j]
    kept = select(low, s.least[j], select(high, s.most[j], moved))
    stops = select(low, 1.0, select(high, 1.0, sticks))
    return JointState(u, free, kept, select(low, 0.0, select(high, 0.0, sticks)), stops)

"""The impulses of a step: what solves the laws of points in contact, of limits and of dry joints together.

Rows and their meaning are those of ``contact_rows``; with w0 = w without impulses, w = w0 + Zᵀ λ and u = b + Y w.

First sweeps (Gauss-Seidel), in which each point and joint in turn gets the impulse that solves its own law under the
others' impulses: feet that stand on rigid legs need 3 or 4. Where joints rub dry, or more points touch than can be told
apart, sweeps alone may take thousands. Newton's method then solves λ = T(u - B λ) for all rows, T the local solutions,
with a proximal term ε that vanishes as the residual falls:

    (1 + ε) δ_p = T - λ_p + T' (δu_p - B_p δ_p)    ⇒    δ_p = f_p - C_p δu_p,

so that (D + Σ Y_pᵀ C_p Y_p) δw = Σ Y_pᵀ f_p, which has the zeros of the tree: a dry joint costs what its rows cost, and
a joint that sticks or stops is one with C = 1 / (ε G_jj). Steps are all taken, and the best λ kept; where 12 of them do
not end, sweeps from there and 12 more follow. After 4 steps, of the joints only those change their state that miss
their law most, which ends cycles.

Points that bounce do so in a second phase (Poisson): the first brings them to rest, with impulses λ_c, and the second
adds Λ_n of at least e λ_c, complementary to u_n, with friction of its own within μ Λ_n. Work is lost in each hit then;
Newton's law, u_n = -e u_n of before, gains some with friction. What of λ_c only answers to forces is not given back.

Source: Pfeiffer, Glocker, Multibody dynamics with unilateral contacts (1996), for Poisson's law; the law as in
``contact``; its solution is a derivation of our own, semi-smooth as by Alart and Curnier (1991).
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import Vec, sub
from ...algebra.records import mat3_of, put_mat3
from ...algebra.regions import repeat, settled
from ...algebra.scalars import EPS, Scalar, inline, select
from ..constraints.constrained import DEPENDENT
from ..constraints.constraint_rows import carry_axes
from ..signatures import Array, Bodies, Config, Matrix, Number, Record, Vector, Work
from ..tree.ltdl import solve_inward
from .contact_rows import (
    Contact,
    allowed,
    force_of_point,
    product,
    push,
    target,
    times,
    velocity,
    velocity_of_point,
    write_block,
    write_gaps,
    write_rows,
)
from .coulomb_cone import (
    factor_block,
    magnitude,
    point_impulse,
    point_residual,
    point_slope,
)

ROWS = "np+np+np+nl+nd"
SWEEPS, SWEEPS_DRY, SWEEPS_AGAIN = 5, 2, 8  # before Newton's steps: at first, at first beside dry joints, and later
BOLD = 4  # steps in which all joints may change their state
MISSES_MOST = 0.99  # of the largest residual of a joint, from which it may change its state later
PROX = (1e-3, 1e-2, 1e-4)  # ε at first, of each round; the last of all further ones
PROX_LEAST = 1e-7  # by rounding
FAR = 1e30  # a residual above all
STIFF = 1e7  # of a constraint's response: how stiff Newton's steps see it
RES, LEAST, ROUND, EPSILON, COUNT, PHASE = range(6)  # of ``state``


class Impulses(NamedTuple):
    """Scratch of rows, their impulses and what solves for them."""

    L: Matrix = ("nv", "nv")  # M, then its factors, D on the diagonal
    Y: Matrix = (ROWS, "nv")  # J, then J L⁻¹
    Z: Matrix = (ROWS, "nv")  # Y D⁻¹, less what constraints take
    b: Vector = (ROWS,)  # velocities J v, with a point's target c
    before: Vector = (ROWS,)  # velocities at the beginning
    force: Vector = (ROWS,)  # λ
    total: Vector = (ROWS,)  # of both phases
    best: Vector = (ROWS,)  # that of the least residual
    f: Vector = (ROWS,)  # of Newton's step
    first: Vector = (ROWS,)  # of the first phase, beside which λ is that of the second; else 0
    own: Vector = (ROWS,)  # a row's own response; of joints
    size: Vector = (ROWS,)  # the same without constraints; also of points
    slopes: Array = ("np", 3, 3)  # of each point the axes of its ground, as ``slope_axes`` has them
    B: Array = ("np", 3, 3)  # of each point its own block of G
    factors: Array = ("np", 5, 3)  # of B, and scratch of solving
    C: Array = ("np", 3, 3)  # of Newton's step
    bounces: Vector = ("np",)  # e of a point that bounces, else 0
    lower: Vector = ("np",)  # the least λ_n: e λ_c in the second phase, else 0
    load: Vector = ("np",)  # what of λ_c only holds the point against the forces of the step
    level: Vector = ("nl+nd",)  # h F(v) of each joint
    rests: Vector = ("nl+nd",)  # 1 of a joint at rest after the step, else 0
    held: Vector = ("nl+nd",)  # 1 of a joint that Newton's step takes to stick or stop
    goal: Vector = ("nl+nd",)  # its velocity then, else its impulse
    off: Vector = ("nl+nd",)  # residuals of joints
    free: Vector = ("nv",)  # w without impulses
    x: Vector = ("nv",)  # change of w
    K: Matrix = ("nv", "nv")
    T: Matrix = (3, 3)  # derivative of a point's impulse
    N: Matrix = (3, 3)
    CY: Matrix = (3, "nv")
    root: Vector = (4,)  # of ``find_root``
    state: Vector = (6,)  # residual, the least so far, round, ε, count, phases done
    left: Vector = (1,)  # of loops: residuals less the tolerance
    sweeping: Vector = (1,)
    stepping: Vector = (1,)
    phase: Vector = (1,)  # above 0 before a phase
    disc: Vector = (5,)  # of ``disc_impulse``


@inline
def write_responses(
    bodies: Bodies, work: Work, contact: Contact, v: Vector, gap: Vector, s: Impulses
) -> None:  # fmt: skip
    """Gaps, and of the rows velocities without impulses, Y, Z and size; from the places that ``crba`` leaves."""
    n = len(bodies) - 1
    put_mat3(work[0].R, mat3_of(contact.contacts[0].axes))
    carry_axes(bodies, work)
    write_gaps(bodies, work, contact.contacts, contact.heights, gap, s.slopes)
    write_rows(bodies, work, contact.contacts, contact.heights, s.slopes, s.Y)
    for k in range(len(s.b)):
        s.b[k] = 0.0
        for i in range(n):
            s.b[k] = s.b[k] + s.Y[k, i] * v[i]
        s.before[k] = s.b[k]
        solve_inward(bodies, s.L, s.Y[k])
        for i in range(n):
            s.Z[k, i] = s.Y[k, i] * (1.0 / s.L[i, i])
        s.size[k] = product(s.Y, s.Z, k, k)


@inline
def open_laws(
    dt: Number, contact: Contact, gap: Vector, w: Vector, s: Impulses
) -> None:  # fmt: skip
    """Blocks of G, their factors, and targets in b; w0 is kept in ``free``."""
    n, points = len(w), contact.contacts[0].np
    for i in range(n):
        s.free[i] = w[i]
    for p in range(points):
        k = 3 * p
        write_block(s.Y, s.Z, p, s.B[p])
        factor_block(s.B[p], s.size[k] + s.size[k + 1] + s.size[k + 2], n, s.factors[p])
        free = velocity(s.Y, s.b, w, k)
        load = select(s.b[k] - free, s.b[k] - free, 0.0)
        s.load[p] = load * inverse(s.B[p, 0, 0], s.size[k], n)
        s.lower[p] = 0.0
        c, s.bounces[p] = target(gap[p], s.b[k], free, dt, contact.restitution[p])
        s.b[k] = s.b[k] + c
    for j in range(len(s.level)):
        k = 3 * points + j
        s.own[k] = product(s.Y, s.Z, k, k)
        s.held[j], s.goal[j], s.rests[j] = 0.0, 0.0, 0.0


@inline
def solve_impulses(
    q: Config, dt: Number, contact: Contact, held: Record, first: int, w: Vector, s: Impulses
) -> None:  # fmt: skip
    """λ, from that in ``force``, and w with it.

    held   scratch of constraints, whose rows N and responses Newton's steps take as stiff; None without
    first  sweeps before Newton's steps
    """
    rows, state = len(s.force), s.state
    for k in range(rows):
        s.first[k] = 0.0
    for k in range(len(state)):
        state[k] = 0.0
    s.phase[0] = 1.0
    for _ in repeat(2, s.phase, s.force, s.first, s.lower, s.free, w, state):
        if settled(s.phase[0]):
            break
        solve_phase(q, dt, contact, held, first, w, s)
        s.phase[0] = 0.0
        for p in range(len(s.lower)):
            hit = s.force[3 * p] - s.load[p]
            least = s.bounces[p] * select(hit, hit, 0.0)
            s.lower[p] = select(state[PHASE], s.lower[p], least)
            s.phase[0] = select(least, 1.0 - state[PHASE], s.phase[0])
        for k in range(rows):
            s.first[k] = select(s.phase[0], s.force[k], s.first[k])
            s.force[k] = select(s.phase[0], 0.0, s.force[k])
        for i in range(len(w)):
            s.free[i] = select(s.phase[0], w[i], s.free[i])
        state[PHASE] = 1.0


@inline
def solve_phase(
    q: Config, dt: Number, contact: Contact, held: Record, first: int, w: Vector, s: Impulses
) -> None:  # fmt: skip
    """λ of one phase."""
    head, rows = contact.contacts[0], len(s.force)
    state, tolerance = s.state, head.tolerance
    for k in range(rows):
        s.best[k] = s.force[k]
    state[RES], state[LEAST], state[ROUND], state[EPSILON], state[COUNT] = FAR, FAR, 0.0, 0.0, 0.0
    s.left[0] = 1.0
    for _ in repeat(head.rounds, s.left, s.force, s.best, w, state):
        if settled(s.left[0]):
            break
        for k in range(rows):
            s.force[k] = s.best[k]
        respond(w, s)
        state[COUNT] = select(state[ROUND], 1.0 * SWEEPS_AGAIN, 1.0 * first)
        s.sweeping[0] = 1.0
        for _ in repeat(SWEEPS_AGAIN, s.sweeping, s.force, w, state):
            if settled(s.sweeping[0]):
                break
            sweep(q, dt, contact, held is not None, w, s)
            state[RES] = residual(q, dt, contact, w, s)
            state[COUNT] = state[COUNT] - 1.0
            s.sweeping[0] = select(state[COUNT], state[RES] - tolerance, 0.0)
        keep(select(state[ROUND], 1.0, state[LEAST] - state[RES]), s)
        state[EPSILON] = select(state[ROUND], select(state[ROUND] - 1.0, PROX[2], PROX[1]), PROX[0])
        state[COUNT] = 0.0
        s.stepping[0] = state[RES] - tolerance
        for _ in repeat(head.steps, s.stepping, s.force, s.best, w, s.held, s.goal, state):
            if settled(s.stepping[0]):
                break
            newton_step(q, dt, contact, held, w, s)
            new = residual(q, dt, contact, w, s)
            less = 0.1 * state[EPSILON]
            less = select(less - PROX_LEAST, less, PROX_LEAST)
            state[EPSILON] = select(0.5 * state[RES] - new, less, state[EPSILON])
            state[RES] = new
            state[COUNT] = state[COUNT] + 1.0
            keep(state[LEAST] - new, s)
            s.stepping[0] = new - tolerance
        state[ROUND] = state[ROUND] + 1.0
        s.left[0] = state[LEAST] - tolerance
    for k in range(rows):
        s.force[k] = s.best[k]
    respond(w, s)


@inline
def keep(better: Scalar, s: Impulses) -> None:
    """Keep λ and its residual as the best if ``better`` is above 0."""
    for k in range(len(s.force)):
        s.best[k] = select(better, s.force[k], s.best[k])
    s.state[LEAST] = select(better, s.state[RES], s.state[LEAST])


@inline
def respond(w: Vector, s: Impulses) -> None:
    """W = w0 + Zᵀ λ."""
    for i in range(len(w)):
        w[i] = s.free[i]
    for k in range(len(s.force)):
        push(s.Z, k, s.force[k], w)


@inline
def sweep(q: Config, dt: Number, contact: Contact, held: bool, w: Vector, s: Impulses) -> None:
    """New impulses of each point and joint in turn, and w with them."""
    points = contact.contacts[0].np
    for p in range(points):
        now = force_of_point(s.force, p)
        r = sub(velocity_of_point(s.Y, s.b, w, p), times(s.B[p], now))
        solved, _, _ = point_impulse(s.B[p], s.factors[p], r, contact.mu[p], s.lower[p], s.root, s.disc, held)
        set_point(p, solved, now, w, s)
    for j in range(len(s.level)):
        set_joint(q, dt, contact.contacts[1 + points + j], 3 * points + j, j, w, s)


@inline
def set_point(p: int, solved: Vec, now: Vec, w: Vector, s: Impulses) -> None:
    """A point's impulse in place of the present one, and w with it."""
    k = 3 * p
    s.force[k], s.force[k + 1], s.force[k + 2] = solved.x, solved.y, solved.z
    push(s.Z, k, solved.x - now.x, w)
    push(s.Z, k + 1, solved.y - now.y, w)
    push(s.Z, k + 2, solved.z - now.z, w)


@inline
def set_joint(q: Config, dt: Number, c: Record, k: int, j: int, w: Vector, s: Impulses) -> None:
    """A joint's impulse by its law, and w with it."""
    was = s.force[k]
    free = velocity(s.Y, s.b, w, k) - s.own[k] * (s.first[k] + was)
    wanted, _, _ = joint_law(c, q, dt, free, s.own[k] * s.level[j])
    s.force[k] = (wanted - free) * inverse(s.own[k], s.size[k], len(w)) - s.first[k]
    push(s.Z, k, s.force[k] - was, w)


@inline
def residual(q: Config, dt: Number, contact: Contact, w: Vector, s: Impulses) -> Scalar:
    """The largest of all rows; those of joints are written in ``off``."""
    worst, points = 0.0, contact.contacts[0].np
    for p in range(points):
        u = velocity_of_point(s.Y, s.b, w, p)
        x = point_residual(s.B[p], u, contact.mu[p], force_of_point(s.force, p), s.lower[p])
        worst = select(x - worst, x, worst)
    for j in range(len(s.level)):
        k = 3 * points + j
        u = velocity(s.Y, s.b, w, k)
        free = u - s.own[k] * (s.first[k] + s.force[k])
        wanted, _, _ = joint_law(contact.contacts[1 + points + j], q, dt, free, s.own[k] * s.level[j])
        s.off[j] = magnitude(u - wanted)
        worst = select(s.off[j] - worst, s.off[j], worst)
    return worst


# --- Newton's step --------------------------------------------------------------------------------------


@inline
def newton_step(
    q: Config, dt: Number, contact: Contact, held: Record, w: Vector, s: Impulses
) -> None:  # fmt: skip
    """A step on all impulses at once, and w with them."""
    n, points, prox = len(w), contact.contacts[0].np, s.state[EPSILON]
    for i in range(n):
        s.x[i] = 0.0
        for j in range(n):
            s.K[i, j] = 0.0
        s.K[i, i] = s.L[i, i]
    for p in range(points):
        add_point(p, contact.mu[p], prox, held is not None, w, s)
    most = 0.0
    for j in range(len(s.level)):
        k = 3 * points + j
        u = velocity(s.Y, s.b, w, k)
        free = u - s.own[k] * (s.first[k] + s.force[k])
        wanted, _, _ = joint_law(contact.contacts[1 + points + j], q, dt, free, s.own[k] * s.level[j])
        s.off[j] = magnitude(u - wanted)
        most = select(s.off[j] - most, s.off[j], most)
    for j in range(len(s.level)):
        add_joint(q, dt, contact.contacts[1 + points + j], 3 * points + j, j, most, w, s)
    if held is not None:
        for l in range(len(held.N)):
            stiff = STIFF / select(held.stiffness[l], held.stiffness[l], 1.0)
            for i in range(n):
                for j in range(n):
                    s.K[i, j] = s.K[i, j] + held.N[l, i] * (stiff * held.N[l, j])
    solve_K(s.K, s.x)
    for p in range(points):
        k = 3 * p
        u0, u1, u2 = along(s.Y, s.x, k), along(s.Y, s.x, k + 1), along(s.Y, s.x, k + 2)
        for i in range(3):
            change = s.f[k + i] - (s.C[p, i, 0] * u0 + s.C[p, i, 1] * u1 + s.C[p, i, 2] * u2)
            s.force[k + i] = s.force[k + i] + change
    for j in range(len(s.level)):
        k = 3 * points + j
        s.force[k] = s.force[k] + (s.f[k] - stick_share(j, k, prox, s) * along(s.Y, s.x, k))
    respond(w, s)


@inline
def along(Y: Matrix, x: Vector, k: int) -> Scalar:
    """Y_k x."""
    total = 0.0
    for i in range(len(x)):
        total = total + Y[k, i] * x[i]
    return total


@inline
def add_point(p: int, mu: Number, prox: Scalar, held: bool, w: Vector, s: Impulses) -> None:
    """C and f of a point, and its part of K and x."""
    n, k, now = len(w), 3 * p, force_of_point(s.force, p)
    r = sub(velocity_of_point(s.Y, s.b, w, p), times(s.B[p], now))
    solved, sticks, slides = point_impulse(s.B[p], s.factors[p], r, mu, s.lower[p], s.root, s.disc, held)
    point_slope(s.B[p], s.factors[p], r, mu, s.lower[p], solved, sticks, slides, s.root, s.disc, s.T)
    T, N = s.T, s.N
    for i in range(3):  # N = ((1 + ε) 1 + T B)⁻¹
        for j in range(3):
            N[i, j] = T[i, 0] * s.B[p, 0, j] + T[i, 1] * s.B[p, 1, j] + T[i, 2] * s.B[p, 2, j]
        N[i, i] = N[i, i] + (1.0 + prox)
    invert(N)
    f0, f1, f2 = solved.x - now.x, solved.y - now.y, solved.z - now.z
    for i in range(3):
        s.f[k + i] = N[i, 0] * f0 + N[i, 1] * f1 + N[i, 2] * f2
        for j in range(3):
            s.C[p, i, j] = -(N[i, 0] * T[0, j] + N[i, 1] * T[1, j] + N[i, 2] * T[2, j])
    for j in range(n):
        for i in range(3):
            s.CY[i, j] = s.C[p, i, 0] * s.Y[k, j] + s.C[p, i, 1] * s.Y[k + 1, j] + s.C[p, i, 2] * s.Y[k + 2, j]
    for i in range(n):
        y0, y1, y2 = s.Y[k, i], s.Y[k + 1, i], s.Y[k + 2, i]
        s.x[i] = s.x[i] + (y0 * s.f[k] + y1 * s.f[k + 1] + y2 * s.f[k + 2])
        for j in range(n):
            s.K[i, j] = s.K[i, j] + (y0 * s.CY[0, j] + y1 * s.CY[1, j] + y2 * s.CY[2, j])


@inline
def add_joint(
    q: Config, dt: Number, c: Record, k: int, j: int, most: Scalar, w: Vector, s: Impulses
) -> None:  # fmt: skip
    """The state of a joint, its f, and its part of K and x.

    most  the largest residual of a joint
    """
    n, now, u = len(w), s.force[k], velocity(s.Y, s.b, w, k)
    each = inverse(s.own[k], s.size[k], n)
    wanted, _, stays = joint_law(c, q, dt, u - s.own[k] * (s.first[k] + now), s.own[k] * s.level[j])
    new = select(BOLD - s.state[COUNT], 1.0, select(MISSES_MOST * most - s.off[j], 0.0, 1.0))
    s.held[j] = select(new, stays, s.held[j])
    s.goal[j] = select(new, select(stays, wanted, now + (wanted - u) * each), s.goal[j])
    share = stick_share(j, k, s.state[EPSILON], s)
    s.f[k] = select(s.held[j], (s.goal[j] - u) * share, s.goal[j] - now)
    for i in range(n):
        s.x[i] = s.x[i] + s.Y[k, i] * s.f[k]
        for l in range(n):
            s.K[i, l] = s.K[i, l] + s.Y[k, i] * (share * s.Y[k, l])


@inline
def stick_share(j: int, k: int, prox: Scalar, s: Impulses) -> Scalar:
    """C of a joint."""
    return s.held[j] * inverse(s.own[k], s.size[k], len(s.x)) / prox


@inline
def invert(N: Matrix) -> None:
    """N (3, 3) = N⁻¹."""
    a, b, c = N[0, 0], N[0, 1], N[0, 2]
    d, e, f = N[1, 0], N[1, 1], N[1, 2]
    g, h, i = N[2, 0], N[2, 1], N[2, 2]
    A, B, C = e * i - f * h, f * g - d * i, d * h - e * g
    each = 1.0 / (a * A + b * B + c * C)
    N[0, 0], N[0, 1], N[0, 2] = A * each, (c * h - b * i) * each, (b * f - c * e) * each
    N[1, 0], N[1, 1], N[1, 2] = B * each, (a * i - c * g) * each, (c * d - a * f) * each
    N[2, 0], N[2, 1], N[2, 2] = C * each, (b * g - a * h) * each, (a * e - b * d) * each


@inline
def solve_K(K: Matrix, x: Vector) -> None:
    """X = K⁻¹ x in place, from the tips inward: K has the zeros of the tree, and is overwritten."""
    n = len(x)
    for k in range(n - 1, -1, -1):
        each = 1.0 / K[k, k]
        for i in range(k):
            share = K[i, k] * each
            for j in range(k):
                K[i, j] = K[i, j] - share * K[k, j]
            x[i] = x[i] - share * x[k]
    for k in range(n):
        for j in range(k):
            x[k] = x[k] - K[k, j] * x[j]
        x[k] = x[k] * (1.0 / K[k, k])


# --- joints ---------------------------------------------------------------------------------------------


@inline
def inverse(x: Scalar, size: Scalar, n: int) -> Scalar:
    """1 / x of a row's own response, 0 of one that nothing moves."""
    moves = x - (DEPENDENT * n) * EPS * size
    return select(moves, 1.0 / select(moves, x, 1.0), 0.0)


@inline
def joint_law(c: Record, q: Config, dt: Number, free: Scalar, level: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Velocity of a joint that has ``free`` without an impulse; 1 if it rests, else 0; 1 if it is held there, else 0.

    level  by how much its dry friction changes its velocity
    """
    moved = select(free - level, free - level, select(-free - level, free + level, 0.0))
    sticks = select(level - magnitude(free), 1.0, 0.0)  # 0 of NaN
    if c.q_index < 0:  # no limits
        return moved, sticks, sticks
    least, most = allowed(c, q, dt)
    low, high = least - moved, moved - most
    kept = select(low, least, select(high, most, moved))
    stops = select(low, 1.0, select(high, 1.0, sticks))
    return kept, select(low, 0.0, select(high, 0.0, sticks)), stops

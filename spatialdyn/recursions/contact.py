"""A step of the velocities under contact with Coulomb friction, and with joints that stop at their limits.

Impulses λ act at the end of a step h, so that velocities of touching points jump and nothing has to be resolved in
time. With u = J v⁺ of the points, G = J M⁻¹ Jᵀ and b = J (v + h M⁻¹ (τ - bias)),

    u = b + G λ,    0 ≤ λ_n ⊥ u_n + c ≥ 0,    |λ_t| ≤ μ λ_n,    u_t against λ_t where |λ_t| = μ λ_n, else 0

is Signorini's and Coulomb's law, the cone neither a pyramid nor smoothed. An open gap g has c = g/h: a point that does
not reach the ground within the step gets no impulse, and none passes through. A point in the ground comes out by a
share of its depth a step. A joint between limits is a row of its own, with an impulse that keeps q + h v⁺ within them.

The problem is solved point by point, in sweeps (Gauss-Seidel), from λ = 0: a step depends on nothing but its state.
One point alone is solved as one problem in its three unknowns: normal and friction impulses in turn diverge where
μ |G_nt| > G_nn, as they do for legs. Either it leaves, or it sticks, or it slides: all three are computed, and one
chosen.

Source: after Le Lidec, Jallet, Montaut, Laptev, Schmid, Carpentier, Contact models in robotics: a comparative analysis
(arXiv 2304.06372), for the law; the step, and the solution of a sliding point and of a leg at its limits, are our own.
"""

from __future__ import annotations

from dataclasses import replace

from ..algebra.euclidean import Mat3, Vec, sub
from ..algebra.records import mat3_of, put_mat3, table_dtype
from ..algebra.scalars import inline, select
from ..algebra.spatial import Pose
from ..bodies.joints import place_joint
from .constraint_rows import carry_axes
from .contact_rows import (
    CONTACTS_ARGUMENT,
    ENERGY,
    GAP,
    HEIGHTS_ARGUMENT,
    IMPULSE,
    MU,
    RESIDUAL,
    RESTITUTION,
    STOP,
    WORK,
    YIELD,
    force_of_point,
    product,
    push,
    stopping,
    target,
    times,
    velocity,
    velocity_of_point,
    work_of_row,
    write_block,
    write_gaps,
    write_point,
    write_rows,
)
from .coulomb_cone import factor_block, magnitude, point_impulse
from .crba import crba
from .friction import DT
from .ltdl import factor_tree, solve_inward, solve_outward
from .rnea import rnea
from .signatures import Array, Bodies, Config, Matrix, Number, Record, Vector, Work
from .spec import TAU, Argument, Q, Spec, V

PLACES = table_dtype(X=Pose, R=Mat3, o=Vec)


@inline
def contact_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, dt: Number, contacts: Record, heights: Record,
    mu: Vector, restitution: Vector, after: Vector, impulse: Vector, gap: Vector, stop: Vector, residual: Vector,
    energy: Vector, pivots: Vector, L: Matrix, Y: Matrix, Z: Matrix, b: Vector, force: Vector, B: Array, C: Matrix,
    sigma: Vector, x: Matrix, A: Matrix, a: Matrix, e: Matrix, s: Vector, g: Vector, stopped: Vector, bound: Vector,
    before: Vector, T: Array,
) -> None:  # fmt: skip
    """Velocities after a step, impulses, gaps before it, and what the impulses leave of the law.

    With M = LᵀD L, Y = J L⁻¹ and w = L (v⁺ - v), u = J v + Y w, and a change of λ changes w by D⁻¹ Yᵀ of it: G as a
    whole is not needed, only its blocks of single points.

    heights      may be None, for a plane
    mu, restitution  (np)
    after        (nv), written: v⁺
    impulse      (3 np), written: on each point, in the world's axes
    gap          (np), written: distance of each sphere from the ground before the step, negative in it
    stop         (nl), written: impulse on each joint, positive from its lower limit
    residual     (np + nl), written: by how much each point and joint misses its law [m/s | rad/s]
    energy       (np + nl), written: work of each impulse, ½ λᵀ (u⁻ + u⁺) of the velocities before and after it [J]
    all that follows is scratch: Y and Z = Y D⁻¹ have the rows of b and force, three of a point, its normal first;
    seven are of joints with limits, as in ``lock``; before has the rows' velocities at the beginning,
    T (np, 3, 3) of each point the axes of its ground, as ``slope_axes`` has them
    """
    n, points, limits = len(bodies) - 1, contacts[0].np, contacts[0].nl
    crba(bodies, work, q, L)
    factor_tree(bodies, L)
    rnea(bodies, work, q, v, None, None, after)
    put_mat3(work[0].R, mat3_of(contacts[0].axes))
    carry_axes(bodies, work)
    write_gaps(bodies, work, contacts, heights, gap, T)
    write_rows(bodies, work, contacts, heights, T, Y)
    for i in range(n):
        pivots[i] = L[i, i]
        after[i] = dt * (tau[i] - after[i])
    solve_inward(bodies, L, after)
    for i in range(n):
        after[i] = after[i] * (1.0 / L[i, i])  # w without impulses
    for k in range(len(b)):
        b[k] = 0.0
        for i in range(n):
            b[k] = b[k] + Y[k, i] * v[i]
        before[k] = b[k]
        force[k] = 0.0
        solve_inward(bodies, L, Y[k])
        for i in range(n):
            Z[k, i] = Y[k, i] * (1.0 / L[i, i])

    # blocks of G, and targets in b
    for p in range(points):
        write_block(Y, Z, p, B[p])
        free = velocity(Y, b, after, 3 * p)
        b[3 * p] = b[3 * p] + target(gap[p], b[3 * p], free, dt, restitution[p])
        sigma[p] = 0.0
    for l in range(limits):
        stopped[l] = 0.0
        for m in range(limits):
            A[l, m] = product(Y, Z, 3 * points + l, 3 * points + m)

    # λ, and w with it
    for sweep in range(contacts[0].sweeps):
        for l in range(limits):
            k, row = 3 * points + l, contacts[1 + points + l].row
            x[0, 0], x[3, 0], x[4, 0] = A[l, l], velocity(Y, b, after, k), force[k]
            for m in range(limits):
                e[0, m] = A[l, m]
            lock(bodies, contacts, row, l, 1, x, Y, b, after, A, a, e, s, g, stopped, bound)
            free = x[3, 0] - x[0, 0] * force[k]
            wanted = stopping(contacts[1 + points + l], q, dt, free)
            force[k] = wanted * (1.0 / x[0, 0])
            stopped[l] = select(wanted * wanted, 1.0, 0.0)
            bound[l] = free + wanted
            x[4, 0] = force[k] - x[4, 0]
            push(Z, k, x[4, 0], after)
            release(bodies, contacts, row, l, 1, x, Z, after, force, a, e, s, g)
        for p in range(points):
            k, row, now = 3 * p, contacts[1 + p].row, force_of_point(force, p)
            u = velocity_of_point(Y, b, after, p)
            x[3, 0], x[3, 1], x[3, 2] = u.x, u.y, u.z
            for i in range(3):
                for j in range(3):
                    x[i, j] = B[p, i, j]
                for m in range(limits):
                    e[i, m] = product(Y, Z, k + i, 3 * points + m) if is_behind(bodies, contacts, m, row) else 0.0
            lock(bodies, contacts, row, -1, 3, x, Y, b, after, A, a, e, s, g, stopped, bound)
            r = sub(Vec(x[3, 0], x[3, 1], x[3, 2]), times(x, now))
            factor_block(x, B[p, 0, 0] + B[p, 1, 1] + B[p, 2, 2], n, C)
            solved, _ = point_impulse(x, C, r, mu[p], p, sigma, sweep == 0, False)
            force[k], force[k + 1], force[k + 2] = solved.x, solved.y, solved.z
            x[4, 0], x[4, 1], x[4, 2] = solved.x - now.x, solved.y - now.y, solved.z - now.z
            for i in range(3):
                push(Z, k + i, x[4, i], after)
            release(bodies, contacts, row, -1, 3, x, Z, after, force, a, e, s, g)

    for p in range(points):
        write_point(contacts, heights, Y, b, before, after, force, B[p], T, mu, p, impulse, residual, energy)
    for l in range(limits):
        k = 3 * points + l
        pushed = A[l, l] * force[k]
        wanted = stopping(contacts[1 + points + l], q, dt, velocity(Y, b, after, k) - pushed)
        residual[points + l] = magnitude(pushed - wanted)
        stop[l] = force[k]
        energy[points + l] = work_of_row(Y, before, after, k, force[k])
    solve_outward(bodies, L, after)
    for i in range(n):
        after[i] = v[i] + after[i]


@inline
def is_behind(bodies: Bodies, contacts: Record, l: int, row: int) -> bool:
    """Whether joint l carries the body of a row."""
    at = contacts[1 + contacts[0].np + l].row
    carries: bool = at <= row <= bodies[at].last_row
    return carries


@inline
def lock(
    bodies: Bodies, contacts: Record, row: int, own: int, count: int, x: Matrix, Y: Matrix, b: Vector, w: Vector,
    A: Matrix, a: Matrix, e: Matrix, s: Vector, g: Vector, stopped: Vector, bound: Vector,
) -> None:  # fmt: skip
    """Take joints that are stopped, and carry a row's body, out of ``count`` equations there, by Gaussian elimination.

    The ground then feels the whole robot through a leg that is at its limits: in turn with its joints' limits it would
    feel the leg alone, and pass the weight on in ever more sweeps.

    own      the joint whose equation it is, -1 for a point's
    x        (5, 3), written: the equations' block of G, then in row 3 their velocities
    A, a     (nl, nl)  G of joints, and its copy, eliminated
    e        (3, nl)   G of the equations and each joint, eliminated
    s, g     (nl)      velocities less their bounds, and 1 / pivot, 0 of a joint that is not stopped
    """
    points = contacts[0].np
    for l in range(contacts[0].nl):
        g[l] = 0.0
        if l != own and is_behind(bodies, contacts, l, row):
            s[l] = velocity(Y, b, w, 3 * points + l) - bound[l]
            for m in range(contacts[0].nl):
                a[l, m] = A[l, m]
    for l in range(contacts[0].nl):
        if l != own and is_behind(bodies, contacts, l, row):
            g[l] = stopped[l] * ((1.0 - YIELD) / a[l, l])
            for m in range(l + 1, contacts[0].nl):
                if m != own and is_behind(bodies, contacts, m, row):
                    share = a[m, l] * g[l]
                    for j in range(l + 1, m + 1):
                        if j != own and is_behind(bodies, contacts, j, row):
                            a[m, j] = a[m, j] - share * a[j, l]
                            a[j, m] = a[m, j]
                    s[m] = s[m] - share * s[l]
                    for i in range(count):
                        e[i, m] = e[i, m] - share * e[i, l]
            for i in range(count):
                share = e[i, l] * g[l]
                for j in range(count):
                    x[i, j] = x[i, j] - share * e[j, l]
                x[3, i] = x[3, i] - share * s[l]


@inline
def release(
    bodies: Bodies, contacts: Record, row: int, own: int, count: int, x: Matrix, Z: Matrix, w: Vector, force: Vector,
    a: Matrix, e: Matrix, s: Vector, g: Vector,
) -> None:  # fmt: skip
    """The impulses of the joints of ``lock``, after changes of the equations' impulses, in row 4 of x; force and w are
    written.
    """
    points = contacts[0].np
    for l in range(contacts[0].nl - 1, -1, -1):
        if l != own and is_behind(bodies, contacts, l, row):
            y = s[l]
            for i in range(count):
                y = y + e[i, l] * x[4, i]
            for m in range(l + 1, contacts[0].nl):
                if m != own and is_behind(bodies, contacts, m, row):
                    y = y + a[m, l] * s[m]
            s[l] = -g[l] * y  # in place of its velocity: the change of its impulse
            force[3 * points + l] = force[3 * points + l] + s[l]
            push(Z, 3 * points + l, s[l], w)


@inline
def contact_gaps(
    bodies: Bodies, work: Work, q: Config, contacts: Record, heights: Record, gap: Vector, T: Array
) -> None:
    """Distance of each sphere from the ground, gap (np); T is scratch."""
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
    put_mat3(work[0].R, mat3_of(contacts[0].axes))
    carry_axes(bodies, work)
    write_gaps(bodies, work, contacts, heights, gap, T)


_ROWS = "np+np+np+nl"
CONTACT_STEP = Spec(
    "contact_step", contact_step, WORK, (Q, V, TAU, DT, CONTACTS_ARGUMENT, None, MU, RESTITUTION),
    Argument("result", ("nv+np+np+np+np+np+nl+nl+np+nl",), "", "v, impulse, gap, stop, residual, energy"),
    "A step of the velocities under contact with Coulomb friction.", "see ``recursions.contact``",
    pivots=True, regroup=True, composed=True,
    scratch=(
        ("nv", "nv"), (_ROWS, "nv"), (_ROWS, "nv"), (_ROWS,), (_ROWS,), ("np", 3, 3), (5, 3), ("np",), (5, 3),
        ("nl", "nl"), ("nl", "nl"), (3, "nl"), ("nl",), ("nl",), ("nl",), ("nl",), (_ROWS,), ("np", 3, 3),
    ),
    parts=(Argument("v", ("nv",), "rad/s | m/s", "after the step"), IMPULSE, GAP, STOP, RESIDUAL, ENERGY),
)  # fmt: skip
CONTACT_GAPS = Spec(
    "contact_gaps", contact_gaps, PLACES, (Q, CONTACTS_ARGUMENT, None),
    Argument("gap", ("np",), "m", "distance from the ground, negative in it"),
    "Distances of contact points from the ground.", "see ``recursions.contact``", scratch=(("np", 3, 3),),
)  # fmt: skip
CONTACT_STEP_OVER = replace(  # over heights
    CONTACT_STEP, name="contact_step_over",
    inputs=(Q, V, TAU, DT, CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT, MU, RESTITUTION),
)  # fmt: skip
CONTACT_GAPS_OVER = replace(CONTACT_GAPS, name="contact_gaps_over", inputs=(Q, CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT))

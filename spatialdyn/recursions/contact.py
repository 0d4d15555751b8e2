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
from typing import NamedTuple

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
    Contact,
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


class ContactResult(NamedTuple):
    """The outputs of ``contact_step``."""

    after: Vector
    impulse: Vector
    gap: Vector
    stop: Vector
    residual: Vector
    energy: Vector


_ROWS = "np+np+np+nl"


class ContactScratch(NamedTuple):
    """Scratch of ``contact_step``; rows are three of a point, its normal first, then one of each joint."""

    L: Matrix = ("nv", "nv")  # M, then its factors
    Y: Matrix = (_ROWS, "nv")  # J, then J L⁻¹
    Z: Matrix = (_ROWS, "nv")  # Y D⁻¹
    b: Vector = (_ROWS,)  # velocities J v, with a point's target c
    before: Vector = (_ROWS,)  # velocities at the beginning
    force: Vector = (_ROWS,)  # λ
    slopes: Array = ("np", 3, 3)  # of each point the axes of its ground, as ``slope_axes`` has them
    B: Array = ("np", 3, 3)  # of each point its own block of G
    sigma: Vector = ("np",)  # of ``sliding_impulse``
    x: Matrix = (5, 3)  # of a row at its turn: the block of G, in row 3 velocities, in row 4 changes of impulses
    C: Matrix = (5, 3)  # the factors of its block
    A: Matrix = ("nl", "nl")  # G of joints
    a: Matrix = ("nl", "nl")  # its copy, eliminated
    e: Matrix = (3, "nl")  # G of the row at its turn and each joint, eliminated
    u: Vector = ("nl",)  # velocities of joints less their bounds; then the changes of their impulses
    g: Vector = ("nl",)  # 1 / pivot, 0 of a joint that is not stopped
    stopped: Vector = ("nl",)  # 1 of a joint that its limit stops, else 0
    bound: Vector = ("nl",)  # the velocity at which it does


@inline
def contact_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, dt: Number, contact: Contact, out: ContactResult,
    pivots: Vector, s: ContactScratch,
) -> None:  # fmt: skip
    """Velocities after a step, impulses, gaps before it, and what the impulses leave of the law.

    With M = LᵀD L, Y = J L⁻¹ and w = L (v⁺ - v), u = J v + Y w, and a change of λ changes w by D⁻¹ Yᵀ of it: G as a
    whole is not needed, only its blocks of single points.

    out.after     (nv), written: v⁺
    out.impulse   (3 np), written: on each point, in the world's axes
    out.gap       (np), written: distance of each sphere from the ground before the step, negative in it
    out.stop      (nl), written: impulse on each joint, positive from its lower limit
    out.residual  (np + nl), written: by how much each point and joint misses its law [m/s | rad/s]
    out.energy    (np + nl), written: work of each impulse, ½ λᵀ (u⁻ + u⁺) of the velocities before and after it [J]
    """
    contacts, n = contact.contacts, len(bodies) - 1
    points, limits = contacts[0].np, contacts[0].nl
    after, L, Y, Z, b, force, x = out.after, s.L, s.Y, s.Z, s.b, s.force, s.x
    crba(bodies, work, q, L)
    factor_tree(bodies, L)
    rnea(bodies, work, q, v, None, None, after)
    put_mat3(work[0].R, mat3_of(contacts[0].axes))
    carry_axes(bodies, work)
    write_gaps(bodies, work, contacts, contact.heights, out.gap, s.slopes)
    write_rows(bodies, work, contacts, contact.heights, s.slopes, Y)
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
        s.before[k] = b[k]
        force[k] = 0.0
        solve_inward(bodies, L, Y[k])
        for i in range(n):
            Z[k, i] = Y[k, i] * (1.0 / L[i, i])

    # blocks of G, and targets in b
    for p in range(points):
        write_block(Y, Z, p, s.B[p])
        free = velocity(Y, b, after, 3 * p)
        b[3 * p] = b[3 * p] + target(out.gap[p], b[3 * p], free, dt, contact.restitution[p])
        s.sigma[p] = 0.0
    for l in range(limits):
        s.stopped[l] = 0.0
        for m in range(limits):
            s.A[l, m] = product(Y, Z, 3 * points + l, 3 * points + m)

    # λ, and w with it
    for sweep in range(contacts[0].sweeps):
        for l in range(limits):
            k, row = 3 * points + l, contacts[1 + points + l].row
            x[0, 0], x[3, 0], x[4, 0] = s.A[l, l], velocity(Y, b, after, k), force[k]
            for m in range(limits):
                s.e[0, m] = s.A[l, m]
            lock(bodies, contacts, row, l, 1, after, s)
            free = x[3, 0] - x[0, 0] * force[k]
            wanted = stopping(contacts[1 + points + l], q, dt, free)
            force[k] = wanted * (1.0 / x[0, 0])
            s.stopped[l] = select(wanted * wanted, 1.0, 0.0)
            s.bound[l] = free + wanted
            x[4, 0] = force[k] - x[4, 0]
            push(Z, k, x[4, 0], after)
            release(bodies, contacts, row, l, 1, after, s)
        for p in range(points):
            k, row, now = 3 * p, contacts[1 + p].row, force_of_point(force, p)
            u = velocity_of_point(Y, b, after, p)
            x[3, 0], x[3, 1], x[3, 2] = u.x, u.y, u.z
            for i in range(3):
                for j in range(3):
                    x[i, j] = s.B[p, i, j]
                for m in range(limits):
                    s.e[i, m] = product(Y, Z, k + i, 3 * points + m) if is_behind(bodies, contacts, m, row) else 0.0
            lock(bodies, contacts, row, -1, 3, after, s)
            r = sub(Vec(x[3, 0], x[3, 1], x[3, 2]), times(x, now))
            factor_block(x, s.B[p, 0, 0] + s.B[p, 1, 1] + s.B[p, 2, 2], n, s.C)
            solved, _ = point_impulse(x, s.C, r, contact.mu[p], p, s.sigma, sweep == 0, False)
            force[k], force[k + 1], force[k + 2] = solved.x, solved.y, solved.z
            x[4, 0], x[4, 1], x[4, 2] = solved.x - now.x, solved.y - now.y, solved.z - now.z
            for i in range(3):
                push(Z, k + i, x[4, i], after)
            release(bodies, contacts, row, -1, 3, after, s)

    for p in range(points):
        write_point(contacts, contact.heights, contact.mu[p], s.B[p], after, p, out, s)
    for l in range(limits):
        k = 3 * points + l
        pushed = s.A[l, l] * force[k]
        wanted = stopping(contacts[1 + points + l], q, dt, velocity(Y, b, after, k) - pushed)
        out.residual[points + l] = magnitude(pushed - wanted)
        out.stop[l] = force[k]
        out.energy[points + l] = work_of_row(Y, s.before, after, k, force[k])
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
    bodies: Bodies, contacts: Record, row: int, own: int, count: int, w: Vector, s: ContactScratch
) -> None:  # fmt: skip
    """Take joints that are stopped, and carry a row's body, out of ``count`` equations there, by Gaussian elimination.

    The ground then feels the whole robot through a leg that is at its limits: in turn with its joints' limits it would
    feel the leg alone, and pass the weight on in ever more sweeps.

    own  the joint whose equation it is, -1 for a point's
    s    with the equations' block of G and velocities in x and their G with each joint in e; written: both eliminated
    """
    points, x, a, e, u, g = contacts[0].np, s.x, s.a, s.e, s.u, s.g
    for l in range(contacts[0].nl):
        g[l] = 0.0
        if l != own and is_behind(bodies, contacts, l, row):
            u[l] = velocity(s.Y, s.b, w, 3 * points + l) - s.bound[l]
            for m in range(contacts[0].nl):
                a[l, m] = s.A[l, m]
    for l in range(contacts[0].nl):
        if l != own and is_behind(bodies, contacts, l, row):
            g[l] = s.stopped[l] * ((1.0 - YIELD) / a[l, l])
            for m in range(l + 1, contacts[0].nl):
                if m != own and is_behind(bodies, contacts, m, row):
                    share = a[m, l] * g[l]
                    for j in range(l + 1, m + 1):
                        if j != own and is_behind(bodies, contacts, j, row):
                            a[m, j] = a[m, j] - share * a[j, l]
                            a[j, m] = a[m, j]
                    u[m] = u[m] - share * u[l]
                    for i in range(count):
                        e[i, m] = e[i, m] - share * e[i, l]
            for i in range(count):
                share = e[i, l] * g[l]
                for j in range(count):
                    x[i, j] = x[i, j] - share * e[j, l]
                x[3, i] = x[3, i] - share * u[l]


@inline
def release(
    bodies: Bodies, contacts: Record, row: int, own: int, count: int, w: Vector, s: ContactScratch
) -> None:  # fmt: skip
    """The impulses of the joints of ``lock``, after changes of the equations' impulses, in row 4 of x; force and w are
    written.
    """
    points, a, u = contacts[0].np, s.a, s.u
    for l in range(contacts[0].nl - 1, -1, -1):
        if l != own and is_behind(bodies, contacts, l, row):
            y = u[l]
            for i in range(count):
                y = y + s.e[i, l] * s.x[4, i]
            for m in range(l + 1, contacts[0].nl):
                if m != own and is_behind(bodies, contacts, m, row):
                    y = y + a[m, l] * u[m]
            u[l] = -s.g[l] * y  # in place of its velocity: the change of its impulse
            s.force[3 * points + l] = s.force[3 * points + l] + u[l]
            push(s.Z, 3 * points + l, u[l], w)


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


CONTACT_STEP = Spec(
    "contact_step", contact_step, WORK, (Q, V, TAU, DT, Contact(CONTACTS_ARGUMENT, None, MU, RESTITUTION)),
    Argument("result", ("nv+np+np+np+np+np+nl+nl+np+nl",), "", "v, impulse, gap, stop, residual, energy"),
    "A step of the velocities under contact with Coulomb friction.", "see ``recursions.contact``",
    pivots=True, regroup=True, composed=True, scratch=(ContactScratch(),),
    parts=ContactResult(Argument("v", ("nv",), "rad/s | m/s", "after the step"), IMPULSE, GAP, STOP, RESIDUAL, ENERGY),
)  # fmt: skip
CONTACT_GAPS = Spec(
    "contact_gaps", contact_gaps, PLACES, (Q, CONTACTS_ARGUMENT, None),
    Argument("gap", ("np",), "m", "distance from the ground, negative in it"),
    "Distances of contact points from the ground.", "see ``recursions.contact``", scratch=(("np", 3, 3),),
)  # fmt: skip
CONTACT_STEP_OVER = replace(  # over heights
    CONTACT_STEP, name="contact_step_over",
    inputs=(Q, V, TAU, DT, Contact(CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT, MU, RESTITUTION)),
)  # fmt: skip
CONTACT_GAPS_OVER = replace(CONTACT_GAPS, name="contact_gaps_over", inputs=(Q, CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT))

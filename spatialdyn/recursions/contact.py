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

from ..algebra.euclidean import Mat3, Vec, add, cross, rotate, sub, unrotate
from ..algebra.heights import bilinear
from ..algebra.records import mat3_of, motion_of, put_mat3, table_dtype, vec_of
from ..algebra.scalars import Scalar, inline, select, sqrt
from ..algebra.spatial import Force, Inertia, Pose
from ..bodies.contact_table import CONTACTS, HEIGHTS
from ..bodies.joints import place_joint
from .constraint_rows import carry_axes
from .coulomb_cone import factor_block, magnitude, point_impulse, point_residual
from .crba import crba
from .friction import DT
from .ltdl import factor_tree, solve_inward, solve_outward
from .rnea import rnea
from .signatures import Array, Bodies, Config, Matrix, Number, Record, Vector, Work
from .spec import TAU, Argument, Q, Spec, V

WORK = table_dtype(
    X=Pose,  # of crba, then of rnea
    Ic=Inertia,  # of crba
    w=Vec,  # of rnea, as are the fields that follow
    dw=Vec,
    dv=Vec,
    f=Force,
    R=Mat3,  # of constraint_rows, in the ground's axes, as is the field that follows
    o=Vec,
)
PLACES = table_dtype(X=Pose, R=Mat3, o=Vec)

RISE = 0.2  # of its depth that a point in the ground comes out in a step
SLOWEST = 1e-2  # [s] and no faster than in this time: by 0.2 of a depth in ever shorter steps it would be thrown
YIELD = 1e-4  # of what it is pushed, that a joint at its limit gives way: one pushed off its limit is then let go
BOUNCING = 1e-2  # [m/s] speed of approach from which a point bounces: slower ones come to rest


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


# --- geometry -------------------------------------------------------------------------------------------


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


@inline
def write_gaps(bodies: Bodies, work: Work, contacts: Record, heights: Record, gap: Vector, T: Array) -> None:
    """gap (np), from R and o of every row; over heights T too. A slope is that below the sphere's centre."""
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
            level, along, across = bilinear(x, y, heights)
            slope_axes(along * each, across * each, T[p])
            gap[p] = (at.x - level) * T[p, 0, 0] - c.radius


@inline
def slope_axes(along: Scalar, across: Scalar, T: Matrix) -> None:
    """T (3, 3), rows in the axes (z, x, y): the normal of a slope, the direction up along x, that across both."""
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
    for k in range(len(J)):
        for i in range(len(bodies) - 1):
            J[k, i] = 0.0
    for p in range(points):
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
    for l in range(contacts[0].nl + contacts[0].nd):
        J[3 * points + l, contacts[1 + points + l].row - 1] = 1.0


# --- the law --------------------------------------------------------------------------------------------


@inline
def rising(depth: Scalar, dt: Number) -> Scalar:
    """The velocity by which a point in the ground, or a joint beyond a limit, comes out; ``depth`` is negative."""
    within = (1.0 / RISE) * dt
    return depth / select(within - SLOWEST, within, SLOWEST)


@inline
def target(gap: Scalar, before: Scalar, free: Scalar, dt: Number, restitution: Number) -> Scalar:
    """c of a point's normal: u_n + c is 0 where it just reaches the ground, or rises out of it, or bounces.

    It bounces if it would reach the ground within the step, fast enough, and leaves at its share of the speed.

    before, free  velocities of its normal before the step, and after it without impulses
    """
    c = select(gap, gap / dt, rising(gap, dt))
    fast = select(-before - BOUNCING, select(restitution, restitution * before, c), c)
    return select(-(gap / dt + free), fast, c)


@inline
def velocity(Y: Matrix, b: Vector, w: Vector, k: int) -> Scalar:
    """b_k + Y_k w."""
    s = b[k]
    for i in range(len(w)):
        s = s + Y[k, i] * w[i]
    return s


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
def write_point(
    contacts: Record, heights: Record, Y: Matrix, b: Vector, before: Vector, w: Vector, force: Vector, B: Matrix,
    T: Array, mu: Vector, p: int, impulse: Vector, residual: Vector, energy: Vector,
) -> None:  # fmt: skip
    """What a step makes of a point, with its own block B of G: impulse in the world's axes, residual, energy."""
    f = force_of_point(force, p)
    residual[p] = point_residual(B, velocity_of_point(Y, b, w, p), mu[p], f)
    energy[p] = 0.0
    for k in range(3 * p, 3 * p + 3):
        energy[p] = energy[p] + work_of_row(Y, before, w, k, force[k])
    if heights is not None:
        f = untilted(T[p], f)
    f = unrotate(mat3_of(contacts[0].axes), f)
    impulse[3 * p], impulse[3 * p + 1], impulse[3 * p + 2] = f.x, f.y, f.z


@inline
def push(Z: Matrix, k: int, change: Scalar, w: Vector) -> None:
    """w += D⁻¹ Yᵀ of a change of λ_k."""
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
def stopping(c: Record, q: Config, dt: Number, free: Scalar) -> Scalar:
    """By how much the velocity of a joint has to change so that it does not pass its limits within the step."""
    least, most = allowed(c, q, dt)
    return select(least - free, least - free, 0.0) - select(free - most, free - most, 0.0)


@inline
def allowed(c: Record, q: Config, dt: Number) -> tuple[Scalar, Scalar]:
    """The least and the largest velocity with which a joint does not pass its limits within the step."""
    above, below = q[c.q_index] - c.lower, c.upper - q[c.q_index]
    return -select(above, above / dt, rising(above, dt)), select(below, below / dt, rising(below, dt))


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


CONTACTS_ARGUMENT = Argument(
    "contacts", (), "", "what may touch", static=True, table=CONTACTS, sizes=("np", "nl", "nd")
)
HEIGHTS_ARGUMENT = Argument("heights", (), "", "of the ground", static=True, table=HEIGHTS)
MU = Argument("mu", ("np",), "1", "coefficient of friction of each point")
RESTITUTION = Argument("restitution", ("np",), "1", "of each point, from 0 to 1")
IMPULSE = Argument("impulse", ("np+np+np",), "N s", "on each point, in the world's axes")
GAP = Argument("gap", ("np",), "m", "distance from the ground before the step, negative in it")
STOP = Argument("stop", ("nl",), "N m s | N s", "on each joint with limits, positive from the lower one")
RESIDUAL = Argument("residual", ("np+nl",), "m/s | rad/s", "by how much each point and joint misses its law")
ENERGY = Argument("energy", ("np+nl",), "J", "work of the impulses of each point and joint")
_ROWS = "np+np+np+nl"
CONTACT_STEP = Spec(
    "contact_step", contact_step, WORK, (Q, V, TAU, DT, CONTACTS_ARGUMENT, None, MU, RESTITUTION),
    Argument("result", ("nv+np+np+np+np+np+nl+nl+np+nl",), "", "v, impulse, gap, stop, residual, energy"),
    "A step of the velocities under contact with Coulomb friction.", "see ``recursions.contact``",
    pivots=True, regroup=True,
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

"""A step of the velocities under all that acts by impulses: contact, joint limits, dry friction, constraints.

As ``contact`` has it, with three more laws at the end of a step h. A joint that rubs dry has an impulse s of its own,

    s ∈ -h F(v) Sgn v⁺,

so that it sticks or moves as in ``friction``, up to its limits; bristles and damping are part of M and of the torques,
as there. Constraints hold at velocities, J v⁺ + h J̇ v = 0, or with a rate 1/T as in ``constrained``: their rows are
taken out of M⁻¹ before all else, so that no sweep leaves any of them open.

Legs that stick in their joints pass the robot's weight on in more sweeps than there is time for if every row sees the
robot alone. So a row is solved with all rows taken out that are held: joints that stick or stop, points that stick.
They are the pivots of a ``tableau``, which changes with the rows' states. A robot on stiff legs is held more often than
it can move; so that none of the rows is then without an answer, a held row yields by YIELD of what it would move alone,
and takes it back at its next turn. A last few sweeps hold nothing: they lessen what is left where a point and a joint
stick in turn. By 5 sweeps a quadruped that trots on dry joints misses its laws by at most 1e-6 m/s in half of the steps
and 1e-3 in 95 % of them, by 3 too in less time: ``benchmarks/contacts.py`` prints what either leaves.

Source: the law as in ``contact``; its solution is a derivation of our own.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

from ..algebra.euclidean import Vec, sub
from ..algebra.records import mat3_of, put_mat3
from ..algebra.scalars import EPS, Scalar, exceeds, inline, select, sqrt
from .configuration import integrate
from .constrained import DEPENDENT, RATE, felt, share, stabilize
from .constraint_rows import (
    CONSTRAINTS_ARGUMENT,
    carry_axes,
    place_rows,
    turn_rows,
    write_drift,
    write_error,
    write_jacobian,
)
from .contact_rows import (
    CONTACTS_ARGUMENT,
    ENERGY,
    GAP,
    HEIGHTS_ARGUMENT,
    IMPULSE,
    MU,
    RESTITUTION,
    STOP,
    WORK,
    YIELD,
    Contact,
    allowed,
    force_of_point,
    product,
    push,
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
from .dense import factor_dropping, quotient, solve_backward, solve_forward
from .friction import BRISTLE_LAW, BRISTLES, DT, LAW, BristleLaw, add_bristles, dry_level
from .ltdl import factor_tree, solve_inward, solve_outward
from .rnea import rnea
from .signatures import Array, Bodies, Config, Matrix, Number, Record, Vector, Work
from .spec import FEXT, TAU, Argument, Q, Spec, V
from .tableau import open_rows, turn_row

YIELD_JOINT = 0.05  # as YIELD, of joints: with less, points and joints of stiff legs stick in turn without end
PLAIN = 2  # sweeps at the end that hold no row
# of what dry friction changes a velocity by: a load that exceeds it by less leaves a joint at rest, as sweeps leave the
# shares of stiff legs open by as much
SLOW = 1e-4


class ImpulseResult(NamedTuple):
    """The outputs of ``impulse_step``."""

    after: Vector
    impulse: Vector
    gap: Vector
    stop: Vector
    residual: Vector
    energy: Vector
    friction: Vector
    bristles: Vector
    reaction: Vector
    missed: Vector


_ROWS = "np+np+np+nl+nd"


class ImpulseScratch(NamedTuple):
    """Scratch of ``impulse_step``; rows are three of a point, its normal first, then one of each joint."""

    L: Matrix = ("nv", "nv")  # M, then its factors
    Y: Matrix = (_ROWS, "nv")  # J, then J L⁻¹
    Z: Matrix = (_ROWS, "nv")  # Y D⁻¹, less what constraints take
    b: Vector = (_ROWS,)  # velocities J v, with a point's target c
    before: Vector = (_ROWS,)  # velocities at the beginning
    force: Vector = (_ROWS,)  # λ
    slopes: Array = ("np", 3, 3)  # of each point the axes of its ground, as ``slope_axes`` has them
    sigma: Vector = ("np",)  # of ``sliding_impulse``
    T: Matrix = (_ROWS, _ROWS)  # the tableau
    x: Vector = (_ROWS,)  # velocity of a free row, -impulse of a held one, yielding counted
    y: Vector = (_ROWS,)  # impulse of a free row, velocity of a held one
    held: Vector = (_ROWS,)  # 1 of a held row, else 0
    soft: Vector = (_ROWS,)  # by how much a row yields
    size: Vector = (_ROWS,)  # of a row's own response; of a point the trace of its block
    column: Vector = (_ROWS,)  # of ``turn_row``
    B: Matrix = (5, 3)  # of rows at their turn: the block of G, in row 3 velocities, in row 4 impulses
    C: Matrix = (_ROWS, 3)  # of rows at their turn: the others' responses, of ``open_rows``
    A: Matrix = (5, 3)  # the factors of a point's block
    level: Vector = ("nl+nd",)  # h F(v) of each joint
    rests: Vector = ("nl+nd",)  # 1 of a joint at rest after the step, else 0


class HeldScratch(NamedTuple):
    """Scratch of constraints in a step."""

    N: Matrix = ("nc", "nv")  # J, then J L⁻¹
    G: Matrix = ("nc", "nc")  # what constraints feel, then its factors; the lower triangle
    gamma: Vector = ("nc",)  # h γ, then what is left of the equations
    scale: Vector = ("nc",)  # what a pivot is compared with; then changes of impulses
    kept: Vector = ("nc",)  # 1 of an equation that is independent, else 0
    P: Matrix = (_ROWS, "nc")  # reactions to unit impulses
    J: Matrix = ("nc", "nv")  # where the step ends
    ways: Matrix = (2, "nv")  # displacements
    ends: Matrix = (2, "nq")  # configurations


@inline
def impulse_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, z: Vector, tau: Vector, fext: Matrix, dt: Number,
    contact: Contact, law: BristleLaw, constraints: Record, rate: Number, out: ImpulseResult, pivots: Vector,
    s: ImpulseScratch, h: HeldScratch,
) -> None:  # fmt: skip
    """Velocities after a step, impulses, gaps before it, what impulses leave of the laws, friction, reactions.

    z      of bristles, as ``bristle_step``; None: dry friction
    law    of dry friction if z is None; it may be None: no friction
    fext, constraints, rate  may be None; h is None without constraints
    out.after, impulse, gap, stop, energy  written, as of ``contact_step``
    out.residual  (np + nl + nd), written: by how much each point and joint misses its law [m/s | rad/s]
    out.friction  (nv), written: dry friction torque [N m | N], 0 with bristles
    out.bristles  (nv), written: after the step, if there are some
    out.reaction  (nc), written: impulse of each equation
    out.missed    (2), written if there are constraints: residual and rank, as of ``constrained_motion``
    """
    contacts, n, after = contact.contacts, len(bodies) - 1, out.after
    points, joints = contacts[0].np, contacts[0].nl + contacts[0].nd
    move_freely(bodies, work, q, v, z, tau, fext, dt, law, out, pivots, s)
    write_responses(bodies, work, contacts, contact.heights, v, out, s)
    if constraints is not None:
        hold(bodies, work, q, v, dt, constraints, rate, out, s, h)
    open_laws(v, z, dt, contact, law, out, s)

    for sweep in range(contacts[0].sweeps):
        for p in range(points):
            k = 3 * p
            look(s, k, 3)
            r = sub(Vec(s.B[3, 0], s.B[3, 1], s.B[3, 2]), times(s.B, Vec(s.B[4, 0], s.B[4, 1], s.B[4, 2])))
            factor_block(s.B, s.size[k], n, s.A)
            solved, sticks = point_impulse(s.B, s.A, r, contact.mu[p], p, s.sigma, sweep == 0, constraints is not None)
            act(s, n, k, 3, r, solved, sticks)
        for j in range(joints):
            k = 3 * points + j
            look(s, k, 1)
            each = inverse(s.B[0, 0], s.size[k], n)
            free = s.B[3, 0] - s.B[0, 0] * s.B[4, 0]
            wanted, s.rests[j], stays = joint_law(contacts[1 + points + j], q, dt, free, s.B[0, 0] * s.level[j])
            solved = Vec((wanted - free) * each, 0.0, 0.0)
            act(s, n, k, 1, Vec(free, 0.0, 0.0), solved, stays)

    for k in range(len(s.force)):
        s.force[k] = select(s.held[k], -s.x[k], s.y[k])
        push(s.Z, k, s.force[k], after)
    if constraints is not None and rate is None:
        meet(bodies, work, q, v, dt, constraints, out, s, h)
    for _ in range(PLAIN):
        sweep_plainly(q, n, dt, contact, constraints is not None, after, s)
    write_laws(q, dt, contact, out, s)
    if constraints is not None:
        for k in range(len(out.reaction)):
            for l in range(len(s.force)):
                out.reaction[k] = out.reaction[k] + h.P[l, k] * s.force[l]
    solve_outward(bodies, s.L, after)
    for i in range(n):
        after[i] = v[i] + after[i]
    for j in range(joints):
        i = contacts[1 + points + j].row - 1
        after[i] = select(s.rests[j], 0.0, after[i])
    if z is not None:
        for i in range(n):
            out.bristles[i] = (z[i] + dt * after[i]) * out.bristles[i]


# --- before the sweeps ----------------------------------------------------------------------------------


@inline
def move_freely(
    bodies: Bodies, work: Work, q: Config, v: Vector, z: Vector, tau: Vector, fext: Matrix, dt: Number, law: BristleLaw,
    out: ImpulseResult, pivots: Vector, s: ImpulseScratch,
) -> None:  # fmt: skip
    """M, with what friction adds, factored in L; in ``after`` w = L (v⁺ - v) without impulses."""
    n, after, L = len(bodies) - 1, out.after, s.L
    crba(bodies, work, q, L)
    rnea(bodies, work, q, v, None, fext, after)
    if z is None:
        for i in range(n):
            after[i] = tau[i] - after[i]
            out.friction[i] = 0.0
            if law is not None:
                L[i, i] = L[i, i] + dt * law.viscous[i]
                after[i] = after[i] - law.viscous[i] * v[i]
    else:
        add_bristles(v, z, tau, dt, law, L, after, out.bristles)
        for i in range(n):
            out.friction[i] = 0.0
    factor_tree(bodies, L)
    for i in range(n):
        pivots[i] = L[i, i]
        after[i] = dt * after[i]
    solve_inward(bodies, L, after)
    for i in range(n):
        after[i] = after[i] * (1.0 / L[i, i])


@inline
def write_responses(
    bodies: Bodies, work: Work, contacts: Record, heights: Record, v: Vector, out: ImpulseResult, s: ImpulseScratch
) -> None:
    """Gaps, and of the rows: velocities without impulses, Y, Z and size."""
    n = len(bodies) - 1
    put_mat3(work[0].R, mat3_of(contacts[0].axes))
    carry_axes(bodies, work)
    write_gaps(bodies, work, contacts, heights, out.gap, s.slopes)
    write_rows(bodies, work, contacts, heights, s.slopes, s.Y)
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
    v: Vector, z: Vector, dt: Number, contact: Contact, law: BristleLaw, out: ImpulseResult, s: ImpulseScratch
) -> None:
    """Targets in b, the tableau of G, and what rows are without impulses."""
    contacts = contact.contacts
    points, joints = contacts[0].np, contacts[0].nl + contacts[0].nd
    for p in range(points):
        free = velocity(s.Y, s.b, out.after, 3 * p)
        s.b[3 * p] = s.b[3 * p] + target(out.gap[p], s.b[3 * p], free, dt, contact.restitution[p])
        s.sigma[p] = 0.0
        for k in range(3 * p, 3 * p + 3):  # of all three: one alone may be nothing but rounding
            scale_of_point(s.size, p, k)
    for j in range(joints):
        s.level[j] = 0.0
        s.rests[j] = 0.0
        if law is not None and z is None:
            s.level[j] = dt * dry_level(v, law, contacts[1 + points + j].row - 1)
    for k in range(len(s.b)):
        for l in range(k + 1):
            s.T[k, l] = product(s.Y, s.Z, k, l)
        s.soft[k] = (YIELD if k < 3 * points else YIELD_JOINT) * s.T[k, k]
        s.T[k, k] = s.T[k, k] + s.soft[k]
        s.held[k], s.x[k], s.y[k] = 0.0, velocity(s.Y, s.b, out.after, k), 0.0


@inline
def scale_of_point(size: Vector, p: int, k: int) -> None:
    """The trace of a point's block in place of each of its entries, once the last of them is there."""
    if k == 3 * p + 2:
        total = size[3 * p] + size[3 * p + 1] + size[k]
        size[3 * p], size[3 * p + 1], size[k] = total, total, total


@inline
def hold(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Number, constraints: Record, rate: Number, out: ImpulseResult,
    s: ImpulseScratch, h: HeldScratch,
) -> None:  # fmt: skip
    """Take constraints out: of w, and of Z = D⁻¹ Yᵀ, by which w changes with impulses; rows that depend are dropped.

    As ``constrained.respond``, whose meaning residual and rank have; w, Z, reaction, missed and P are written.
    """
    n, m, w, L, N, G, gamma = len(bodies) - 1, len(h.gamma), out.after, s.L, h.N, h.G, h.gamma
    turn_rows(bodies, work)
    write_jacobian(bodies, work, constraints, N)
    write_drift(bodies, work, constraints, v, gamma)
    if rate is not None:
        stabilize(bodies, work, q, v, constraints, rate, N, gamma, out.reaction)
    for k in range(m):
        gamma[k] = dt * gamma[k]
        if rate is None:
            for i in range(n):
                gamma[k] = gamma[k] + N[k, i] * v[i]
    felt(bodies, L, N, G)
    for k in range(m):
        h.scale[k] = G[k, k]
    share(constraints, h.scale)
    factor_dropping(G, h.scale, DEPENDENT * (n + m) * EPS, h.kept)

    whole, lost, rank = 0.0, 0.0, 0.0
    for i in range(n):
        whole = whole + w[i] * w[i] * L[i, i]
    for k in range(m):
        gamma[k] = -gamma[k]
        for i in range(n):
            gamma[k] = gamma[k] - N[k, i] * w[i]
    solve_forward(G, gamma)
    for k in range(m):
        square = gamma[k] * gamma[k]
        whole = whole + square * G[k, k]
        lost = lost + (1.0 - h.kept[k]) * quotient(square, h.scale[k])
        rank = rank + h.kept[k]
    out.missed[0], out.missed[1] = sqrt(quotient(lost, lost + whole)), rank
    solve_backward(G, gamma, out.reaction)
    for i in range(n):
        for k in range(m):
            w[i] = w[i] + N[k, i] * out.reaction[k] * (1.0 / L[i, i])
    for l in range(len(s.Z)):
        for k in range(m):
            gamma[k] = 0.0
            for i in range(n):
                gamma[k] = gamma[k] - N[k, i] * s.Z[l, i]
        solve_forward(G, gamma)
        solve_backward(G, gamma, h.P[l])
        for i in range(n):
            taken = 0.0
            for k in range(m):
                taken = taken + N[k, i] * h.P[l, k]
            s.Z[l, i] = s.Z[l, i] + taken * (1.0 / L[i, i])


@inline
def meet(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Number, constraints: Record, out: ImpulseResult,
    s: ImpulseScratch, h: HeldScratch,
) -> None:  # fmt: skip
    """Let v⁺ meet J v⁺ = 0 where the step ends, with q projected, and not only J v⁺ + h J̇ v = 0 where it begins.

    The two differ by the order of h² in smooth motion and of h in an impact; what is left here is one order less. The
    last sweeps follow, in which points and dry joints answer to the change. w, in ``after``, and reaction are written.
    """
    n, m, w, gamma, way, back = len(bodies) - 1, len(h.gamma), out.after, h.gamma, h.ways[0], h.ways[1]
    for i in range(n):
        way[i] = w[i]
    solve_outward(bodies, s.L, way)
    for i in range(n):
        way[i] = dt * (v[i] + way[i])
    integrate(bodies, q, way, h.ends[0])
    place_rows(bodies, work, h.ends[0])
    write_error(bodies, work, constraints, h.ends[0], gamma)
    for i in range(n):
        back[i] = 0.0
    push_back(s.L, h, back)
    solve_outward(bodies, s.L, back)
    integrate(bodies, h.ends[0], back, h.ends[1])
    place_rows(bodies, work, h.ends[1])
    write_jacobian(bodies, work, constraints, h.J)
    for k in range(m):
        gamma[k] = 0.0
        for i in range(n):
            gamma[k] = gamma[k] + h.J[k, i] * (way[i] / dt)
    push_back(s.L, h, w)
    for k in range(m):
        out.reaction[k] = out.reaction[k] + h.scale[k]


@inline
def push_back(L: Matrix, h: HeldScratch, w: Vector) -> None:
    """Take gamma (nc) out of the constraints' velocities, in w, by impulses, written in scale."""
    for k in range(len(h.gamma)):
        h.gamma[k] = -h.gamma[k]
    solve_forward(h.G, h.gamma)
    solve_backward(h.G, h.gamma, h.scale)
    for i in range(len(w)):
        for k in range(len(h.gamma)):
            w[i] = w[i] + h.N[k, i] * h.scale[k] * (1.0 / L[i, i])


# --- a row at its turn ----------------------------------------------------------------------------------


@inline
def look(s: ImpulseScratch, k: int, count: int) -> None:
    """B and C of ``open_rows``, without the rows' own yielding; rows 3 and 4 of B are velocities and impulses now."""
    B, x, y, soft = s.B, s.x, s.y, s.soft
    open_rows(s.T, s.held, k, count, B, s.C)
    for a in range(count):
        h = s.held[k + a]
        B[4, a] = select(h, -x[k + a], y[k + a])
        B[3, a] = select(h, y[k + a], x[k + a]) - soft[k + a] * B[4, a]
        B[a, a] = B[a, a] - soft[k + a]


@inline
def act(s: ImpulseScratch, n: int, k: int, count: int, r: Vec, solved: Vec, stays: Scalar) -> None:
    """New impulses of rows that were looked at, and what they change; they are held, or not, from now on.

    r      their velocities without impulses of their own
    stays  1 if they are to be held, else 0; a row that nothing moves is not
    """
    B, C, x, y, held, soft = s.B, s.C, s.x, s.y, s.held, s.soft
    change = sub(solved, Vec(B[4, 0], B[4, 1], B[4, 2]) if count == 3 else Vec(B[4, 0], 0.0, 0.0))
    for i in range(len(x)):
        if count == 3:
            x[i] = x[i] + (C[i, 0] * change.x + C[i, 1] * change.y + C[i, 2] * change.z)
        else:
            x[i] = x[i] + C[i, 0] * change.x
    for a in range(count):
        new = solved.x if a == 0 else solved.y if a == 1 else solved.z
        u = (r.x if a == 0 else r.y if a == 1 else r.z) + soft[k + a] * new
        u = u + (B[a, 0] * solved.x + B[a, 1] * solved.y + B[a, 2] * solved.z if count == 3 else B[a, 0] * solved.x)
        h = stays * exceeds(soft[k + a], (DEPENDENT * YIELD * n) * EPS * s.size[k + a])
        x[k + a] = select(h, -new, u)
        y[k + a] = select(h, u, new)
        turn_row(s.T, k + a, h + held[k + a] - 2.0 * (h * held[k + a]), held[k + a], s.column)
        held[k + a] = h


@inline
def sweep_plainly(
    q: Config, n: int, dt: Number, contact: Contact, held: bool, w: Vector, s: ImpulseScratch
) -> None:  # fmt: skip
    """A sweep that holds no row: new impulses, and w with them."""
    contacts, force, Y, Z, b = contact.contacts, s.force, s.Y, s.Z, s.b
    points = contacts[0].np
    for p in range(points):
        now, k = force_of_point(force, p), 3 * p
        write_block(Y, Z, p, s.B)
        r = sub(velocity_of_point(Y, b, w, p), times(s.B, now))
        factor_block(s.B, s.size[k], n, s.A)
        solved, _ = point_impulse(s.B, s.A, r, contact.mu[p], p, s.sigma, False, held)
        force[k], force[k + 1], force[k + 2] = solved.x, solved.y, solved.z
        push(Z, k, solved.x - now.x, w)
        push(Z, k + 1, solved.y - now.y, w)
        push(Z, k + 2, solved.z - now.z, w)
    for j in range(contacts[0].nl + contacts[0].nd):
        k = 3 * points + j
        alone, was = product(Y, Z, k, k), force[k]
        free = velocity(Y, b, w, k) - alone * was
        wanted, s.rests[j], _ = joint_law(contacts[1 + points + j], q, dt, free, alone * s.level[j])
        force[k] = (wanted - free) * inverse(alone, s.size[k], n)
        push(Z, k, force[k] - was, w)


@inline
def write_laws(q: Config, dt: Number, contact: Contact, out: ImpulseResult, s: ImpulseScratch) -> None:
    """What a step makes of points and joints: impulses, stops, dry friction, residuals, energy, which joints rest."""
    contacts, w, force, Y, Z, level = contact.contacts, out.after, s.force, s.Y, s.Z, s.level
    points = contacts[0].np
    for p in range(points):
        write_block(Y, Z, p, s.B)
        write_point(contacts, contact.heights, contact.mu[p], s.B, w, p, out, s)
    for j in range(contacts[0].nl + contacts[0].nd):
        k, c = 3 * points + j, contacts[1 + points + j]
        alone, u = product(Y, Z, k, k), velocity(Y, s.b, w, k)
        wanted, _, _ = joint_law(c, q, dt, u - alone * force[k], alone * level[j])
        out.residual[points + j] = magnitude(u - wanted)
        rubs, least = within(force[k], level[j]), SLOW * alone * level[j]
        rubs = select(u - least, -level[j], select(-least - u, level[j], rubs))  # of a joint that moves, against that
        s.rests[j] = select(least - magnitude(u), 1.0, s.rests[j])
        out.friction[c.row - 1] = rubs / dt
        if j < contacts[0].nl:
            out.stop[j] = force[k] - rubs
            out.energy[points + j] = work_of_row(Y, s.before, w, k, out.stop[j])


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


@inline
def within(x: Scalar, most: Scalar) -> Scalar:
    """x, or the nearer of ±most."""
    return select(x - most, most, select(-most - x, -most, x))


FRICTION = Argument("friction", ("nv",), "N m | N", "dry friction torques")
AFTER = Argument("v", ("nv",), "rad/s | m/s", "after the step")
RESIDUAL = Argument("residual", ("np+nl+nd",), "m/s | rad/s", "by how much each point and joint misses its law")
REACTION = Argument("reaction", ("nc",), "N s | N m s", "of each equation, on frame a, in b's axes")
MISSED = Argument("missed", (2,), "1", "of equations that depend on others, and how many are independent")
OVER, RUBS, BENDS, HOLDS, STEADIES, PUSHED = "heights", "friction", "bristles", "constraints", "rate", "fext"
ALL = (OVER, RUBS, BENDS, HOLDS, STEADIES, PUSHED)


@cache
def impulse_step_spec(has: frozenset[str]) -> Spec:
    """The Spec of a step with some of heights, friction, bristles (beside friction), constraints, a rate, fext."""

    def given(what: str, x: Record) -> Record:
        return x if what in has else None

    rubs = given(BENDS, BRISTLE_LAW) if BENDS in has else given(RUBS, LAW)
    ground = Contact(CONTACTS_ARGUMENT, given(OVER, HEIGHTS_ARGUMENT), MU, RESTITUTION)
    inputs = (
        Q, V, given(BENDS, BRISTLES), TAU, given(PUSHED, FEXT), DT, ground, rubs, given(HOLDS, CONSTRAINTS_ARGUMENT),
        given(STEADIES, replace(RATE, optional=False)),
    )  # fmt: skip
    parts = ImpulseResult(
        AFTER, IMPULSE, GAP, STOP, RESIDUAL, ENERGY, FRICTION,
        Argument("bristles", ("nv" if BENDS in has else 0,), "rad | m", "after the step"),
        replace(REACTION, shape=("nc" if HOLDS in has else 0,)), replace(MISSED, shape=(2 if HOLDS in has else 0,)),
    )  # fmt: skip
    width = "+".join(str(x) for part in parts for x in part.shape if x)
    return Spec(
        "_".join(["impulse_step", *(x for x in ALL if x in has)]), impulse_step, WORK, inputs,
        Argument("result", (width,), "", ", ".join(x.name for x in parts)),
        "A step of the velocities under contact, limits, dry friction and constraints.",
        "see ``recursions.impulse_step``", pivots=True, regroup=True, composed=True,
        scratch=(ImpulseScratch(), HeldScratch() if HOLDS in has else None),
        parts=parts,
    )  # fmt: skip

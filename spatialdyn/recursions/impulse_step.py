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
from .friction import BRISTLES, DAMPING, DT, LAW, STIFFNESS, add_bristles, dry_level
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


@inline
def impulse_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, z: Vector, tau: Vector, fext: Matrix, dt: Number,
    contacts: Record, heights: Record, mu: Vector, restitution: Vector, coulomb: Vector, viscous: Vector,
    static: Vector, stribeck: Vector, stiffness: Vector, damping: Vector, constraints: Record, rate: Number,
    after: Vector, impulse: Vector, gap: Vector, stop: Vector, residual: Vector, energy: Vector, friction: Vector,
    bristles: Vector, reaction: Vector, missed: Vector, pivots: Vector, L: Matrix, Y: Matrix, Z: Matrix, b: Vector,
    force: Vector, before: Vector, S: Array, sigma: Vector, T: Matrix, x: Vector, y: Vector, held: Vector,
    soft: Vector, size: Vector, column: Vector, B: Matrix, C: Matrix, A: Matrix, level: Vector, rests: Vector,
    N: Matrix, G: Matrix, gamma: Vector, scale: Vector, kept: Vector, P: Matrix, J: Matrix, ways: Matrix, ends: Matrix,
) -> None:  # fmt: skip
    """Velocities after a step, impulses, gaps before it, what impulses leave of the laws, friction, reactions.

    z, stiffness, damping  of bristles, as ``bristle_step``; None: dry friction, of ``coulomb`` and what follows it
    coulomb      may be None: no friction
    heights, fext, constraints, rate  may be None
    after, impulse, gap, stop, energy  written, as of ``contact_step``
    residual     (np + nl + nd), written: by how much each point and joint misses its law [m/s | rad/s]
    friction     (nv), written: dry friction torque [N m | N], 0 with bristles
    bristles     (nv), written: after the step, if there are some
    reaction     (nc), written: impulse of each equation
    missed       (2), written if there are constraints: residual and rank, as of ``constrained_motion``
    all that follows is scratch: rows of Y, Z, T are three of a point and one of a joint; S (np, 3, 3) as T of
    ``contact_step``; N (nc, nv) and G (nc, nc) are of the constraints, P (rows, nc) reactions to unit impulses; J
    (nc, nv), ways (2, nv) and ends (2, nq) are of ``meet``
    """
    n, points = len(bodies) - 1, contacts[0].np
    joints, rows = contacts[0].nl + contacts[0].nd, len(b)
    crba(bodies, work, q, L)
    rnea(bodies, work, q, v, None, fext, after)
    if z is None:
        for i in range(n):
            after[i] = tau[i] - after[i]
            friction[i] = 0.0
            if coulomb is not None:
                L[i, i] = L[i, i] + dt * viscous[i]
                after[i] = after[i] - viscous[i] * v[i]
    else:
        add_bristles(v, z, tau, dt, coulomb, viscous, static, stribeck, stiffness, damping, L, after, bristles)
        for i in range(n):
            friction[i] = 0.0
    factor_tree(bodies, L)
    put_mat3(work[0].R, mat3_of(contacts[0].axes))
    carry_axes(bodies, work)
    write_gaps(bodies, work, contacts, heights, gap, S)
    write_rows(bodies, work, contacts, heights, S, Y)
    for i in range(n):
        pivots[i] = L[i, i]
        after[i] = dt * after[i]
    solve_inward(bodies, L, after)
    for i in range(n):
        after[i] = after[i] * (1.0 / L[i, i])  # w = L (v⁺ - v) without impulses
    for k in range(rows):
        b[k] = 0.0
        for i in range(n):
            b[k] = b[k] + Y[k, i] * v[i]
        before[k] = b[k]
        solve_inward(bodies, L, Y[k])
        for i in range(n):
            Z[k, i] = Y[k, i] * (1.0 / L[i, i])
        size[k] = product(Y, Z, k, k)
    if constraints is not None:
        hold(bodies, work, q, v, dt, constraints, rate, L, Z, after, reaction, missed, N, G, gamma, scale, kept, P)

    # targets in b, the tableau of G, what rows are without impulses
    for p in range(points):
        free = velocity(Y, b, after, 3 * p)
        b[3 * p] = b[3 * p] + target(gap[p], b[3 * p], free, dt, restitution[p])
        sigma[p] = 0.0
        for k in range(3 * p, 3 * p + 3):  # of all three: one alone may be nothing but rounding
            scale_of_point(size, p, k)
    for j in range(joints):
        level[j] = 0.0
        rests[j] = 0.0
        if coulomb is not None and z is None:
            level[j] = dt * dry_level(v, coulomb, static, stribeck, contacts[1 + points + j].row - 1)
    for k in range(rows):
        for l in range(k + 1):
            T[k, l] = product(Y, Z, k, l)
        soft[k] = (YIELD if k < 3 * points else YIELD_JOINT) * T[k, k]
        T[k, k] = T[k, k] + soft[k]
        held[k], x[k], y[k] = 0.0, velocity(Y, b, after, k), 0.0

    for sweep in range(contacts[0].sweeps):
        for p in range(points):
            k = 3 * p
            look(T, held, x, y, soft, k, 3, B, C)
            r = sub(Vec(B[3, 0], B[3, 1], B[3, 2]), times(B, Vec(B[4, 0], B[4, 1], B[4, 2])))
            factor_block(B, size[k], n, A)
            solved, sticks = point_impulse(B, A, r, mu[p], p, sigma, sweep == 0, constraints is not None)
            act(T, held, x, y, soft, size, n, k, 3, B, C, r, solved, sticks, column)
        for j in range(joints):
            k = 3 * points + j
            look(T, held, x, y, soft, k, 1, B, C)
            each = inverse(B[0, 0], size[k], n)
            free = B[3, 0] - B[0, 0] * B[4, 0]
            wanted, rests[j], stays = joint_law(contacts[1 + points + j], q, dt, free, B[0, 0] * level[j])
            solved = Vec((wanted - free) * each, 0.0, 0.0)
            act(T, held, x, y, soft, size, n, k, 1, B, C, Vec(free, 0.0, 0.0), solved, stays, column)

    for k in range(rows):
        force[k] = select(held[k], -x[k], y[k])
        push(Z, k, force[k], after)
    if constraints is not None and rate is None:
        meet(bodies, work, q, v, dt, constraints, L, after, reaction, N, G, gamma, scale, J, ways, ends)
    for _ in range(PLAIN):
        for p in range(points):
            now, k = force_of_point(force, p), 3 * p
            write_block(Y, Z, p, B)
            r = sub(velocity_of_point(Y, b, after, p), times(B, now))
            factor_block(B, size[k], n, A)
            solved, _ = point_impulse(B, A, r, mu[p], p, sigma, False, constraints is not None)
            force[k], force[k + 1], force[k + 2] = solved.x, solved.y, solved.z
            push(Z, k, solved.x - now.x, after)
            push(Z, k + 1, solved.y - now.y, after)
            push(Z, k + 2, solved.z - now.z, after)
        for j in range(joints):
            k = 3 * points + j
            alone, was = product(Y, Z, k, k), force[k]
            free = velocity(Y, b, after, k) - alone * was
            wanted, rests[j], _ = joint_law(contacts[1 + points + j], q, dt, free, alone * level[j])
            force[k] = (wanted - free) * inverse(alone, size[k], n)
            push(Z, k, force[k] - was, after)
    for p in range(points):
        write_block(Y, Z, p, B)
        write_point(contacts, heights, Y, b, before, after, force, B, S, mu, p, impulse, residual, energy)
    for j in range(joints):
        k, c = 3 * points + j, contacts[1 + points + j]
        alone, u = product(Y, Z, k, k), velocity(Y, b, after, k)
        wanted, _, _ = joint_law(c, q, dt, u - alone * force[k], alone * level[j])
        residual[points + j] = magnitude(u - wanted)
        rubs, least = within(force[k], level[j]), SLOW * alone * level[j]
        rubs = select(u - least, -level[j], select(-least - u, level[j], rubs))  # of a joint that moves, against that
        rests[j] = select(least - magnitude(u), 1.0, rests[j])
        friction[c.row - 1] = rubs / dt
        if j < contacts[0].nl:
            stop[j] = force[k] - rubs
            energy[points + j] = work_of_row(Y, before, after, k, stop[j])
    if constraints is not None:
        for k in range(len(reaction)):
            for l in range(rows):
                reaction[k] = reaction[k] + P[l, k] * force[l]
    solve_outward(bodies, L, after)
    for i in range(n):
        after[i] = v[i] + after[i]
    for j in range(joints):
        i = contacts[1 + points + j].row - 1
        after[i] = select(rests[j], 0.0, after[i])
    if z is not None:
        for i in range(n):
            bristles[i] = (z[i] + dt * after[i]) * bristles[i]


@inline
def scale_of_point(size: Vector, p: int, k: int) -> None:
    """The trace of a point's block in place of each of its entries, once the last of them is there."""
    if k == 3 * p + 2:
        total = size[3 * p] + size[3 * p + 1] + size[k]
        size[3 * p], size[3 * p + 1], size[k] = total, total, total


@inline
def hold(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Number, constraints: Record, rate: Number, L: Matrix,
    Z: Matrix, w: Vector, reaction: Vector, missed: Vector, N: Matrix, G: Matrix, gamma: Vector, scale: Vector,
    kept: Vector, P: Matrix,
) -> None:  # fmt: skip
    """Take constraints out: of w, and of Z = D⁻¹ Yᵀ, by which w changes with impulses; rows that depend are dropped.

    As ``constrained.respond``, whose meaning residual and rank have; w, Z, reaction, missed and P are written.
    """
    n, m = len(bodies) - 1, len(gamma)
    turn_rows(bodies, work)
    write_jacobian(bodies, work, constraints, N)
    write_drift(bodies, work, constraints, v, gamma)
    if rate is not None:
        stabilize(bodies, work, q, v, constraints, rate, N, gamma, reaction)
    for k in range(m):
        gamma[k] = dt * gamma[k]
        if rate is None:
            for i in range(n):
                gamma[k] = gamma[k] + N[k, i] * v[i]
    felt(bodies, L, N, G)
    for k in range(m):
        scale[k] = G[k, k]
    share(constraints, scale)
    factor_dropping(G, scale, DEPENDENT * (n + m) * EPS, kept)

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
        lost = lost + (1.0 - kept[k]) * quotient(square, scale[k])
        rank = rank + kept[k]
    missed[0], missed[1] = sqrt(quotient(lost, lost + whole)), rank
    solve_backward(G, gamma, reaction)
    for i in range(n):
        for k in range(m):
            w[i] = w[i] + N[k, i] * reaction[k] * (1.0 / L[i, i])
    for l in range(len(Z)):
        for k in range(m):
            gamma[k] = 0.0
            for i in range(n):
                gamma[k] = gamma[k] - N[k, i] * Z[l, i]
        solve_forward(G, gamma)
        solve_backward(G, gamma, P[l])
        for i in range(n):
            s = 0.0
            for k in range(m):
                s = s + N[k, i] * P[l, k]
            Z[l, i] = Z[l, i] + s * (1.0 / L[i, i])


@inline
def meet(
    bodies: Bodies, work: Work, q: Config, v: Vector, dt: Number, constraints: Record, L: Matrix, w: Vector,
    reaction: Vector, N: Matrix, G: Matrix, gamma: Vector, change: Vector, J: Matrix, ways: Matrix, ends: Matrix,
) -> None:  # fmt: skip
    """Let v⁺ meet J v⁺ = 0 where the step ends, with q projected, and not only J v⁺ + h J̇ v = 0 where it begins.

    The two differ by the order of h² in smooth motion and of h in an impact; what is left here is one order less. The
    last sweeps follow, in which points and dry joints answer to the change. w and reaction are written; N and G are of
    ``hold``, the rest is scratch.
    """
    n, m, way, out = len(bodies) - 1, len(gamma), ways[0], ways[1]
    for i in range(n):
        way[i] = w[i]
    solve_outward(bodies, L, way)
    for i in range(n):
        way[i] = dt * (v[i] + way[i])
    integrate(bodies, q, way, ends[0])
    place_rows(bodies, work, ends[0])
    write_error(bodies, work, constraints, ends[0], gamma)
    for i in range(n):
        out[i] = 0.0
    push_back(L, N, G, gamma, change, out)
    solve_outward(bodies, L, out)
    integrate(bodies, ends[0], out, ends[1])
    place_rows(bodies, work, ends[1])
    write_jacobian(bodies, work, constraints, J)
    for k in range(m):
        gamma[k] = 0.0
        for i in range(n):
            gamma[k] = gamma[k] + J[k, i] * (way[i] / dt)
    push_back(L, N, G, gamma, change, w)
    for k in range(m):
        reaction[k] = reaction[k] + change[k]


@inline
def push_back(L: Matrix, N: Matrix, G: Matrix, gamma: Vector, change: Vector, w: Vector) -> None:
    """Take gamma (nc) out of the constraints' velocities, in w, by the impulses ``change`` (nc), which are written."""
    for k in range(len(gamma)):
        gamma[k] = -gamma[k]
    solve_forward(G, gamma)
    solve_backward(G, gamma, change)
    for i in range(len(w)):
        for k in range(len(gamma)):
            w[i] = w[i] + N[k, i] * change[k] * (1.0 / L[i, i])


# --- a row at its turn ----------------------------------------------------------------------------------


@inline
def look(T: Matrix, held: Vector, x: Vector, y: Vector, soft: Vector, k: int, count: int, B: Matrix, C: Matrix) -> None:
    """B and C of ``open_rows``, without the rows' own yielding; rows 3 and 4 of B are velocities and impulses now.

    x, y  (m)  of a free row velocity and impulse, of a held one -impulse and velocity, yielding counted
    """
    open_rows(T, held, k, count, B, C)
    for a in range(count):
        h = held[k + a]
        B[4, a] = select(h, -x[k + a], y[k + a])
        B[3, a] = select(h, y[k + a], x[k + a]) - soft[k + a] * B[4, a]
        B[a, a] = B[a, a] - soft[k + a]


@inline
def act(
    T: Matrix, held: Vector, x: Vector, y: Vector, soft: Vector, size: Vector, n: int, k: int, count: int, B: Matrix,
    C: Matrix, r: Vec, solved: Vec, stays: Scalar, column: Vector,
) -> None:  # fmt: skip
    """New impulses of rows that were looked at, and what they change; they are held, or not, from now on.

    r      their velocities without impulses of their own
    stays  1 if they are to be held, else 0; a row that nothing moves is not
    """
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
        h = stays * exceeds(soft[k + a], (DEPENDENT * YIELD * n) * EPS * size[k + a])
        x[k + a] = select(h, -new, u)
        y[k + a] = select(h, u, new)
        turn_row(T, k + a, h + held[k + a] - 2.0 * (h * held[k + a]), held[k + a], column)
        held[k + a] = h


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

    def given(what: str, *arguments: Argument) -> tuple[Argument | None, ...]:
        return tuple(replace(x, optional=False) if what in has else None for x in arguments)

    inputs = (
        Q, V, *given(BENDS, BRISTLES), TAU, *given(PUSHED, FEXT), DT, CONTACTS_ARGUMENT, *given(OVER, HEIGHTS_ARGUMENT),
        MU, RESTITUTION, *given(RUBS, *LAW), *given(BENDS, STIFFNESS, DAMPING), *given(HOLDS, CONSTRAINTS_ARGUMENT),
        *given(STEADIES, RATE),
    )  # fmt: skip
    nc: str | int = "nc" if HOLDS in has else 0
    ends: str | int = "nq" if HOLDS in has and STEADIES not in has else 0
    rows = "np+np+np+nl+nd"
    parts = (
        AFTER, IMPULSE, GAP, STOP, RESIDUAL, ENERGY, FRICTION,
        Argument("bristles", ("nv" if BENDS in has else 0,), "rad | m", "after the step"),
        replace(REACTION, shape=(nc,)), replace(MISSED, shape=(2 if HOLDS in has else 0,)),
    )  # fmt: skip
    width = "+".join(str(x) for part in parts for x in part.shape if x)
    return Spec(
        "_".join(["impulse_step", *(x for x in ALL if x in has)]), impulse_step, WORK, inputs,
        Argument("result", (width,), "", ", ".join(x.name for x in parts)),
        "A step of the velocities under contact, limits, dry friction and constraints.",
        "see ``recursions.impulse_step``", pivots=True, regroup=True, composed=True,
        scratch=(
            ("nv", "nv"), (rows, "nv"), (rows, "nv"), (rows,), (rows,), (rows,), ("np", 3, 3), ("np",), (rows, rows),
            (rows,), (rows,), (rows,), (rows,), (rows,), (rows,), (5, 3), (rows, 3), (5, 3), ("nl+nd",), ("nl+nd",),
            (nc, "nv"), (nc, nc), (nc,), (nc,), (nc,), (rows, nc), (nc, "nv"), (2, "nv"), (2, ends),
        ),
        parts=parts,
    )  # fmt: skip

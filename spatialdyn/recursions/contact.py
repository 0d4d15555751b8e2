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

Sources: after Jean, The non-smooth contact dynamics method (1999), for the step; Le Lidec et al., Contact models in
robotics: a comparative analysis (2023), for the law and its residual; the solution of a sliding point is our own.
"""

from __future__ import annotations

from ..algebra.euclidean import Mat3, Vec, add, cross, rotate, sub, unrotate
from ..algebra.records import mat3_of, motion_of, put_mat3, table_dtype, vec_of
from ..algebra.scalars import EPS, Scalar, inline, select, sqrt
from ..algebra.spatial import Force, Inertia, Pose
from ..bodies.contact_table import CONTACTS
from ..bodies.joints import place_joint
from .constrained import DEPENDENT, felt
from .constraint_rows import carry_axes
from .crba import crba
from .dense import factor_dropping, quotient, solve_backward, solve_forward
from .friction import DT
from .ltdl import factor_tree, solve_inward, solve_outward
from .rnea import rnea
from .signatures import Array, Bodies, Config, Matrix, Number, Record, Vector, Work
from .spec import FEXT_OPTIONAL, TAU, Argument, Q, Spec, V

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

TURNS = 3  # of the direction in which a point slides, in each sweep
LEAST = 0.1  # of G_nn: the least of what resists along a sliding point's impulse; beyond, friction jams the point
RISE = 0.2  # of its depth that a point in the ground comes out in a step
BOUNCING = 1e-2  # [m/s] speed of approach from which a point bounces: slower ones come to rest


@inline
def contact_step(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, dt: Number, contacts: Record,
    mu: Vector, restitution: Vector, after: Vector, impulse: Vector, gap: Vector, stop: Vector, residual: Vector,
    pivots: Vector, L: Matrix, Y: Matrix, G: Matrix, b: Vector, force: Vector, C: Array, size: Vector, kept: Vector,
    y: Vector, x: Vector,
) -> None:  # fmt: skip
    """Velocities after a step, impulses, gaps before it, and what the impulses leave of the law.

    restitution  (np) may be None, for points that do not bounce
    after        (nv), written: v⁺
    impulse      (3 np), written: on each point, in the world's axes
    gap          (np), written: distance of each sphere from the ground before the step, negative in it
    stop         (nl), written: impulse on each joint, positive from its lower limit
    residual     (np + nl), written: by how much each point and joint misses its law [m/s | rad/s]
    all that follows is scratch: b and force of 3 np + nl numbers, normals first
    """
    n, points, limits = len(bodies) - 1, contacts[0].np, contacts[0].nl
    crba(bodies, work, q, L)
    factor_tree(bodies, L)
    rnea(bodies, work, q, v, None, fext, after)
    put_mat3(work[0].R, mat3_of(contacts[0].axes))
    carry_axes(bodies, work)
    write_gaps(bodies, work, contacts, gap)
    write_rows(bodies, work, contacts, Y)
    for k in range(len(b)):
        s = 0.0
        for i in range(n):
            s = s + Y[k, i] * v[i]
        b[k] = s
        force[k] = 0.0

    # G, and b with its targets
    for i in range(n):
        pivots[i] = L[i, i]
        after[i] = dt * (tau[i] - after[i])
    felt(bodies, L, Y, G)
    solve_inward(bodies, L, after)
    for i in range(n):
        after[i] = after[i] * (1.0 / L[i, i])
    for k in range(len(b)):
        for l in range(k):
            G[l, k] = G[k, l]
        before = b[k]
        for i in range(n):
            b[k] = b[k] + Y[k, i] * after[i]
        if k < 3 * points and k % 3 == 0:
            p = k // 3
            c = target(gap[p], dt)
            if restitution is not None:
                c = bounced(c, gap[p], before, b[k], dt, restitution[p])
            b[k] = b[k] + c
    for p in range(points):
        factor_block(G, p, n, C[p], size, kept)

    # λ
    for _ in range(contacts[0].sweeps):
        for l in range(limits):
            k = 3 * points + l
            wanted = stopping(contacts[1 + points + l], q, dt, velocity(G, b, force, k, k, k + 1))
            force[k] = wanted * (1.0 / G[k, k])
        for p in range(points):
            k = 3 * p
            r = Vec(
                velocity(G, b, force, k, k, k + 3),
                velocity(G, b, force, k + 1, k, k + 3),
                velocity(G, b, force, k + 2, k, k + 3),
            )
            solved = point_impulse(G, p, C[p], r, mu[p], Vec(force[k], force[k + 1], force[k + 2]), y, x)
            force[k], force[k + 1], force[k + 2] = solved.x, solved.y, solved.z

    for p in range(points):
        k = 3 * p
        f = Vec(force[k], force[k + 1], force[k + 2])
        u = Vec(velocity(G, b, force, k, 0, 0), velocity(G, b, force, k + 1, 0, 0), velocity(G, b, force, k + 2, 0, 0))
        residual[p] = point_residual(G, p, u, mu[p], f)
        f = unrotate(mat3_of(contacts[0].axes), f)
        impulse[k], impulse[k + 1], impulse[k + 2] = f.x, f.y, f.z
    for l in range(limits):
        k = 3 * points + l
        pushed = G[k, k] * force[k]
        wanted = stopping(contacts[1 + points + l], q, dt, velocity(G, b, force, k, k, k + 1))
        residual[points + l] = magnitude(pushed - wanted)
        stop[l] = force[k]

    # v⁺ = v + L⁻¹ D⁻¹ (h L⁻ᵀ (τ - bias) + Yᵀ λ)
    for i in range(n):
        s = 0.0
        for k in range(len(b)):
            s = s + Y[k, i] * force[k]
        after[i] = after[i] + s * (1.0 / L[i, i])
    solve_outward(bodies, L, after)
    for i in range(n):
        after[i] = v[i] + after[i]


# --- geometry -------------------------------------------------------------------------------------------


@inline
def contact_gaps(bodies: Bodies, work: Work, q: Config, contacts: Record, gap: Vector) -> None:
    """Distance of each sphere from the ground, gap (np)."""
    for i in range(1, len(bodies)):
        place_joint(bodies, i, q, work[i].X)
    put_mat3(work[0].R, mat3_of(contacts[0].axes))
    carry_axes(bodies, work)
    write_gaps(bodies, work, contacts, gap)


@inline
def write_gaps(bodies: Bodies, work: Work, contacts: Record, gap: Vector) -> None:
    """gap (np), from R and o of every row."""
    for p in range(contacts[0].np):
        c = contacts[1 + p]
        i = c.row
        at = rotate(mat3_of(work[i].R), vec_of(c.p)).x
        while i > 0:
            at = at + work[i].o.x
            i = bodies[i].parent
        gap[p] = at - (contacts[0].height + c.radius)


@inline
def write_rows(bodies: Bodies, work: Work, contacts: Record, J: Matrix) -> None:
    """J (3 np + nl, nv) of the lowest points, in the ground's axes, then of joints; from R and o of every row."""
    points = contacts[0].np
    for k in range(len(J)):
        for i in range(len(bodies) - 1):
            J[k, i] = 0.0
    for p in range(points):
        c = contacts[1 + p]
        i = c.row
        to = sub(rotate(mat3_of(work[i].R), vec_of(c.p)), Vec(c.radius, 0.0, 0.0))  # from row i's origin
        while i > 0:
            S, R = motion_of(bodies[i].S), mat3_of(work[i].R)
            u = add(rotate(R, S.v), cross(rotate(R, S.w), to))
            J[3 * p, i - 1], J[3 * p + 1, i - 1], J[3 * p + 2, i - 1] = u.x, u.y, u.z
            to = add(to, vec_of(work[i].o))
            i = bodies[i].parent
    for l in range(contacts[0].nl):
        J[3 * points + l, contacts[1 + points + l].row - 1] = 1.0


# --- the law --------------------------------------------------------------------------------------------


@inline
def target(gap: Scalar, dt: Number) -> Scalar:
    """c of a point's normal: u_n + c is 0 where it just reaches the ground, or rises out of it."""
    return select(gap, gap, RISE * gap) / dt


@inline
def bounced(c: Scalar, gap: Scalar, before: Scalar, free: Scalar, dt: Number, restitution: Number) -> Scalar:
    """c of a point that bounces if it reaches the ground within the step, fast enough: it leaves at e times its speed.

    before, free  velocities of its normal before the step, and after it without impulses
    """
    fast = select(-before - BOUNCING, select(restitution, restitution * before, c), c)
    return select(-(gap / dt + free), fast, c)


@inline
def velocity(G: Matrix, b: Vector, force: Vector, k: int, first: int, end: int) -> Scalar:
    """b_k + Σ G_kj λ_j over all j that are not first .. end - 1."""
    s = b[k]
    for j in range(len(b)):
        if j < first or j >= end:
            s = s + G[k, j] * force[j]
    return s


@inline
def magnitude(x: Scalar) -> Scalar:
    """|x|."""
    return select(x, x, -x)


@inline
def stopping(c: Record, q: Config, dt: Number, free: Scalar) -> Scalar:
    """By how much the velocity of a joint has to change so that it does not pass its limits within the step."""
    above, below = q[c.q_index] - c.lower, c.upper - q[c.q_index]
    least = -select(above, above, RISE * above) / dt
    most = select(below, below, RISE * below) / dt
    return select(least - free, least - free, 0.0) - select(free - most, free - most, 0.0)


@inline
def factor_block(G: Matrix, p: int, n: int, C: Matrix, size: Vector, kept: Vector) -> None:
    """C (3, 3), the factors of a point's own block of G; directions in which it cannot move drop out."""
    total = G[3 * p, 3 * p] + G[3 * p + 1, 3 * p + 1] + G[3 * p + 2, 3 * p + 2]
    for i in range(3):
        size[i] = total
        for j in range(3):
            C[i, j] = G[3 * p + i, 3 * p + j]
    factor_dropping(C, size, DEPENDENT * (n + 3) * EPS, kept)


@inline
def largest_eigenvalue(G: Matrix, p: int) -> Scalar:
    """Of the block of G across a point's normal."""
    half = 0.5 * (G[3 * p + 1, 3 * p + 1] - G[3 * p + 2, 3 * p + 2])
    across = G[3 * p + 1, 3 * p + 2]
    return 0.5 * (G[3 * p + 1, 3 * p + 1] + G[3 * p + 2, 3 * p + 2]) + sqrt(half * half + across * across)


@inline
def point_impulse(G: Matrix, p: int, C: Matrix, r: Vec, mu: Number, now: Vec, y: Vector, x: Vector) -> Vec:
    """λ of one point under the velocity r that it has without an impulse of its own.

    C    the factors of its block of G
    now  its impulse so far, from which the direction of sliding is sought
    y, x are scratch
    """
    k = 3 * p
    y[0], y[1], y[2] = -r.x, -r.y, -r.z
    solve_forward(C, y)
    solve_backward(C, y, x)
    stick = Vec(x[0], x[1], x[2])
    pressed = mu * select(stick.x, stick.x, 0.0)
    inside = pressed * pressed - (stick.y * stick.y + stick.z * stick.z)

    step = quotient(1.0, largest_eigenvalue(G, p))
    slide = now
    for _ in range(TURNS):
        a = slide.y - step * (r.y + G[k + 1, k] * slide.x + G[k + 1, k + 1] * slide.y + G[k + 1, k + 2] * slide.z)
        c = slide.z - step * (r.z + G[k + 2, k] * slide.x + G[k + 2, k + 1] * slide.y + G[k + 2, k + 2] * slide.z)
        s = sqrt(a * a + c * c)
        least = LEAST * G[k, k] * s
        resists = G[k, k] * s + mu * (G[k, k + 1] * a + G[k, k + 2] * c)
        resists = select(resists - least, resists, least)
        g = -r.x / select(resists, resists, 1.0)
        slide = Vec(g * s, mu * g * a, mu * g * c)

    return Vec(
        select(-r.x, select(inside, stick.x, slide.x), 0.0),
        select(-r.x, select(inside, stick.y, slide.y), 0.0),
        select(-r.x, select(inside, stick.z, slide.z), 0.0),
    )


@inline
def point_residual(G: Matrix, p: int, u: Vec, mu: Number, f: Vec) -> Scalar:
    """How far λ is from the projection onto the law of what it would be, in units of velocity: 0 if it is met.

    u  velocity after the step, along the normal with its target
    """
    pushed = G[3 * p, 3 * p] * f.x
    normal = magnitude(select(u.x - pushed, pushed, u.x))
    largest = largest_eigenvalue(G, p)
    a, c = f.y - quotient(u.y, largest), f.z - quotient(u.z, largest)
    s = sqrt(a * a + c * c)
    share = select(s - mu * f.x, mu * f.x / select(s, s, 1.0), 1.0)
    a, c = f.y - share * a, f.z - share * c
    across = largest * sqrt(a * a + c * c)
    return select(normal - across, normal, across)


CONTACTS_ARGUMENT = Argument("contacts", (), "", "what may touch", static=True, table=CONTACTS, sizes=("np", "nl"))
MU = Argument("mu", ("np",), "1", "coefficient of friction of each point")
RESTITUTION = Argument("restitution", ("np",), "1", "of each point, from 0 to 1", optional=True)
IMPULSE = Argument("impulse", ("np+np+np",), "N s", "on each point, in the world's axes")
GAP = Argument("gap", ("np",), "m", "distance from the ground before the step, negative in it")
STOP = Argument("stop", ("nl",), "N m s | N s", "on each joint with limits, positive from the lower one")
RESIDUAL = Argument("residual", ("np+nl",), "m/s | rad/s", "by how much each point and joint misses its law")
_ROWS = "np+np+np+nl"
CONTACT_STEP = Spec(
    "contact_step", contact_step, WORK, (Q, V, TAU, FEXT_OPTIONAL, DT, CONTACTS_ARGUMENT, MU, RESTITUTION),
    Argument("result", ("nv+np+np+np+np+np+nl+nl",), "", "v, impulse, gap, stop, residual"),
    "A step of the velocities under contact with Coulomb friction.", "see ``recursions.contact``",
    pivots=True, regroup=True,
    scratch=(("nv", "nv"), (_ROWS, "nv"), (_ROWS, _ROWS), (_ROWS,), (_ROWS,), ("np", 3, 3), (3,), (3,), (3,), (3,)),
    parts=(Argument("v", ("nv",), "rad/s | m/s", "after the step"), IMPULSE, GAP, STOP, RESIDUAL),
)  # fmt: skip
CONTACT_GAPS = Spec(
    "contact_gaps", contact_gaps, PLACES, (Q, CONTACTS_ARGUMENT),
    Argument("gap", ("np",), "m", "distance from the ground, negative in it"),
    "Distances of contact points from the ground.", "see ``recursions.contact``",
)  # fmt: skip

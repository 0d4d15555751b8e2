"""Motion under a table of constraints: M a = τ - bias + Jᵀ λ and J a + γ = 0, rows that depend on others dropped.

With M = LᵀD L as sparse as the tree, Y = J L⁻¹ takes one sweep towards the root for each row of J, and the inverse
inertia that the constraints feel is G = Y D⁻¹ Yᵀ (Delassus' matrix). The pivot of a row in G is what is left of it once
the rows before are taken out. It is compared with the trace of G over the constraint's own equations, which no choice
of axes or units changes: one equation of a planar loop may be nothing but rounding.

Where a row may depend on others, and a pivot is not clear of 0, rows are to be chosen first (``independent_rows``), and
given: the residual is then at least UNSURE. In a motion they are chosen at the beginning of a step and kept through its
stages, which leave the constraints by the error of the step, so that no pivot is rounding there.
"""

from __future__ import annotations

from dataclasses import replace

from ..algebra.euclidean import Mat3, Vec
from ..algebra.records import table_dtype
from ..algebra.scalars import EPS, exceeds, inline, sqrt
from ..algebra.spatial import Force, Inertia, Pose
from ..bodies.constraint_table import TERM
from .constraint_rows import CONSTRAINTS_ARGUMENT, turn_rows, write_drift, write_error, write_jacobian
from .crba import crba
from .dense import choose_rows, factor_chosen, factor_dropping, quotient, solve_backward, solve_forward
from .ltdl import factor_tree, solve_inward, solve_outward
from .rnea import rnea
from .signatures import Bodies, Config, Matrix, Number, Record, Vector, Work
from .spec import FEXT_OPTIONAL, TAU, A, Argument, Q, Spec, V

WORK = table_dtype(
    X=Pose,  # of crba, then of rnea
    Ic=Inertia,  # of crba
    w=Vec,  # of rnea, as are the fields that follow
    dw=Vec,
    dv=Vec,
    f=Force,
    R=Mat3,  # of constraint_rows, as is the field that follows
    o=Vec,
)
DEPENDENT = 16.0  # times eps and the number of terms in a pivot: what rounding leaves of a dependent row
CLEAR = 1e-4  # relative pivot above which a row in its given order is far from those before it
TINY = 1e-7  # relative pivot below which a row may depend on others but for what a pivot that is not clear adds to it
UNSURE = 2.0  # added to a residual, itself at most 1, where a row may depend on others and a pivot is not clear
RISEN = 1e-6  # relative pivot of a row left out that is no error of a step: 1e-3 rad from a branch point


@inline
def constrained_motion(
    bodies: Bodies,
    work: Work,
    q: Config,
    v: Vector,
    tau: Vector,
    fext: Matrix,
    constraints: Record,
    rate: Vector,
    chosen: Vector,
    a: Vector,
    force: Vector,
    residual: Vector,
    rank: Vector,
    pivots: Vector,
    L: Matrix,
    Y: Matrix,
    G: Matrix,
    gamma: Vector,
    error: Vector,
    size: Vector,
    kept: Vector,
) -> None:
    """a (nv) and λ = force (nc) under J a + γ = 0; with a rate 1/T, J a + γ + 2 J v / T + φ / T² = 0.

    residual (1)  of the rows that dropped out, relative: 0 if they agree with the others
    rank (1)      how many rows are independent
    L, Y, G, gamma, error, size and kept are scratch; fext, rate and chosen, of ``independent_rows``, may be None
    """
    n = len(bodies) - 1
    crba(bodies, work, q, L)
    factor_tree(bodies, L)
    rnea(bodies, work, q, v, None, fext, a)
    turn_rows(bodies, work)
    write_jacobian(bodies, work, constraints, Y)
    write_drift(bodies, work, constraints, v, gamma)
    if rate is not None:
        stabilize(bodies, work, q, v, constraints, rate, Y, gamma, error)
    for i in range(n):
        pivots[i] = L[i, i]
        a[i] = tau[i] - a[i]
    respond(bodies, constraints, chosen, L, Y, G, gamma, size, kept, a, force, residual, rank)


@inline
def stabilize(
    bodies: Bodies, work: Work, q: Config, v: Vector, constraints: Record, rate: Number, J: Matrix, gamma: Vector,
    error: Vector,
) -> None:  # fmt: skip
    """gamma (nc) + 2 J v / T + φ / T² in place, with rate 1/T; error (nc), written: φ."""
    write_error(bodies, work, constraints, q, error)
    for k in range(len(gamma)):
        Jv = 0.0
        for i in range(len(bodies) - 1):
            Jv = Jv + J[k, i] * v[i]
        gamma[k] = gamma[k] + rate * (2.0 * Jv + rate * error[k])


@inline
def constraint_response(
    bodies: Bodies,
    work: Work,
    q: Config,
    rhs: Vector,
    constraints: Record,
    chosen: Vector,
    change: Vector,
    force: Vector,
    residual: Vector,
    rank: Vector,
    pivots: Vector,
    L: Matrix,
    Y: Matrix,
    G: Matrix,
    gamma: Vector,
    size: Vector,
    kept: Vector,
) -> None:
    """The least change x of velocities (nv), in kinetic energy, with J x = rhs (nc), and its impulse: M x = Jᵀ force.

    chosen, residual (1) and rank (1) as of ``constrained_motion``; L, Y, G, gamma, size and kept are scratch.
    """
    crba(bodies, work, q, L)
    factor_tree(bodies, L)
    turn_rows(bodies, work)
    write_jacobian(bodies, work, constraints, Y)
    for i in range(len(bodies) - 1):
        pivots[i] = L[i, i]
        change[i] = 0.0
    for k in range(len(gamma)):
        gamma[k] = -rhs[k]
    respond(bodies, constraints, chosen, L, Y, G, gamma, size, kept, change, force, residual, rank)


@inline
def independent_rows(
    bodies: Bodies, work: Work, q: Config, constraints: Record, known: Number, chosen: Vector, rank: Vector,
    pivots: Vector, L: Matrix, Y: Matrix, G: Matrix, size: Vector, column: Vector, best: Vector,
) -> None:  # fmt: skip
    """Equations to keep, chosen (nc) of 1 and 0, by elimination with the largest pivot; rank (1), how many.

    With a known rank at most so many are kept, and the rank is larger where one that is left out is above RISEN. L, Y,
    G, size, column and best are scratch.
    """
    n, m = len(bodies) - 1, len(chosen)
    crba(bodies, work, q, L)
    factor_tree(bodies, L)
    turn_rows(bodies, work)
    write_jacobian(bodies, work, constraints, Y)
    for i in range(n):
        pivots[i] = L[i, i]
    felt(bodies, L, Y, G)
    for k in range(m):
        size[k] = G[k, k]
    share(constraints, size)
    most = float(m) if known is None else known
    count, spare = choose_rows(G, size, DEPENDENT * (n + m) * EPS, most, chosen, column, best)
    rank[0] = count if known is None else count + exceeds(spare, RISEN)


@inline
def delassus(
    bodies: Bodies, work: Work, q: Config, constraints: Record, G: Matrix, pivots: Vector, L: Matrix, Y: Matrix
) -> None:
    """G = J M⁻¹ Jᵀ (nc, nc); L and Y are scratch."""
    crba(bodies, work, q, L)
    factor_tree(bodies, L)
    turn_rows(bodies, work)
    write_jacobian(bodies, work, constraints, Y)
    for i in range(len(bodies) - 1):
        pivots[i] = L[i, i]
    felt(bodies, L, Y, G)
    for k in range(len(G)):
        for l in range(k):
            G[l, k] = G[k, l]


@inline
def felt(bodies: Bodies, L: Matrix, Y: Matrix, G: Matrix) -> None:
    """Y = J L⁻¹ in place of J, and the lower triangle of G = Y D⁻¹ Yᵀ."""
    n = len(bodies) - 1
    for k in range(len(G)):
        solve_inward(bodies, L, Y[k])
        for l in range(k + 1):
            s = 0.0
            for i in range(n):
                s = s + Y[k, i] * (Y[l, i] * (1.0 / L[i, i]))
            G[k, l] = s


@inline
def respond(
    bodies: Bodies,
    constraints: Record,
    chosen: Vector,
    L: Matrix,
    Y: Matrix,
    G: Matrix,
    gamma: Vector,
    size: Vector,
    kept: Vector,
    x: Vector,
    force: Vector,
    residual: Vector,
    rank: Vector,
) -> None:
    """Solve M x = r + Jᵀ λ, J x + γ = 0 for x, in place of r, and λ = force.

    For a dropped row, what the solution leaves of J x + γ is measured in the norm of G, as are the accelerations
    x₀ = M⁻¹ r and M⁻¹ Jᵀ λ: residual² is its share of the sum of squares, between 0 and 1 in any units. To it UNSURE is
    added where rows should be chosen.

    chosen  (nc) 1 for the rows that are kept, 0 for those that are dropped; None: all but those of pivots near 0
    L       of M, as of ``factor_tree``
    Y       J, written: J L⁻¹
    G, size, kept are scratch; gamma is written: what is left of dropped rows
    """
    n, m = len(bodies) - 1, len(gamma)
    felt(bodies, L, Y, G)
    for k in range(m):
        size[k] = G[k, k]
    share(constraints, size)
    unsure = 0.0
    if chosen is None:
        factor_dropping(G, size, DEPENDENT * (n + m) * EPS, kept)
        small, tiny = 0.0, 0.0
        for k in range(m):
            inverse = G[k, k] * size[k]
            small = small + kept[k] * (1.0 - exceeds(1.0 / CLEAR - inverse, 0.0))
            tiny = tiny + 1.0 - kept[k] * exceeds(1.0 / TINY - inverse, 0.0)
        unsure = exceeds(small * tiny, 0.0)
    else:
        for k in range(m):
            kept[k] = chosen[k]
        factor_chosen(G, kept)

    # G λ = -γ - Y D⁻¹ L⁻ᵀ r
    solve_inward(bodies, L, x)
    energy = 0.0
    for i in range(n):
        t = x[i] * (1.0 / L[i, i])
        energy = energy + x[i] * t
        x[i] = t
    for k in range(m):
        y = -gamma[k]
        for i in range(n):
            y = y - Y[k, i] * x[i]
        gamma[k] = y
        force[k] = y
    solve_forward(G, force)
    count = 0.0
    for k in range(m):
        energy = energy + force[k] * force[k] * G[k, k]
        count = count + kept[k]
    if chosen is None:
        for k in range(m):
            gamma[k] = force[k]
    solve_backward(G, force, force)
    rank[0] = count

    # x = L⁻¹ D⁻¹ (L⁻ᵀ r + Yᵀ λ)
    for i in range(n):
        s = 0.0
        for k in range(m):
            s = s + Y[k, i] * force[k]
        s = s * (1.0 / L[i, i])
        if chosen is not None:
            for k in range(m):
                gamma[k] = gamma[k] - Y[k, i] * s
        x[i] = x[i] + s
    lost = 0.0
    for k in range(m):
        lost = lost + (1.0 - kept[k]) * quotient(gamma[k] * gamma[k], size[k])
    residual[0] = sqrt(quotient(lost, lost + energy)) + UNSURE * unsure
    solve_outward(bodies, L, x)


@inline
def share(constraints: Record, x: Vector) -> None:
    """The sum of x over each constraint's equations, in place of each of them."""
    for m in range(1, len(constraints)):
        c = constraints[m]
        if c.kind != TERM:
            total = 0.0
            for k in range(c.count):
                total = total + x[c.first + k]
            for k in range(c.count):
                x[c.first + k] = total


FORCE = Argument("force", ("nc",), "N | N m", "of each equation, on frame a, in b's axes")
IMPULSE = Argument("impulse", ("nc",), "N s | N m s", "of each equation, on frame a, in b's axes")
RESIDUAL = Argument("residual", (), "1", "of equations that depend on others: 0 if they agree with them")
RANK = Argument("rank", (), "1", "how many equations are independent")
CHANGE = Argument("change", ("nv",), "rad/s | m/s", "change of the joint velocities")
RHS = Argument("rhs", ("nc",), "m/s | rad/s", "wanted change of J v")
RATE = Argument("rate", (), "1/s", "1/T of the stabilization", optional=True)
CHOSEN = Argument("chosen", ("nc",), "1", "1 for equations to keep, of independent_rows", optional=True)
KNOWN = Argument("rank", (), "1", "how many equations are independent, if it is known", optional=True)
_SOURCE = "after Featherstone, RBDA (2008), section 8.1, with M factored as sparse as the tree."
_DENSE = (("nv", "nv"), ("nc", "nv"), ("nc", "nc"))
MOTION = Spec(
    "constrained_motion", constrained_motion, WORK, (Q, V, TAU, FEXT_OPTIONAL, CONSTRAINTS_ARGUMENT, RATE, CHOSEN),
    Argument("result", ("nv+nc+2",), "", "a, force, residual, rank"),
    "Forward dynamics under constraints: a, their forces, residual and rank.", _SOURCE,
    pivots=True, regroup=True, scratch=(*_DENSE, ("nc",), ("nc",), ("nc",), ("nc",)),
    parts=(A, FORCE, RESIDUAL, RANK),
)  # fmt: skip
RESPONSE = Spec(
    "constraint_response", constraint_response, WORK, (Q, RHS, CONSTRAINTS_ARGUMENT, CHOSEN),
    Argument("result", ("nv+nc+2",), "", "change, impulse, residual, rank"),
    "The least change of velocities that changes J v by rhs, its impulses, residual and rank.", _SOURCE,
    pivots=True, regroup=True, scratch=(*_DENSE, ("nc",), ("nc",), ("nc",)),
    parts=(CHANGE, IMPULSE, RESIDUAL, RANK),
)  # fmt: skip
ROWS = Spec(
    "independent_rows", independent_rows, WORK, (Q, CONSTRAINTS_ARGUMENT, KNOWN),
    Argument("result", ("nc+1",), "", "chosen, rank"),
    "Equations to keep, by elimination with the largest pivot, and how many are independent.", _SOURCE,
    pivots=True, regroup=True, scratch=(*_DENSE, ("nc",), ("nc",), ("nc",)),
    parts=(replace(CHOSEN, optional=False), RANK),
)  # fmt: skip
DELASSUS = Spec(
    "delassus", delassus, WORK, (Q, CONSTRAINTS_ARGUMENT),
    Argument("G", ("nc", "nc"), "1/kg | 1/(kg m²)", "inverse inertia that the constraints feel, symmetric"),
    "Delassus' matrix G = J M⁻¹ Jᵀ of constraints.", _SOURCE,
    pivots=True, regroup=True, scratch=(("nv", "nv"), ("nc", "nv")),
)  # fmt: skip

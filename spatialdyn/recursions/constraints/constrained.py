"""Motion under a table of constraints: M a = τ - bias + Jᵀ λ and J a + γ = 0, rows that depend on others dropped.

With M = LᵀD L as sparse as the tree, Y = J L⁻¹ takes one sweep towards the root for each row of J, and the inverse
inertia of the constraints is G = Y D⁻¹ Yᵀ (Delassus' matrix). The pivot of a row in G is its part that is independent
of the rows before. It is compared with the trace of G over the constraint's own equations, which depends on no choice
of axes or units: one equation of a planar loop may be nothing but rounding.

If a row may depend on others and a pivot is not clearly above 0, the residual is at least UNSURE: the caller then has
to choose rows first (``independent_rows``) and pass them. A motion chooses them at the beginning of a step and keeps
them through its stages. The stages violate the constraints by the error of the step, so no pivot is rounding there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from ...algebra.euclidean import Mat3, Vec
from ...algebra.records import table_dtype
from ...algebra.scalars import EPS, Scalar, exceeds, inline, sqrt
from ...algebra.spatial import Force, Inertia, Pose
from ...bodies.constraint_table import TERM
from ..signatures import Bodies, Config, Matrix, Number, Record, Vector, Work
from ..spec import FEXT_OPTIONAL, TAU, A, Argument, Q, Spec, V
from ..tree.crba import crba
from ..tree.ltdl import factor_tree, solve_inward, solve_outward
from ..tree.rnea import rnea
from .constraint_rows import CONSTRAINTS_ARGUMENT, turn_rows, write_drift, write_error, write_jacobian
from .dense import add_product, choose_rows, factor_dropping, quotient, solve_backward, solve_forward

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


class ConstraintScratch(NamedTuple):
    """Scratch of motion under constraints."""

    L: Matrix = ("nv", "nv")  # M, then its factors, of ``factor_tree``
    Y: Matrix = ("nc", "nv")  # J, then J L⁻¹
    G: Matrix = ("nc", "nc")  # Y D⁻¹ Yᵀ, then its factors; the lower triangle
    gamma: Vector = ("nc",)  # γ, then the residuals of the equations
    error: Vector = ("nc",)  # φ, if there is a rate
    size: Vector = ("nc",)  # the number that a pivot is compared with
    kept: Vector = ("nc",)  # 1 of an equation that is independent, else 0


class RowScratch(NamedTuple):
    """Scratch of the choice of independent equations."""

    L: Matrix = ("nv", "nv")  # as of ``ConstraintScratch``
    Y: Matrix = ("nc", "nv")
    G: Matrix = ("nc", "nc")
    size: Vector = ("nc",)  # the number that a pivot is compared with, then its inverse
    column: Vector = ("nc",)  # column of the pivot
    best: Vector = ("nc",)  # 1 of the row of the pivot, else 0


DEPENDENT = 16.0  # times eps and the number of terms in a pivot: the pivot that rounding leaves of a dependent row
CLEAR = 1e-4  # relative pivot above which a row is clearly independent of the rows before it
TINY = 1e-7  # relative pivot below which a row may depend on others, if another pivot is not above CLEAR
UNSURE = 2.0  # added to a residual, itself at most 1, if a row may depend on others and a pivot is not above CLEAR
RISEN = 1e-6  # relative pivot of a dropped row that is more than a step's error: 1e-3 rad from a branch point


@inline
def constrained_motion(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, constraints: Record, rate: Number,
    chosen: Vector, a: Vector, force: Vector, residual: Vector, rank: Vector, pivots: Vector, s: ConstraintScratch,
) -> None:  # fmt: skip
    """a (nv) and λ = force (nc) under J a + γ = 0; with a rate 1/T, J a + γ + 2 J v / T + φ / T² = 0.

    residual (1)  relative residual of the dropped rows: 0 if they agree with the others
    rank (1)      number of independent rows
    fext, rate and chosen, of ``independent_rows``, may be None
    """
    crba(bodies, work, q, s.L)
    rnea(bodies, work, q, v, None, fext, a)
    for i in range(len(bodies) - 1):
        a[i] = tau[i] - a[i]
    move_held(bodies, work, q, v, constraints, rate, chosen, a, force, residual, rank, pivots, s)


@inline
def move_held(
    bodies: Bodies, work: Work, q: Config, v: Vector, constraints: Record, rate: Number, chosen: Vector, x: Vector,
    force: Vector, residual: Vector, rank: Vector, pivots: Vector, s: ConstraintScratch,
) -> None:  # fmt: skip
    """As ``constrained_motion``, x the acceleration in place of τ - bias, with M in s.L, and after ``rnea``."""
    factor_tree(bodies, s.L)
    write_equations(bodies, work, q, v, constraints, rate, s.Y, s.gamma, s.error)
    for i in range(len(bodies) - 1):
        pivots[i] = s.L[i, i]
    felt(bodies, s.L, s.Y, s.G)
    respond(bodies, constraints, chosen, s, x, force, residual, rank)


@inline
def write_equations(
    bodies: Bodies, work: Work, q: Config, v: Vector, constraints: Record, rate: Number, J: Matrix, gamma: Vector,
    error: Vector,
) -> None:  # fmt: skip
    """J (nc, nv) and γ = gamma (nc) of J a + γ = 0, after ``rnea``; with a rate 1/T, γ + 2 J v / T + φ / T² for γ.

    error (nc), written if there is a rate: φ
    """
    turn_rows(bodies, work)
    write_jacobian(bodies, work, constraints, J)
    write_drift(bodies, work, constraints, v, gamma)
    if rate is not None:
        write_error(bodies, work, constraints, q, error)
        for k in range(len(gamma)):
            gamma[k] = gamma[k] + rate * (2.0 * add_product(0.0, J, v, k) + rate * error[k])


@inline
def constraint_response(
    bodies: Bodies, work: Work, q: Config, rhs: Vector, constraints: Record, chosen: Vector, change: Vector,
    force: Vector, residual: Vector, rank: Vector, pivots: Vector, s: ConstraintScratch,
) -> None:  # fmt: skip
    """The change x of velocities (nv) with J x = rhs (nc) of least kinetic energy, and its impulse: M x = Jᵀ force.

    chosen, residual (1) and rank (1) as of ``constrained_motion``.
    """
    write_inertia(bodies, work, q, constraints, s.L, s.Y, s.G, pivots)
    for i in range(len(bodies) - 1):
        change[i] = 0.0
    for k in range(len(s.gamma)):
        s.gamma[k] = -rhs[k]
    respond(bodies, constraints, chosen, s, change, force, residual, rank)


@inline
def independent_rows(
    bodies: Bodies, work: Work, q: Config, constraints: Record, known: Number, chosen: Vector, rank: Vector,
    pivots: Vector, s: RowScratch,
) -> None:  # fmt: skip
    """The equations to keep, chosen (nc) of 1 and 0, by elimination with the largest pivot; rank (1), their number.

    With a known rank at most that many are kept; the rank returned is larger if a dropped pivot is above RISEN.
    """
    n, m = len(bodies) - 1, len(chosen)
    write_inertia(bodies, work, q, constraints, s.L, s.Y, s.G, pivots)
    write_sizes(constraints, s.G, s.size)
    most = float(m) if known is None else known
    count, spare = choose_rows(s.G, s.size, DEPENDENT * (n + m) * EPS, most, chosen, s.column, s.best)
    rank[0] = count if known is None else count + exceeds(spare, RISEN)


@inline
def delassus(
    bodies: Bodies, work: Work, q: Config, constraints: Record, G: Matrix, pivots: Vector, L: Matrix, Y: Matrix
) -> None:
    """G = J M⁻¹ Jᵀ (nc, nc); L and Y are scratch."""
    write_inertia(bodies, work, q, constraints, L, Y, G, pivots)
    for k in range(len(G)):
        for l in range(k):
            G[l, k] = G[k, l]


@inline
def write_inertia(
    bodies: Bodies, work: Work, q: Config, constraints: Record, L: Matrix, Y: Matrix, G: Matrix, pivots: Vector
) -> None:  # fmt: skip
    """The factors of M in L, and Y and G as of ``felt``."""
    crba(bodies, work, q, L)
    factor_tree(bodies, L)
    turn_rows(bodies, work)
    write_jacobian(bodies, work, constraints, Y)
    for i in range(len(bodies) - 1):
        pivots[i] = L[i, i]
    felt(bodies, L, Y, G)


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
    bodies: Bodies, constraints: Record, chosen: Vector, s: ConstraintScratch, x: Vector, force: Vector,
    residual: Vector, rank: Vector,
) -> None:  # fmt: skip
    """Solve M x = r + Jᵀ λ, J x + γ = 0 for x, in place of r, and λ = force.

    UNSURE is added to the residual if the caller should choose rows.

    chosen  (nc) 1 for the rows that are kept, 0 for those that are dropped; None: all but those of pivots near 0
    s       with the factors of M in L, Y and G of ``felt`` and γ in gamma; the residuals of rows are written to gamma
    """
    unsure = factor_kept(bodies, constraints, chosen, s.G, s.size, s.kept)
    solve_inward(bodies, s.L, x)
    for i in range(len(bodies) - 1):
        x[i] = x[i] * (1.0 / s.L[i, i])
    residual[0], rank[0] = hold_rows(chosen, s.L, s.Y, s.G, s.gamma, s.size, s.kept, x, force)
    residual[0] = residual[0] + UNSURE * unsure
    solve_outward(bodies, s.L, x)


@inline
def factor_kept(bodies: Bodies, constraints: Record, chosen: Vector, G: Matrix, size: Vector, kept: Vector) -> Scalar:
    """The factors of G, of ``felt``, in its place. Returns 1 if rows should be chosen, else 0.

    chosen  as of ``respond``
    size    (nc), written: the number that a pivot is compared with
    kept    (nc), written: 1 of a row that is kept, else 0
    """
    m = len(G)
    write_sizes(constraints, G, size)
    unsure = 0.0
    if chosen is None:
        factor_dropping(G, size, DEPENDENT * (len(bodies) - 1 + m) * EPS, kept)
        small, tiny = 0.0, 0.0
        for k in range(m):
            inverse = G[k, k] * size[k]
            small = small + kept[k] * (1.0 - exceeds(1.0 / CLEAR - inverse, 0.0))
            tiny = tiny + 1.0 - kept[k] * exceeds(1.0 / TINY - inverse, 0.0)
        unsure = exceeds(small * tiny, 0.0)
    else:
        for k in range(m):
            kept[k] = chosen[k]
        factor_dropping(G, None, 0.0, kept)
    return unsure


@inline
def hold_rows(
    chosen: Vector, L: Matrix, Y: Matrix, G: Matrix, gamma: Vector, size: Vector, kept: Vector, w: Vector,
    force: Vector,
) -> tuple[Scalar, Scalar]:  # fmt: skip
    """Solve Y w + γ = 0 for w = w₀ + D⁻¹ Yᵀ λ, in place of w₀, and λ = force. Returns residual and rank.

    The remaining Y w + γ of dropped rows is measured in the norm of G, as are the accelerations of w₀ and M⁻¹ Jᵀ λ:
    residual² is its share of the sum of squares, between 0 and 1 in any units. It is written to gamma, in place of γ.

    chosen  as of ``respond``
    G, size, kept  of ``factor_kept``
    """
    energy, lost, rank = 0.0, 0.0, 0.0
    for i in range(len(w)):
        energy = energy + w[i] * w[i] * L[i, i]
    for k in range(len(G)):
        force[k] = -add_product(gamma[k], Y, w, k)
    solve_forward(G, force)
    for k in range(len(G)):
        energy = energy + force[k] * force[k] * G[k, k]
        rank = rank + kept[k]
        if chosen is None:
            gamma[k] = force[k]
    solve_backward(G, force, force)
    add_impulses(L, Y, force, w)
    for k in range(len(G)):
        if chosen is not None:
            gamma[k] = add_product(gamma[k], Y, w, k)
        lost = lost + (1.0 - kept[k]) * quotient(gamma[k] * gamma[k], size[k])
    return sqrt(quotient(lost, lost + energy)), rank


@inline
def add_impulses(L: Matrix, Y: Matrix, force: Vector, w: Vector) -> None:
    """Add D⁻¹ Yᵀ λ to w in place, λ = force."""
    for i in range(len(w)):
        push = 0.0
        for k in range(len(force)):
            push = push + Y[k, i] * force[k]
        w[i] = w[i] + push * (1.0 / L[i, i])


@inline
def write_sizes(constraints: Record, G: Matrix, size: Vector) -> None:
    """size (nc): the trace of G over the equations of each row's constraint."""
    for k in range(len(G)):
        size[k] = G[k, k]
    for m in range(1, len(constraints)):
        c = constraints[m]
        if c.kind != TERM:
            total = 0.0
            for k in range(c.count):
                total = total + size[c.first + k]
            for k in range(c.count):
                size[c.first + k] = total


FORCE = Argument("force", ("nc",), "N | N m", "of each equation, on frame a, in b's axes")
IMPULSE = Argument("impulse", ("nc",), "N s | N m s", "of each equation, on frame a, in b's axes")
RESIDUAL = Argument("residual", (), "1", "of equations that depend on others: 0 if they agree with them")
RANK = Argument("rank", (), "1", "number of independent equations")
CHANGE = Argument("change", ("nv",), "rad/s | m/s", "change of the joint velocities")
RHS = Argument("rhs", ("nc",), "m/s | rad/s", "wanted change of J v")
RATE = Argument("rate", (), "1/s", "1/T of the stabilization", optional=True)
CHOSEN = Argument("chosen", ("nc",), "1", "1 for equations to keep, of independent_rows", optional=True)
KNOWN = Argument("rank", (), "1", "number of independent equations, if it is known", optional=True)
_SOURCE = "after Featherstone, RBDA (2008), section 8.1, with M factored as sparse as the tree."
MOTION = Spec(
    "constrained_motion", constrained_motion, WORK, (Q, V, TAU, FEXT_OPTIONAL, CONSTRAINTS_ARGUMENT, RATE, CHOSEN),
    Argument("result", ("nv+nc+2",), "", "a, force, residual, rank"),
    "Forward dynamics under constraints: a, their forces, residual and rank.", _SOURCE,
    pivots=True, regroup=True, composed=True, scratch=(ConstraintScratch(),),
    parts=(A, FORCE, RESIDUAL, RANK),
)  # fmt: skip
RESPONSE = Spec(
    "constraint_response", constraint_response, WORK, (Q, RHS, CONSTRAINTS_ARGUMENT, CHOSEN),
    Argument("result", ("nv+nc+2",), "", "change, impulse, residual, rank"),
    "The least change of velocities that changes J v by rhs, its impulses, residual and rank.", _SOURCE,
    pivots=True, regroup=True, composed=True, scratch=(ConstraintScratch(),),
    parts=(CHANGE, IMPULSE, RESIDUAL, RANK),
)  # fmt: skip
ROWS = Spec(
    "independent_rows", independent_rows, WORK, (Q, CONSTRAINTS_ARGUMENT, KNOWN),
    Argument("result", ("nc+1",), "", "chosen, rank"),
    "Equations to keep, by elimination with the largest pivot, and the number of independent ones.", _SOURCE,
    pivots=True, regroup=True, composed=True, scratch=(RowScratch(),),
    parts=(replace(CHOSEN, optional=False), RANK),
)  # fmt: skip
DELASSUS = Spec(
    "delassus", delassus, WORK, (Q, CONSTRAINTS_ARGUMENT),
    Argument("G", ("nc", "nc"), "1/kg | 1/(kg m²)", "inverse inertia that the constraints feel, symmetric"),
    "Delassus' matrix G = J M⁻¹ Jᵀ of constraints.", _SOURCE,
    pivots=True, regroup=True, composed=True, scratch=(("nv", "nv"), ("nc", "nv")),
)  # fmt: skip

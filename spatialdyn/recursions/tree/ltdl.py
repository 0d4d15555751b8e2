"""Forward dynamics through the mass matrix, M = LᵀD L with the zeros of the tree: M by CRBA, the bias by RNEA."""

from __future__ import annotations

from ...algebra.euclidean import Vec
from ...algebra.records import table_dtype
from ...algebra.scalars import inline
from ...algebra.spatial import Force, Inertia, Pose
from ..signatures import Bodies, Config, Matrix, Vector, Work
from ..spec import FEXT_OPTIONAL, TAU, TURNED_Q, A, Argument, Spec, V
from .aba import acceleration_through_M
from .crba import crba
from .rnea import rnea

WORK = table_dtype(
    X=Pose,  # of crba, then of rnea
    Ic=Inertia,  # of crba
    w=Vec,  # of rnea, as are the fields that follow
    dw=Vec,
    dv=Vec,
    f=Force,
)


@inline
def crba_solve(
    bodies: Bodies, work: Work, q: Config, v: Vector, tau: Vector, fext: Matrix, a: Vector, pivots: Vector, M: Matrix
) -> None:
    """a = M⁻¹ (τ - bias); fext may be None, for zero.

    M  (nv, nv), written: D on its diagonal and L below
    """
    crba(bodies, work, q, M)
    factor_tree(bodies, M)
    rnea(bodies, work, q, v, None, fext, a)
    for i in range(len(bodies) - 1):
        pivots[i] = M[i, i]
        a[i] = tau[i] - a[i]
    solve_tree(bodies, M, a)


@inline
def factor_tree(bodies: Bodies, M: Matrix) -> None:
    """M = LᵀD L, written in place in the lower triangle, L of unit diagonal (not stored). M_ij and L_ij are 0 unless
    row j carries row i, so only the rows on the way to the root are walked.
    """
    for k in range(len(bodies) - 1, 0, -1):
        d = 1.0 / M[k - 1, k - 1]
        i = bodies[k].parent
        while i > 0:
            L = M[k - 1, i - 1] * d
            j = i
            while j > 0:
                M[i - 1, j - 1] = M[i - 1, j - 1] - L * M[k - 1, j - 1]
                j = bodies[j].parent
            M[k - 1, i - 1] = L
            i = bodies[i].parent


@inline
def solve_tree(bodies: Bodies, L: Matrix, x: Vector) -> None:
    """x = (LᵀD L)⁻¹ x in place."""
    solve_inward(bodies, L, x)
    for i in range(len(bodies) - 1):
        x[i] = x[i] / L[i, i]
    solve_outward(bodies, L, x)


@inline
def solve_inward(bodies: Bodies, L: Matrix, x: Vector) -> None:
    """x = L⁻ᵀ x in place."""
    for i in range(len(bodies) - 1, 0, -1):
        j = bodies[i].parent
        while j > 0:
            x[j - 1] = x[j - 1] - L[i - 1, j - 1] * x[i - 1]
            j = bodies[j].parent


@inline
def solve_outward(bodies: Bodies, L: Matrix, x: Vector) -> None:
    """x = L⁻¹ x in place."""
    for i in range(1, len(bodies)):
        j = bodies[i].parent
        while j > 0:
            x[i - 1] = x[i - 1] - L[i - 1, j - 1] * x[j - 1]
            j = bodies[j].parent


@inline
def factored(bodies: Bodies, M: Matrix, L: Matrix) -> None:
    """The factors of a given M: D on the diagonal of L, L below it, zeros above."""
    for i in range(len(bodies) - 1):
        for j in range(i):
            L[i, j] = M[i, j]
            L[j, i] = 0.0
        L[i, i] = M[i, i]
    factor_tree(bodies, L)


@inline
def solved(bodies: Bodies, L: Matrix, x: Vector, y: Vector) -> None:
    """y = (LᵀD L)⁻¹ x."""
    for i in range(len(bodies) - 1):
        y[i] = x[i]
    solve_tree(bodies, L, y)


@inline
def inverted(bodies: Bodies, L: Matrix, inverse: Matrix) -> None:
    """(LᵀD L)⁻¹, column by column; the upper triangle is a copy of the lower one."""
    for k in range(len(bodies) - 1):
        column = inverse[k]
        for i in range(len(bodies) - 1):
            column[i] = 0.0
        column[k] = 1.0
        solve_tree(bodies, L, column)
    for i in range(len(bodies) - 1):
        for j in range(i):
            inverse[i, j] = inverse[j, i]


@inline
def add_times_L(bodies: Bodies, L: Matrix, x: Vector, y: Vector) -> None:
    """y += L x."""
    for i in range(1, len(bodies)):
        y[i - 1] = y[i - 1] + x[i - 1]
        j = bodies[i].parent
        while j > 0:
            y[i - 1] = y[i - 1] + L[i - 1, j - 1] * x[j - 1]
            j = bodies[j].parent


SPECS = (
    Spec(
        "crba_solve", crba_solve, WORK, (TURNED_Q, V, TAU, FEXT_OPTIONAL), A,
        "Forward dynamics a = M(q)⁻¹ (tau - C(q, v) v - g(q) + Σ Jᵀ fext) through the mass matrix, factored as sparse "
        "as the tree.",
        "Featherstone, RBDA (2008), chapter 6: CRBA, and the factorization LᵀD L.", pivots=True, regroup=True,
        term_shape=("nv", "nv"), scratch=(("nv", "nv"),),
        through_M=acceleration_through_M, residual=("rnea", "minverse"),
    ),
)  # fmt: skip
_LTDL = "Featherstone, RBDA (2008), section 6.3."
_M = Argument("M", ("nv", "nv"), "kg m² | kg m | kg", "mass matrix")
_L = Argument("L", ("nv", "nv"), "kg m² | kg m | kg; 1", "D of M = LᵀD L on the diagonal, L below it")
_MINV = Argument("Minv", ("nv", "nv"), "1/(kg m²) | 1/(kg m) | 1/kg", "inverse of M")
FACTORED = Spec("factored", factored, None, (_M,), _L, "Factors of a given mass matrix.", _LTDL)
SOLVED = Spec("solved", solved, None, (_L, TAU), A, "a = M⁻¹ tau for given factors of M.", _LTDL)
INVERTED = Spec("inverted", inverted, None, (_L,), _MINV, "M⁻¹ for given factors of M.", _LTDL)

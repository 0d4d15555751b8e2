"""Forward dynamics through the mass matrix, M = LᵀD L with the zeros of the tree: M by CRBA, the bias by RNEA."""

from __future__ import annotations

from typing import Any

from ..algebra.euclidean import Vec
from ..algebra.records import table_dtype
from ..algebra.scalars import inlined
from ..algebra.spatial import Force, Inertia, Pose
from .crba import crba
from .rnea import rnea
from .spec import FEXT_OPTIONAL, TAU, A, Q, Spec, V

WORK = table_dtype(X=Pose, Ic=Inertia, w=Vec, dw=Vec, dv=Vec, f=Force, lv=Vec)


@inlined
def crba_solve(bodies: Any, work: Any, q: Any, v: Any, tau: Any, fext: Any, a: Any, pivots: Any, M: Any) -> None:
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


@inlined
def factor_tree(bodies: Any, M: Any) -> None:
    """M = LᵀD L in place of its lower triangle, L of unit diagonal (not stored): M_ij is 0, and L_ij stays 0, unless
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


@inlined
def solve_tree(bodies: Any, L: Any, x: Any) -> None:
    """x = (LᵀD L)⁻¹ x in place."""
    solve_inward(bodies, L, x)
    for i in range(len(bodies) - 1):
        x[i] = x[i] / L[i, i]
    solve_outward(bodies, L, x)


@inlined
def solve_inward(bodies: Any, L: Any, x: Any) -> None:
    """x = L⁻ᵀ x in place."""
    for i in range(len(bodies) - 1, 0, -1):
        j = bodies[i].parent
        while j > 0:
            x[j - 1] = x[j - 1] - L[i - 1, j - 1] * x[i - 1]
            j = bodies[j].parent


@inlined
def solve_outward(bodies: Any, L: Any, x: Any) -> None:
    """x = L⁻¹ x in place."""
    for i in range(1, len(bodies)):
        j = bodies[i].parent
        while j > 0:
            x[i - 1] = x[i - 1] - L[i - 1, j - 1] * x[j - 1]
            j = bodies[j].parent


SPECS = (
    Spec(
        "crba_solve", crba_solve, WORK, (Q, V, TAU, FEXT_OPTIONAL), A,
        "Forward dynamics a = M(q)⁻¹ (tau - C(q, v) v - g(q) + Σ Jᵀ fext) through the mass matrix, factored as sparse "
        "as the tree.",
        "Featherstone, RBDA (2008), chapter 6: CRBA, and the factorization LᵀD L.", pivots=True, regroup=True,
        spare=(("nv", "nv"),),
    ),
)  # fmt: skip

"""Small dense systems that are symmetric and positive semidefinite, by LDLᵀ with dropped pivots: scalars, no branches.

A row that is a combination of the rows before leaves a pivot of 0, up to rounding. Its pivot is dropped: its unknown is
0, and the solution of the other rows solves it too if the right side is consistent. In their given order this is sound
if every pivot is either far from 0 or rounding: a small pivot that is kept may cause a later row to be dropped, which
is then met badly. ``choose_rows`` therefore chooses the rows to keep, at each step the one with the largest pivot. The
kept part is positive definite, so its factor is accurate in any order.
"""

from __future__ import annotations

from ...algebra.scalars import Scalar, exceeds, inline, select
from ..signatures import Matrix, Vector


@inline
def factor_dropping(G: Matrix, size: Vector, tolerance: Scalar, kept: Vector) -> None:
    """G = C Δ Cᵀ in place, from its lower triangle; kept (m) is 1 for a pivot above tolerance times its size, else 0.

    With size None, kept is given: 1 for the rows to keep, else 0.
    Written: C below the diagonal, of unit diagonal, C Δ transposed above, and on the diagonal 1 / Δ, 0 if dropped.
    """
    for k in range(len(G)):
        for l in range(k):
            s = G[k, l]
            for j in range(l):
                s = s - G[j, k] * G[l, j]
            G[l, k] = s
            G[k, l] = s * G[l, l]
        s = G[k, k]
        for j in range(k):
            s = s - G[j, k] * G[k, j]
        if size is not None:
            kept[k] = exceeds(s, tolerance * size[k])
        G[k, k] = kept[k] / (kept[k] * s + (1.0 - kept[k]))


@inline
def choose_rows(
    G: Matrix, size: Vector, tolerance: Scalar, most: Scalar, kept: Vector, column: Vector, best: Vector
) -> tuple[Scalar, Scalar]:
    """Elimination by the largest pivot relative to its size: kept (m) is 1 for the chosen rows, at most ``most``.

    Returns the number of pivots above the tolerance, and the largest relative pivot of the remaining rows.

    G     its lower triangle; written
    size  (m) above 0, or 0 for a row of zeros; written
    column, best  (m) scratch
    """
    m = len(G)
    for k in range(m):
        kept[k] = 0.0
        size[k] = quotient(1.0, size[k])
    count = 0.0
    for p in range(m):
        largest = 0.0
        for k in range(m):
            left = (1.0 - kept[k]) * (G[k, k] * size[k])
            largest = select(left - largest, left, largest)
        taken = exceeds(largest, tolerance) * exceeds(most, p + 0.5)
        others = taken  # best is 1 for the first row with the largest pivot, if taken, and 0 for all others
        pivot = 1.0 - taken
        for k in range(m):
            best[k] = others * (1.0 - exceeds(largest, (1.0 - kept[k]) * (G[k, k] * size[k])))
            others = others - best[k]
            pivot = pivot + best[k] * G[k, k]
        for i in range(m):
            s = 0.0
            for k in range(m):
                s = s + best[k] * (G[i, k] if k < i else G[k, i])
            column[i] = s
        for i in range(m):
            s = column[i] / pivot
            for k in range(i + 1):
                G[i, k] = G[i, k] - s * column[k]
        for k in range(m):
            kept[k] = kept[k] + best[k]
        count = count + taken
    spare = 0.0
    for k in range(m):
        left = (1.0 - kept[k]) * (G[k, k] * size[k])
        spare = select(left - spare, left, spare)
    return count, spare


@inline
def solve_forward(G: Matrix, y: Vector) -> None:
    """y = C⁻¹ y in place; for a dropped row y is its residual."""
    for k in range(len(G)):
        for j in range(k):
            y[k] = y[k] - G[k, j] * y[j]


@inline
def solve_backward(G: Matrix, y: Vector, x: Vector) -> None:
    """x = C⁻ᵀ Δ⁻¹ y, with 0 for the unknowns of dropped rows."""
    for k in range(len(G) - 1, -1, -1):
        s = y[k] * G[k, k]
        for j in range(k + 1, len(G)):
            s = s - G[j, k] * x[j]
        x[k] = s


@inline
def quotient(x: Scalar, y: Scalar) -> Scalar:
    """x / y for x, y >= 0; x if y is 0."""
    return x * (1.0 / (y + (1.0 - exceeds(y, 0.0))))


@inline
def add_product(s: Scalar, A: Matrix, x: Vector, k: int) -> Scalar:
    """The sum s + A_k x, of row k."""
    for i in range(len(x)):
        s = s + A[k, i] * x[i]
    return s

"""Small dense systems that are symmetric and positive semidefinite, by LDLᵀ with dropped pivots: scalars, no branches.

A row that is a combination of the rows before leaves a pivot of 0, up to rounding. Its pivot is dropped: its unknown is
0, and the solution of the other rows solves it too if the right side is consistent. Rows are taken in their order, so
that which of dependent rows drops out is the same in all samples of a batch.
"""

from __future__ import annotations

from ..algebra.scalars import Scalar, exceeds, inline
from .signatures import Matrix, Vector


@inline
def factor_dropping(G: Matrix, least: Vector, kept: Vector) -> None:
    """G = C Δ Cᵀ in place, from its lower triangle; kept (m) is 1 for a pivot above ``least`` (m), else 0.

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
        kept[k] = exceeds(s, least[k])
        G[k, k] = kept[k] / (kept[k] * s + (1.0 - kept[k]))


@inline
def solve_forward(G: Matrix, y: Vector, size: Vector) -> None:
    """y = C⁻¹ y in place; size (m) grows by the squares of what is subtracted. For a dropped row y is its residual."""
    for k in range(len(G)):
        for j in range(k):
            t = G[k, j] * y[j]
            y[k] = y[k] - t
            size[k] = size[k] + t * t


@inline
def solve_backward(G: Matrix, y: Vector, x: Vector) -> None:
    """x = C⁻ᵀ Δ⁻¹ y, with 0 for the unknowns of dropped rows."""
    for k in range(len(G) - 1, -1, -1):
        s = y[k] * G[k, k]
        for j in range(k + 1, len(G)):
            s = s - G[j, k] * x[j]
        x[k] = s


@inline
def worst_dropped(kept: Vector, y: Vector, size: Vector) -> Scalar:
    """Σ y²/size over the dropped rows, y their residuals: 0 if there are none, 1 or so if they contradict others."""
    total = 0.0
    for k in range(len(kept)):
        counts = (1.0 - kept[k]) * exceeds(size[k], 0.0)
        total = total + counts * (y[k] * y[k]) / (counts * size[k] + (1.0 - counts))
    return total

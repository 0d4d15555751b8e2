"""Small dense systems that are symmetric and positive semidefinite, by LDLᵀ with dropped pivots: scalars, no branches.

A row that is a combination of the rows before leaves a pivot of 0, up to rounding. Its pivot is dropped: its unknown is
0, and the solution of the other rows solves it too if the right side is consistent. Rows are taken in their order, so
that which of dependent rows drops out is the same in all samples of a batch.
"""

from __future__ import annotations

from ..algebra.scalars import Scalar, exceeds, inline
from .signatures import Matrix, Vector


@inline
def factor_dropping(G: Matrix, size: Vector, tolerance: Scalar, kept: Vector) -> None:
    """G = C Δ Cᵀ in place, from its lower triangle; kept (m) is 1 for a pivot above tolerance times its size, else 0.

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
        kept[k] = exceeds(s, tolerance * size[k])
        G[k, k] = kept[k] / (kept[k] * s + (1.0 - kept[k]))


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
    """x / y of numbers of 0 or more, x if y is 0."""
    return x * (1.0 / (y + (1.0 - exceeds(y, 0.0))))

"""Motion under constraints, M x = r + Jᵀ λ and J x + γ = -μ λ, with the zeros of the tree in M = LᵀD L.

Y = J L⁻¹, one sweep towards the root for each row of J, and S = Y D⁻¹ Yᵀ + μ 1 = C Cᵀ, a row and a column for each
constraint. A pivot of C is the part of its row that is no combination of those before it: against the row's own
size, so that units do not matter, it says whether the constraint is independent.
"""

from __future__ import annotations

from typing import Any

from ..algebra.scalars import inlined, sqrt
from .ltdl import factor_tree, solve_inward, solve_outward

EPS = 2.220446049250313e-16
DEPENDENT = 16.0  # eps times so many and the terms in a pivot: what rounding leaves of a dependent row


@inlined
def constrained(
    bodies: Any, M: Any, J: Any, r: Any, gamma: Any, mu: Any, L: Any, Y: Any, C: Any, x: Any, force: Any
) -> int:
    """Solve for x (nv) and λ = force (m); returns how many constraints are independent, -1 if M is singular.

    M (nv, nv), J (m, nv), r (nv), gamma (m), mu a number; written too: L (nv, nv) with D on its diagonal, Y (m, nv),
    C (m, m) in the lower triangle
    """
    n, m = len(bodies) - 1, len(J)
    if factored(bodies, M, L) < 0:
        return -1
    independent = _factor_constraints(bodies, J, mu, L, Y, C)
    for i in range(n):
        x[i] = r[i]
    if independent == m:
        solve_factored(bodies, gamma, L, Y, C, x, force)
    return independent


@inlined
def solve_factored(bodies: Any, gamma: Any, L: Any, Y: Any, C: Any, x: Any, force: Any) -> None:
    """x (nv), which is r before, and λ = force (m) by L, Y and C."""
    n, m = len(L), len(C)
    solve_inward(bodies, L, x)
    for i in range(n):
        x[i] = x[i] / L[i, i]
    for k in range(m):
        y = -gamma[k]
        for i in range(n):
            y = y - Y[k, i] * x[i]
        for j in range(k):
            y = y - C[k, j] * force[j]
        force[k] = y / C[k, k]
    for k in range(m - 1, -1, -1):
        for j in range(k + 1, m):
            force[k] = force[k] - C[j, k] * force[j]
        force[k] = force[k] / C[k, k]
    for k in range(m):
        for i in range(n):
            x[i] = x[i] + Y[k, i] * force[k] / L[i, i]
    solve_outward(bodies, L, x)


@inlined
def bordered_inverse(bodies: Any, L: Any, Y: Any, C: Any, gamma: Any, x: Any, force: Any, out: Any) -> int:
    """Inverse (nv + m, nv + m) of [M Jᵀ; J -μ 1] by L, Y and C, column by column; gamma, x and force are scratch.

    With x and -λ for unknowns, the right side is r and -γ; what is above the diagonal is what is below.
    """
    n, m = len(L), len(C)
    for j in range(n + m):
        for i in range(n):
            x[i] = 0.0
        for k in range(m):
            gamma[k] = 0.0
        if j < n:
            x[j] = 1.0
        else:
            gamma[j - n] = -1.0
        solve_factored(bodies, gamma, L, Y, C, x, force)
        for i in range(j, n + m):
            out[i, j] = x[i] if i < n else -force[i - n]
            out[j, i] = out[i, j]
    return 0


@inlined
def factored(bodies: Any, M: Any, L: Any) -> int:
    """M = LᵀD L to L, D on its diagonal; returns -1 if a pivot is next to nothing of its entry of M, else 0."""
    n = len(bodies) - 1
    for i in range(n):
        for j in range(n):
            L[i, j] = M[i, j]
    factor_tree(bodies, L)
    for i in range(n):
        if not L[i, i] > n * EPS * M[i, i]:
            return -1
    return 0


@inlined
def _factor_constraints(bodies: Any, J: Any, mu: Any, L: Any, Y: Any, C: Any) -> int:
    """Y and C; returns how many rows are independent, the others leave a column of zeros in C."""
    n, m = len(bodies) - 1, len(J)
    independent = 0
    for k in range(m):
        for i in range(n):
            Y[k, i] = J[k, i]
        solve_inward(bodies, L, Y[k])
        for l in range(k + 1):
            s = mu if l == k else 0.0
            for i in range(n):
                s = s + Y[k, i] * Y[l, i] / L[i, i]
            size = s
            for j in range(l):
                s = s - C[k, j] * C[l, j]
            if l < k:
                C[k, l] = s / C[l, l] if C[l, l] > 0.0 else 0.0
            elif s > DEPENDENT * (n + m) * EPS * size:
                C[k, k] = sqrt(s)
                independent += 1
            else:
                C[k, k] = 0.0
    return independent


@inlined
def constrained_samples(
    bodies: Any, M: Any, J: Any, r: Any, gamma: Any, mu: Any, L: Any, Y: Any, C: Any, x: Any, force: Any, rank: Any
) -> int:
    """``constrained`` for samples along the first axis of M, J, r, gamma, x and force; rank (samples) is written."""
    for s in range(len(M)):
        rank[s] = constrained(bodies, M[s], J[s], r[s], gamma[s], mu[0], L, Y, C, x[s], force[s])
    return 0

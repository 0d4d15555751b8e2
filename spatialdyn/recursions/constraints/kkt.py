"""Motion under constraints, M x = r + Jᵀ λ and J x + γ = -μ λ, with M = LᵀD L as sparse as the tree.

Y = J L⁻¹ takes one sweep towards the root for each row of J, and S = Y D⁻¹ Yᵀ + μ 1 has a row and a column for each
constraint. A pivot of S is the part of its row that is no combination of the rows before: its size relative to the
row, the same in all units, shows whether the constraint is independent.
"""

from __future__ import annotations

from ...algebra.scalars import EPS, Scalar, inline
from ..signatures import Array, Bodies, Matrix, Vector
from ..tree.ltdl import factor_tree, solve_inward, solve_outward
from .constrained import DEPENDENT, add_impulses, felt
from .dense import add_product, factor_dropping, solve_backward, solve_forward


@inline
def constrained(
    bodies: Bodies,
    M: Matrix,
    J: Matrix,
    r: Vector,
    gamma: Vector,
    mu: Scalar,
    L: Matrix,
    Y: Matrix,
    C: Matrix,
    x: Vector,
    force: Vector,
) -> int:
    """Solve for x (nv) and λ = force (m); returns the number of independent constraints, -1 if M is singular.

    M (nv, nv), J (m, nv), r (nv), gamma (m), mu a number; also written: L (nv, nv) with D on its diagonal, Y (m, nv),
    C (m, m), the factors of S by ``factor_dropping``
    """
    n, m = len(bodies) - 1, len(J)
    if factored(bodies, M, L) < 0:
        return -1
    for k in range(m):
        for i in range(n):
            Y[k, i] = J[k, i]
    felt(bodies, L, Y, C)
    size = kept = force  # one memory until λ is written: a size is last read before its row is kept or dropped
    for k in range(m):
        C[k, k] = C[k, k] + mu
        size[k] = C[k, k]
    factor_dropping(C, size, DEPENDENT * (n + m) * EPS, kept)
    independent = 0
    for k in range(m):
        independent += 1 if kept[k] > 0.0 else 0
    for i in range(n):
        x[i] = r[i]
    if independent == m:
        solve_factored(bodies, gamma, L, Y, C, x, force)
    return independent


@inline
def solve_factored(bodies: Bodies, gamma: Vector, L: Matrix, Y: Matrix, C: Matrix, x: Vector, force: Vector) -> None:
    """x (nv), in place of r, and λ = force (m), from L, Y and C."""
    solve_inward(bodies, L, x)
    for i in range(len(L)):
        x[i] = x[i] / L[i, i]
    for k in range(len(C)):
        force[k] = -add_product(gamma[k], Y, x, k)
    solve_forward(C, force)
    solve_backward(C, force, force)
    add_impulses(L, Y, force, x)
    solve_outward(bodies, L, x)


@inline
def bordered_inverse(
    bodies: Bodies, L: Matrix, Y: Matrix, C: Matrix, gamma: Vector, x: Vector, force: Vector, out: Array
) -> int:
    """Inverse (nv + m, nv + m) of [M Jᵀ; J -μ 1] from L, Y and C, column by column; gamma, x and force are scratch.

    With x and -λ for unknowns, the right side is r and -γ, and the matrix is symmetric.
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


@inline
def factored(bodies: Bodies, M: Matrix, L: Matrix) -> int:
    """Write the factors of M = LᵀD L to L, D on its diagonal; returns -1 if a pivot is rounding of M, else 0."""
    n = len(bodies) - 1
    for i in range(n):
        for j in range(n):
            L[i, j] = M[i, j]
    factor_tree(bodies, L)
    for i in range(n):
        if not L[i, i] > n * EPS * M[i, i]:
            return -1
    return 0


@inline
def constrained_samples(
    bodies: Bodies,
    M: Array,
    J: Array,
    r: Array,
    gamma: Array,
    mu: Array,
    L: Array,
    Y: Array,
    C: Array,
    x: Array,
    force: Array,
    rank: Array,
) -> int:
    """``constrained`` for samples along the first axis of M, J, r, gamma, x and force; rank (samples) is written."""
    for s in range(len(M)):
        rank[s] = constrained(bodies, M[s], J[s], r[s], gamma[s], mu[0], L, Y, C, x[s], force[s])
    return 0

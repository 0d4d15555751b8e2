"""Textbook formulas on M(q) in exact numbers: ∂M/∂q, Γ, C and M⁻¹."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..engines.numbers.symbolic import Ring

Expr = Any  # sympy.Expr
NumberArray = NDArray[Any]


def gradient(ring: Ring, M: NumberArray, q: Sequence[Expr]) -> NumberArray:
    """∂M_ij/∂q_k (n, n, n) of a symmetric M."""
    n = len(q)
    dM = np.empty((n, n, n), dtype=object)
    for i, j, k in np.ndindex(n, n, n):
        dM[i, j, k] = ring.derivative(M[i, j], q[k]) if i <= j else dM[j, i, k]
    return dM


def christoffel_from_gradient(dM: NumberArray, half: Any) -> NumberArray:
    """Γ_ijk = ½ (∂_k M_ij + ∂_j M_ik - ∂_i M_jk) from ∂M/∂q, for velocities that are q̇."""
    made = np.empty_like(dM)
    for i, j, k in np.ndindex(*dM.shape):
        made[i, j, k] = (dM[i, j, k] + dM[i, k, j] - dM[j, k, i]) * half
    return made


def coriolis_from_christoffel(ring: Ring, G: NumberArray, v: Sequence[Expr]) -> NumberArray:
    """C_ij = Σ_k Γ_ijk v_k."""
    numbers = [ring.of(x) for x in v]
    made = np.empty(G.shape[:2], dtype=object)
    for i, j in np.ndindex(*made.shape):
        made[i, j] = sum((g * x for g, x in zip(G[i, j], numbers, strict=True)), ring.of(0))
    return made


def adjugate_and_determinant(ring: Ring, M: NumberArray) -> tuple[NumberArray, Any]:
    """Adjugate and determinant of M, each minor computed once."""
    minors: dict[tuple[tuple[int, ...], tuple[int, ...]], Any] = {((), ()): ring.of(1)}

    def minor(rows: tuple[int, ...], columns: tuple[int, ...]) -> Any:
        if (rows, columns) not in minors:
            total = ring.of(0)
            for k, j in enumerate(columns):
                part = M[rows[0], j] * minor(rows[1:], columns[:k] + columns[k + 1 :])
                total = total - part if k % 2 else total + part
            minors[rows, columns] = total
        return minors[rows, columns]

    every = tuple(range(len(M)))
    adjugate = np.empty_like(M)
    for i, j in np.ndindex(*M.shape):
        part = minor(every[:j] + every[j + 1 :], every[:i] + every[i + 1 :])
        adjugate[i, j] = -part if (i + j) % 2 else part
    return adjugate, minor(every, every)

"""``cholesky``: M = U D Uᵀ with U of unit diagonal, upper triangular; zeros of the tree stay zeros in U."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...diagnosis import refuse_singular
from ...errors import InertiaError
from .calls import vector
from .compiled import made

Array = NDArray[np.float64]


def factor(model: Any, M: Array) -> Array:
    """C (nv, nv) upper triangular with M = C Cᵀ, of the upper triangle of M.

    Raises InertiaError naming a joint that moves no inertia, or where M is not positive definite
    """
    try:
        # from the last joint on, as the tree is eliminated: so nothing fills in
        C: Array = np.linalg.cholesky(M[::-1, ::-1])[::-1, ::-1]
        if C.diagonal().all() and not np.isnan(C).any():
            return C
    except np.linalg.LinAlgError:
        pass
    if M.any() and np.isfinite(M).all() and (M.diagonal() >= 0.0).all():
        refuse_singular(made(model).model, M)
    raise InertiaError("data.M is not positive definite, expected what crba has left there")


def decompose(model: Any, data: Any) -> Array:
    """U, which with D goes to ``data``, of data.M. Raises InertiaError if that is singular."""
    C = factor(model, data.array("M"))
    d = C.diagonal()
    U: Array = C / d
    data.put("U", U)
    data.put("D", d * d)
    return U


def solve(model: Any, data: Any, v: Any) -> Array:
    """M⁻¹ v (nv,) by what decompose has left in ``data``. Raises InertiaError if it has not been called."""
    y = vector("v", v, model.nv)
    U, D = _decomposed(data)
    found: Array = np.linalg.solve(U.T, np.linalg.solve(U, y) / D)
    return found


def computeMinv(model: Any, data: Any) -> Array:
    """M⁻¹ (nv, nv), also to data.Minv, by what decompose has left in ``data``."""
    U, D = _decomposed(data)
    half = np.linalg.solve(U, np.eye(model.nv)) / np.sqrt(D)[:, None]
    Minv: Array = half.T @ half
    data.put("Minv", Minv)
    return Minv


def _decomposed(data: Any) -> tuple[Array, Array]:
    U, D = data.array("U"), data.array("D")
    if not (D > 0.0).all():
        raise InertiaError("data.D is not positive, expected cholesky.decompose to have been called")
    return U, D

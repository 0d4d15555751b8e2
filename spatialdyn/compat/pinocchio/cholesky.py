"""``cholesky``: M = U D Uᵀ with U of unit diagonal, upper triangular; zeros of the tree stay zeros in U."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...constraints.contact import back, factor
from ...errors import InertiaError
from .data.data import prepared
from .data.dispatch import vector
from .data.field_recipes import diagonal, unit_upper

Array = NDArray[np.float64]


def decompose(model: Any, data: Any) -> Array:
    """U (nv, nv) of data.M, also ``data.U``, with D (nv,) in ``data.D``. Raises InertiaError if M is singular."""
    compiled, M = prepared(model, data), data.array("M")
    if not M.any() and M.size:
        raise InertiaError("data.M is zero, expected crba to have been called")
    return stored(data, factor(compiled.model, M.T))  # the upper triangle counts


def solve(model: Any, data: Any, v: Any) -> Array:
    """M⁻¹ v (nv,) by what decompose has left in ``data``. Raises InertiaError if it has not been called."""
    compiled, y = prepared(model, data), vector("v", v, model.nv)
    return back(compiled.model, _lower(data), y)


def computeMinv(model: Any, data: Any) -> Array:
    """M⁻¹ (nv, nv), also ``data.Minv``, by what decompose has left in ``data``. Raises as ``solve``."""
    prepared(model, data)
    L = _lower(data)
    half = half_inverse(L)
    Minv: Array = half.T @ half
    data.put("Minv", Minv)
    return Minv


def stored(data: Any, L: Array) -> Array:
    """U of an L with D on its diagonal and zeros above; both are written to ``data``."""
    data.put("D", diagonal(L))
    U = unit_upper(L)
    data.put("U", U)
    return U


def half_inverse(L: Array) -> Array:
    """G = D^-½ L⁻ᵀ with M⁻¹ = GᵀG, of an L with D on its diagonal."""
    unit = np.tril(L, -1) + np.eye(len(L))
    return np.asarray(np.linalg.inv(unit).T / np.sqrt(L.diagonal())[:, None])


def _lower(data: Any) -> Array:
    """L = Uᵀ with D on its diagonal."""
    D = data.array("D")
    if not (D > 0.0).all():
        raise InertiaError("data.D is not positive, expected cholesky.decompose to have been called")
    L = np.array(data.array("U").T, order="C")
    np.fill_diagonal(L, D)
    return L

"""``pinocchio.cholesky``: M = U D Uᵀ, U upper triangular with unit diagonal and the sparsity of the tree."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...constraints.contact import factor, solve_factored
from ...errors import InertiaError
from .data.data import Data, library_of
from .data.dispatch import vector
from .data.field_recipes import diagonal, unit_upper
from .model.model import Model
from .types.arguments import Array


def decompose(model: Model, data: Data) -> Array:
    """U (nv, nv) of data.M, also ``data.U``, with D (nv,) in ``data.D``. Raises InertiaError if M is singular."""
    library, M = library_of(model, data), data.array("M")
    if not M.any() and M.size:
        raise InertiaError("data.M is zero, expected crba to have been called")
    return stored(data, factor(library._model, M.T))  # reads the upper triangle; of the model, the tree alone


def solve(model: Model, data: Data, v: Any) -> Array:
    """M⁻¹ v (nv,) from the U, D that decompose left in ``data``. Raises InertiaError if it was not called."""
    library, y = library_of(model, data), vector("v", v, model.nv)
    return solve_factored(library._model, _lower(data), y)


def computeMinv(model: Model, data: Data) -> Array:
    """M⁻¹ (nv, nv), also ``data.Minv``, from the U, D that decompose left in ``data``. Raises as ``solve``."""
    library_of(model, data)
    L = _lower(data)
    half = half_inverse(L)
    Minv: Array = half.T @ half
    data.put("Minv", Minv)
    return Minv


def stored(data: Data, L: Array) -> Array:
    """U of an L with D on its diagonal and zeros above; writes both to ``data``."""
    data.put("D", diagonal(L))
    U = unit_upper(L)
    data.put("U", U)
    return U


def half_inverse(L: Array) -> Array:
    """G = D^-½ L⁻ᵀ with M⁻¹ = GᵀG, of an L with D on its diagonal."""
    unit = np.tril(L, -1) + np.eye(len(L))
    return np.asarray(np.linalg.inv(unit).T / np.sqrt(L.diagonal())[:, None])


def _lower(data: Data) -> Array:
    """L = Uᵀ with D on its diagonal."""
    D = data.array("D")
    if not (D > 0.0).all():
        raise InertiaError("data.D is not positive, expected cholesky.decompose to have been called")
    L = np.array(data.array("U").T, order="C")
    L.ravel()[:: len(L) + 1] = D
    return L

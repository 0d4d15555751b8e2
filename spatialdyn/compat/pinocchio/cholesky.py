"""``pinocchio.cholesky``: M = U D Uᵀ, U upper triangular with unit diagonal and the sparsity of the tree.

With mimic joints M is that of the independent velocities, and has no zeros of a tree.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...calls.failures import raise_if_singular
from ...errors import InertiaError
from ..native import tree_kernels
from .data.data import Data, library_of
from .data.dispatch import vector
from .model.model import Model
from .types.arguments import Array


def decompose(model: Model, data: Data) -> Array:
    """U (nv, nv) of data.M, also ``data.U``, with D (nv,) in ``data.D``. Raises InertiaError if M is singular."""
    try:
        library, call = data._bound["decompose"]
        if library is model._library and (found := call()) is not None:
            return found  # type: ignore[no-any-return]
    except (AttributeError, KeyError):  # the fast path does not apply
        pass
    library, M = library_of(model, data), np.ascontiguousarray(data.array("M"))
    U, D = np.empty(M.shape), np.empty(len(M))
    if tree_kernels.factor_upper(library.joint_table, M, np.empty(M.shape), U, D) < 0:
        if not M.any():
            raise InertiaError("data.M is zero, expected crba to have been called")
        raise_if_singular(library.model, M.T)
        raise InertiaError(f'the mass matrix of "{model.name}" is not positive definite')
    data.put("D", D)
    data.put("U", U)
    _bind(model, data, "decompose", "M", "U", "D")
    return U


def _bind(model: Model, data: Data, name: str, *fields: str) -> None:
    """Bind the builtin of a call on fields that are held from now on."""
    library = library_of(model, data)
    if library.has_builtins:
        held = [data.hold(x) for x in fields]  # all before one is bound: holding one drops what is bound
        words = {**dict(zip(fields, held, strict=True)), "scratch": np.empty((model.nv, model.nv)), **library.words}
        data._bound[name] = library, getattr(tree_kernels, name).bind(words, library)


def solve(model: Model, data: Data, v: Any) -> Array:
    """M⁻¹ v (nv,) from the U, D that decompose left in ``data``. Raises InertiaError if it was not called."""
    try:
        library, call = data._bound["solve"]
        if library is model._library and (found := call(v)) is not None:
            return found  # type: ignore[no-any-return]
    except (AttributeError, KeyError):  # the fast path does not apply
        pass
    x = np.array(vector("v", v, model.nv))
    _solve(model, data, x.reshape(1, -1))
    _bind(model, data, "solve", "U", "D")
    return x


def computeMinv(model: Model, data: Data) -> Array:
    """M⁻¹ (nv, nv), also ``data.Minv``, from the U, D that decompose left in ``data``. Raises as ``solve``."""
    columns = np.eye(model.nv)
    _solve(model, data, columns)
    Minv = 0.5 * (columns + columns.T)  # symmetric to the bit
    data.put("Minv", Minv)
    return Minv


def _solve(model: Model, data: Data, x: Array) -> None:
    """Each row of x (m, nv) becomes M⁻¹ of it, in place."""
    library, U, D = library_of(model, data), data.array("U"), data.array("D")
    if tree_kernels.solve_upper(library.joint_table, np.ascontiguousarray(U), D, np.empty(U.shape), x) < 0:
        raise InertiaError("data.D is not positive, expected cholesky.decompose to have been called")

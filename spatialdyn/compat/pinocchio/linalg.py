"""``pinocchio.linalg``, and the matrix functions at the package's root."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import ShapeError
from .types.arguments import ArgumentError, Array, described

__all__ = ["computeLargestEigenvector", "inv", "retrieveLargestEigenvalue"]


def _array(value: Any, what: str, rank: int, square: bool = False) -> Array:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
        raise ArgumentError(f"{what} is {described(value)}, expected an array of numbers")
    if value.ndim != rank or (square and value.shape[0] != value.shape[1]):
        expected = "a square matrix" if square else f"{rank} axes"
        raise ShapeError(f"{what} has shape {value.shape}, expected {expected}")
    return np.asarray(value, dtype=np.float64)


def inv(mat: Any) -> Array:
    """The inverse of a square matrix. Raises numpy.linalg.LinAlgError if it has none."""
    return np.asarray(np.linalg.inv(_array(mat, "mat", 2, square=True)), dtype=np.float64)


def computeLargestEigenvector(mat: Any, max_it: int = 10, rel_tol: float = 1e-8) -> Array:
    """An eigenvector (n,) of the eigenvalue of largest magnitude, whose norm is that magnitude, by power iteration."""
    M = _array(mat, "mat", 2, square=True)
    x = np.ones(len(M)) / np.sqrt(max(len(M), 1))
    for _ in range(max_it):
        before = np.linalg.norm(x)
        x = M @ (x / before) if before > 0.0 else x
        if abs(np.linalg.norm(x) - before) <= rel_tol * before:
            break
    return np.asarray(x, dtype=np.float64)


def retrieveLargestEigenvalue(eigenvector: Any) -> float:
    """The magnitude of the largest eigenvalue: the norm of ``computeLargestEigenvector``."""
    return float(np.linalg.norm(_array(eigenvector, "eigenvector", 1)))


def isOrthonormal(matrix: Any, prec: float = 1e-12) -> bool:
    """Whether the columns of a matrix are orthonormal to prec."""
    M = _array(matrix, "matrix", 2)
    return bool((abs(M.T @ M - np.eye(M.shape[1])) <= prec).all())


def orthogonalization(basis: Any, vec: Array, threshold: float = 0.0) -> None:
    """Subtract from vec (n,), in place, its components above a threshold along an orthonormal basis (n, m)."""
    B = _array(basis, "basis", 2)
    if _array(vec, "vec", 1).shape != B.shape[:1]:
        raise ShapeError(f"vec has shape {vec.shape}, expected ({len(B)},)")
    for column in B.T:
        part = column @ vec
        if abs(part) > threshold:
            vec -= part * column


def orthonormalization(matrix: Array, threshold: float = 0.0) -> None:
    """Orthonormalize the columns of a matrix (n, m), in place, one after the other.

    Raises ShapeError if a column depends on those before it.
    """
    _array(matrix, "matrix", 2)
    for k in range(matrix.shape[1]):
        column = matrix[:, k]
        size = np.linalg.norm(column)
        orthogonalization(matrix[:, :k], column, threshold)
        left = np.linalg.norm(column)
        if not left > 1e-12 * size:
            raise ShapeError(f"column {k} of matrix depends on those before it, expected independent columns")
        column /= left

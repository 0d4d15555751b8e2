"""``pinocchio.utils``: small helpers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.linalg as npl

from .coverage.coverage import refused
from .rpy import matrixToRpy, rotate, rpyToMatrix
from .types.containers import StdVec_StdString
from .types.rotations import skew
from .types.value import Value

__all__ = [
    "eye", "fromListToVectorOfString", "isapprox", "matrixToRpy", "mprint", "np", "npToTTuple", "npToTuple", "npl",
    "rand", "rotate", "rpyToMatrix", "skew", "zero",
]  # fmt: skip


eye, zero, mprint = np.eye, np.zeros, refused("utils.mprint")


def rand(n: Any) -> Any:
    """Random numbers in [0, 1) of size or shape n, from NumPy's global generator."""
    return np.random.rand(n) if isinstance(n, int) else np.random.rand(n[0], n[1])


def isapprox(a: Any, b: Any, epsilon: float = 1e-6) -> bool:
    """Whether two arrays or values agree to a relative epsilon, or two numbers to epsilon."""
    a, b = (np.asarray(x) if isinstance(x, (Value, list)) else x for x in (a, b))
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return bool(np.allclose(np.squeeze(a), np.squeeze(b), epsilon))
    return bool(abs(a - b) < epsilon)


def npToTTuple(M: Any) -> tuple[tuple[Any, ...], ...]:
    """A matrix as a tuple of tuples, its rows."""
    return tuple(tuple(line) for line in M.tolist())


def npToTuple(M: Any) -> tuple[Any, ...]:
    """A vector, row or column as a tuple, a matrix as a tuple of rows."""
    return tuple(M.ravel().tolist()) if M.ndim == 1 or 1 in M.shape else npToTTuple(M)


def fromListToVectorOfString(items: Iterable[str]) -> StdVec_StdString:
    """The names as a list of str."""
    return StdVec_StdString(list(items))

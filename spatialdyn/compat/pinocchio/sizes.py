"""What the algorithms take: NumPy arrays of the sizes that the model asks for, as Pinocchio takes them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import ShapeError
from .arguments import NUMBERS, ArgumentError, described

Array = NDArray[np.float64]


def vector(name: str, value: Any, n: int) -> Array:
    """A float64 vector (n,); a column (n, 1) passes. Raises ArgumentError for no array, ShapeError for another size."""
    x = _array(name, value)
    if x.shape not in ((n,), (n, 1)):
        raise ShapeError(f"{name} has shape {x.shape}, expected ({n},)")
    return x.reshape(n)


def matrix(name: str, value: Any, columns: int) -> Array:
    """A float64 matrix (m, columns). Raises as ``vector``."""
    x = _array(name, value)
    if x.ndim != 2 or x.shape[1] != columns:
        raise ShapeError(f"{name} has shape {x.shape}, expected (m, {columns})")
    return x


def _array(name: str, value: Any) -> Array:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in NUMBERS:
        raise ArgumentError(f"{name} is {described(value)}, expected an array of numbers")
    return np.asarray(value, np.float64)

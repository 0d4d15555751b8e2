"""Memory at an address, and scratch, as functions that plain Python and compiled code run.

These are the functions of plain Python; ``memory_at`` has those that compiled code runs in their place.
"""

from __future__ import annotations

import ctypes
import math
from functools import cache
from typing import Any

import numpy as np

from ...bodies.table import BODIES


def word(base: int, k: int) -> int:
    """Word k behind an address."""
    return ctypes.c_int64.from_address(int(base + 8 * k)).value


def records(address: int, shape: tuple[int, ...], dtype: Any) -> Any:
    """Array at an address, in C order."""
    size = int(math.prod(shape))
    if not size:
        return np.empty(shape, dtype)
    memory = (ctypes.c_char * (size * np.dtype(dtype).itemsize)).from_address(int(address))
    return np.frombuffer(memory, dtype, size).reshape(shape)


def at(address: int, shape: tuple[int, ...]) -> Any:
    """Array of float64 at an address, in C order."""
    return records(address, shape, np.float64)


def places(address: int, shape: tuple[int, ...]) -> Any:
    """Array of indices at an address, in C order."""
    return records(address, shape, np.intp)


def table_at(address: int) -> Any:
    """The table of bodies at an address."""
    world = records(address, (1,), BODIES)
    return records(address, (int(world[0].last_row) + 1,), BODIES)


@cache
def _function(result: Any, *given: Any) -> Any:
    return ctypes.PYFUNCTYPE(result, *given)


def real_of(address: int, x: int) -> float:
    """Call a C function of a word that returns a float."""
    found: float = _function(ctypes.c_double, ctypes.c_int64)(address)(x)
    return found


def memory(size: int) -> Any:
    """Memory of that many bytes for the calling function, to be released."""
    return size


def array_at(memory: Any, shape: tuple[int, ...], dtype: Any) -> Any:
    """Array in such memory."""
    return np.empty(shape, dtype)


def release(memory: Any, size: int) -> None:
    """Release such memory."""

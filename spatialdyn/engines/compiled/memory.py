"""Memory at an address, scratch, and arguments of entries, as functions that plain Python and compiled code run.

These are the functions of plain Python; ``memory_at`` has those that compiled code runs in their place.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from enum import Enum
from functools import cache
from typing import Any, NamedTuple

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


# --- arguments of entries ----------------------------------------------------------------------------------

Place = Enum("Place", ["WORDS", "INPUT", "OUTPUT"])


class Argument(NamedTuple):
    """Where an entry finds an argument of its function.

    place   WORDS: words of the context; INPUT, OUTPUT: at an address in ``inputs`` or ``outputs``
    at      which of them
    shape   of an array of float64: sizes, or ~k for word k of the context; () for a float; None for an int
    record  a named tuple of words
    """

    place: Place
    at: tuple[int, ...]
    shape: tuple[int, ...] | None = None
    record: type | None = None


def read(arguments: Sequence[Argument], context: int, inputs: int, outputs: int) -> list[Any]:
    """The arguments of an entry's function."""
    return [_read(x, context, outputs if x.place is Place.OUTPUT else inputs) for x in arguments]


def _read(x: Argument, context: int, places: int) -> Any:
    if x.place is Place.WORDS:
        words = [word(context, k) for k in x.at]
        return words[0] if x.record is None else x.record(*words)
    address = word(places, x.at[0])
    if x.shape is None:
        return word(address, 0)
    found = at(address, tuple(n if n >= 0 else word(context, ~n) for n in x.shape or (1,)))
    return found if x.shape or x.place is Place.OUTPUT else found[0]

"""Loops until a condition and bodies that not every sample needs: the two regions of a recursion.

::

    left[0] = residual - tolerance
    for _ in repeat(12, left, force, velocity):
        if settled(left[0]):
            break
        ...                                        # a pass: writes force, velocity and left

    for _ in when(speed - least, force):
        ...

A pass is run while ``left[0]`` is above 0, at most so many times; the body of ``when`` if its number is above 0. What
follows the number are the *carried* values: all arrays and records that the body writes and that it, or what follows
the region, reads. Other scratch may be written and read within one pass. A NaN is not above 0, so it ends a loop.

In plain Python and compiled code these are a loop with a break, and an if. An engine that runs many samples at once, or
records, says by ``running`` what a region is for its numbers: it runs the body until no sample needs it, and a sample
that does not keeps its carried values to the bit, so that results do not depend on the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import singledispatch
from typing import Any

import numpy as np

from .scalars import Scalar, compiled_as

Engine = Callable[[int, Scalar, "Carried"], Iterable[Any]]
_engine: ContextVar[Engine | None] = ContextVar("engine", default=None)


class Carried:
    """The carried values of a region: entries of arrays of objects, and of rows of plain attributes.

    left  the array with the number that the loop tests, or None
    """

    def __init__(self, left: Any, carried: Iterable[Any]) -> None:
        """Of some arrays, rows and lists of rows."""
        self.left = left
        self.places: list[tuple[Any, Any]] = []  # (array, index) or (row, name)
        for x in carried if left is None else (left, *carried):
            self._add(x)

    def _add(self, x: Any) -> None:
        if isinstance(x, np.ndarray):
            self.places += [(x, at) for at in np.ndindex(x.shape)]
        elif isinstance(x, list):
            for row in x:
                self._add(row)
        else:
            for name, value in vars(x).items():
                if isinstance(value, np.ndarray | list) or hasattr(value, "__dict__"):
                    self._add(value)
                elif not isinstance(value, int):
                    self.places.append((x, name))

    def get(self) -> list[Any]:
        """The values."""
        return [vars(x)[at] if isinstance(at, str) else x[at] for x, at in self.places]

    def put(self, values: Iterable[Any]) -> None:
        """Write the values."""
        for (x, at), value in zip(self.places, values, strict=True):
            if isinstance(at, str):
                vars(x)[at] = value
            else:
                x[at] = value


@contextmanager
def running(engine: Engine) -> Iterator[None]:
    """Regions are run by ``engine(cap, x, carried)`` within: an iterable that ends once x, or left, is not above 0."""
    token = _engine.set(engine)
    try:
        yield
    finally:
        _engine.reset(token)


def repeat(cap: int, left: Any, *carried: Any) -> Iterable[Any]:
    """The passes of a loop that is run while ``left[0]`` is above 0, at most ``cap`` times; each begins with
    ``if settled(left[0]): break``.
    """
    engine = _engine.get()
    return range(cap) if engine is None else engine(cap, left[0], Carried(left, carried))


def when(x: Scalar, *carried: Any) -> Iterable[Any]:
    """One pass where x is above 0, else none."""
    engine = _engine.get()
    return range(0 if settled(x) else 1) if engine is None else engine(1, x, Carried(None, carried))


@singledispatch
def settled(x: Scalar) -> bool:
    """Whether a loop ends: x is not above 0. Engines of several samples find that out themselves, and get False."""
    return not x > 0.0


@compiled_as(repeat)
def _repeat(cap, left, *carried):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    return lambda cap, left, *carried: range(cap)


@compiled_as(when)
def _when(x, *carried):  # type: ignore[no-untyped-def]
    return lambda x, *carried: range(1 if x > 0.0 else 0)


@compiled_as(settled)
def _settled(x):  # type: ignore[no-untyped-def]
    return lambda x: not x > 0.0

"""The few functions of one number that the recursions use beside + - * /.

Each is math's for floats, compiled code's under Numba, and whatever an engine registers for its own numbers:
``sin.register(MyNumber)(my_sin)``. A recursion never branches on a value; it calls ``select``.
"""

from __future__ import annotations

import math
from functools import singledispatch
from typing import Any

import numpy as np
from numba.extending import overload, register_jitable

_INLINED: dict[str, Any] = {}
_WOVEN: dict[str, Any] = {}
try:
    from .numba_passes import Inlining, Weaving
except ImportError:  # a Numba whose parts are elsewhere: compiling takes twice as long
    pass
else:
    _INLINED["pipeline_class"], _WOVEN["pipeline_class"] = Inlining, Weaving

Scalar = Any

inlined = register_jitable(forceinline=True, no_cfunc_wrapper=True, **_INLINED)
"""Decorates what recursions are made of: plain Python when called, inlined without exception when compiled.

Left to itself LLVM calls the larger ones, and each call counts references to its arrays: half the cost of a CRBA.
"""

woven = register_jitable(forceinline=True, no_cfunc_wrapper=True, **_WOVEN)
"""Decorates what calls compiled kernels and is inlined: the outermost caller alone optimises the kernels anew."""

called = register_jitable(no_cfunc_wrapper=True)
"""Decorates what is large and called from several places: compiled once, for a tenth of the time inlining takes."""


@singledispatch
def sin(x: Scalar) -> Scalar:
    """sin x; nan for an infinite x, as compiled code has it."""
    return math.sin(x) if math.isfinite(x) else math.nan


@singledispatch
def cos(x: Scalar) -> Scalar:
    """cos x; nan for an infinite x, as compiled code has it."""
    return math.cos(x) if math.isfinite(x) else math.nan


@singledispatch
def sqrt(x: Scalar) -> Scalar:
    """√x; nan for a negative x, as compiled code has it."""
    return math.sqrt(x) if x >= 0.0 else math.nan


@singledispatch
def atan2(y: Scalar, x: Scalar) -> Scalar:
    """The angle of the point (x, y), in [-π, π]."""
    return math.atan2(y, x)


@singledispatch
def select(x: Scalar, positive: Scalar, otherwise: Scalar) -> Scalar:
    """``positive`` where x > 0, else ``otherwise``; both are computed."""
    return positive if x > 0.0 else otherwise


@singledispatch
def summed(x: Scalar, series: Scalar, closed: Scalar) -> Scalar:
    """``series``, good to float64, where x > 0, else the closed form it stands for.

    Both are computed. Numbers of more digits, which can afford what cancels, take the closed form throughout.
    """
    return select(x, series, closed)


@overload(sin)
def _sin(x):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    return lambda x: math.sin(x)


@overload(cos)
def _cos(x):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    return lambda x: math.cos(x)


@overload(sqrt)
def _sqrt(x):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    return lambda x: np.sqrt(x)


@overload(atan2)
def _atan2(y, x):  # type: ignore[no-untyped-def]
    return lambda y, x: math.atan2(y, x)


@overload(select)
def _select(x, positive, otherwise):  # type: ignore[no-untyped-def]
    return lambda x, positive, otherwise: positive if x > 0.0 else otherwise


@overload(summed)
def _summed(x, series, closed):  # type: ignore[no-untyped-def]
    return lambda x, series, closed: series if x > 0.0 else closed

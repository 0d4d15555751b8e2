"""The few functions of one number that the recursions use beside + - * /, and the decorators of compiled functions.

Each is that of ``math`` for floats, native code under Numba, and for an engine's own numbers the function that the
engine registers: ``sin.register(MyNumber)(my_sin)``. A recursion never branches on a value; it calls ``select``.

Importing Numba takes time, so the decorators only list functions; ``register`` hands the list to Numba before anything
is compiled.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from functools import singledispatch
from typing import Any, TypeVar

import numpy as np

Scalar = Any
Function = TypeVar("Function", bound=Callable[..., Any])
EPS = 2.220446049250313e-16  # 2⁻⁵², of float64

lock = threading.RLock()  # of ``register``
_waiting: list[tuple[str, Callable[..., Any], Callable[..., Any]]] = []  # (how, function, implementation)


def inline(function: Function) -> Function:
    """Decorator of recursions and their parts: plain Python when called from Python, always inlined in compiled code.

    By default LLVM does not inline the larger ones, and each call then counts references to its arrays.
    """
    _waiting.append(("inline", function, function))
    return function


def inline_unoptimized(function: Function) -> Function:
    """Decorator of functions that call compiled kernels: inlined, and optimized in the outermost caller alone."""
    _waiting.append(("inline_unoptimized", function, function))
    return function


def no_inline(function: Function) -> Function:
    """Decorator of large functions with several callers: compiled once, far sooner than inlined in each."""
    _waiting.append(("no_inline", function, function))
    return function


def inline_or_by_rows(function: Function) -> Function:
    """Decorator as ``inline``, of recursions that an engine replaces for its own rows: ``function.register(Rows)``."""
    general: Any = singledispatch(function)
    _waiting.append(("inline", general, function))
    return general  # type: ignore[no-any-return]


def compiled_as(function: Callable[..., Any]) -> Callable[[Function], Function]:
    """Decorator of Numba's implementation of ``function``: given types, it returns the function to compile."""

    def listed(implementation: Function) -> Function:
        _waiting.append(("overload", function, implementation))
        return implementation

    return listed


def inlined_as(function: Callable[..., Any]) -> Callable[[Function], Function]:
    """Decorator of the function that compiled code runs, always inlined, in place of ``function``."""

    def listed(implementation: Function) -> Function:
        _waiting.append(("inline", function, implementation))
        return implementation

    return listed


def register(pipelines: Mapping[str, Any]) -> None:
    """Hand the listed functions to Numba, to be compiled by the pipelines of their decorators' names, else by its own.

    Whatever compiles calls it first: ``engines.compiled.jit`` does.
    """
    with lock:
        if not _waiting:
            return
        from numba.extending import overload, register_jitable

        ways: dict[str, dict[str, Any]] = {
            "inline": {"forceinline": True}, "inline_unoptimized": {"forceinline": True}, "no_inline": {}
        }  # fmt: skip
        for how, pipeline in pipelines.items():
            ways[how]["pipeline_class"] = pipeline
        while _waiting:
            how, function, implementation = _waiting.pop()
            if how == "overload":
                overload(function)(implementation)
            elif function is implementation:
                register_jitable(no_cfunc_wrapper=True, **ways[how])(function)
            else:
                options: Any = {"no_cfunc_wrapper": True, **ways[how]}
                overload(function, jit_options=options, strict=False)(_constant(implementation))


def _constant(implementation: Callable[..., Any]) -> Callable[..., Any]:
    """A function of any types that returns ``implementation``."""

    def chosen(*types: Any) -> Callable[..., Any]:
        return implementation

    return chosen


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
def exp(x: Scalar) -> Scalar:
    """e^x; infinite above 709.78, where it leaves the range of float64, and 0 below -745.13."""
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


@singledispatch
def atan2(y: Scalar, x: Scalar) -> Scalar:
    """The angle of the point (x, y), in [-π, π]."""
    return math.atan2(y, x)


@singledispatch
def select(x: Scalar, positive: Scalar, otherwise: Scalar) -> Scalar:
    """``positive`` where x > 0, else ``otherwise``; both are computed."""
    return positive if x > 0.0 else otherwise


@singledispatch
def exceeds(x: Scalar, floor: Scalar) -> Scalar:
    """1 where x > floor, else 0, for a floor of 0 or more; of symbols, 1 unless x is 0 identically."""
    return 0.0 if isinstance(x, float) and x <= 0.0 else select(x - floor, 1.0, 0.0)


@singledispatch
def series_or_closed(x: Scalar, series: Scalar, closed: Scalar) -> Scalar:
    """``series``, good to float64, where x > 0, else the closed form it stands for.

    Both are computed. Numbers of more digits than float64, which can afford cancellation, always take the closed form.
    """
    return select(x, series, closed)


def anywhere(truth: Any) -> Any:
    """A truth; of several samples, whether it holds for one of them."""
    return truth


def everywhere(truth: Any) -> Any:
    """A truth; of several samples, whether it holds for all of them."""
    return truth


@compiled_as(anywhere)
def _anywhere(truth):  # type: ignore[no-untyped-def]
    return (lambda truth: truth) if str(truth) == "bool" else None


@compiled_as(everywhere)
def _everywhere(truth):  # type: ignore[no-untyped-def]
    return (lambda truth: truth) if str(truth) == "bool" else None


@compiled_as(sin)
def _sin(x):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    return lambda x: math.sin(x)


@compiled_as(cos)
def _cos(x):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    return lambda x: math.cos(x)


@compiled_as(sqrt)
def _sqrt(x):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    return lambda x: np.sqrt(x)


@compiled_as(exp)
def _exp(x):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    return lambda x: np.exp(x)


@compiled_as(atan2)
def _atan2(y, x):  # type: ignore[no-untyped-def]
    return lambda y, x: math.atan2(y, x)


@compiled_as(select)
def _select(x, positive, otherwise):  # type: ignore[no-untyped-def]
    return lambda x, positive, otherwise: positive if x > 0.0 else otherwise


@compiled_as(exceeds)
def _exceeds(x, floor):  # type: ignore[no-untyped-def]
    return lambda x, floor: 1.0 if x > floor else 0.0


@compiled_as(series_or_closed)
def _series_or_closed(x, series, closed):  # type: ignore[no-untyped-def]
    return lambda x, series, closed: series if x > 0.0 else closed

"""Closed forms as LaTeX, as a NumPy function, as Python text and as C.

Common subexpressions are computed once. Names in the text are q, v, a, p, tau, parameters and x0, x1, ...
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engines.numbers.symbolic import need_sympy
from ..errors import ShapeError, SpatialDynError

Expr = Any  # sympy.Expr
Arguments = Mapping[str, tuple[Expr, ...]]


def text(name: str, value: Any) -> str:
    """An expression as ``name = ...``; for a matrix or array its nonzero entries, indices from 1."""
    flat, shape = _flat(value)
    if not shape:
        return f"{name} = {value}\n"
    places = [[k + 1 for k in place] for place in np.ndindex(shape)]
    lines = [f"{name}{place} = {x}" for place, x in zip(places, flat, strict=True) if x != 0]
    return "\n".join(lines or [f"{name} = 0"]) + "\n"


def latex(value: Any, v: Sequence[Expr], a: Sequence[Expr]) -> str:
    """LaTeX of an expression, matrix or array; v and a are written with one dot and two."""
    sympy = need_sympy()
    names = {x: rf"\dot{{q}}_{{{k}}}" for k, x in enumerate(v, start=1)}
    names |= {x: rf"\ddot{{q}}_{{{k}}}" for k, x in enumerate(a, start=1)}
    text: str = sympy.latex(value, symbol_names=names)
    return text


def _flat(value: Any) -> tuple[list[Expr], tuple[int, ...]]:
    """Entries in C order, and the shape: a column is a vector, an expression a scalar."""
    shape = tuple(int(n) for n in getattr(value, "shape", ()))
    if not shape:
        return [value], ()
    flat = list(value) if len(shape) <= 2 else list(need_sympy().flatten(value.tolist()))
    return flat, shape[:1] if len(shape) == 2 and shape[1] == 1 else shape


def _shared(
    value: Any, arguments: Arguments, entry: Callable[[str, int], str]
) -> tuple[list[tuple[Expr, Expr]], list[Expr]]:
    """Common subexpressions and results, the symbols of the arguments replaced by their entries."""
    sympy = need_sympy()
    flat, _ = _flat(value)
    places = {x: sympy.Symbol(entry(name, k)) for name, group in arguments.items() for k, x in enumerate(group)}
    shared, results = sympy.cse([x.xreplace(places) for x in flat], symbols=sympy.numbered_symbols("x"))
    return shared, results


def function(
    name: str, value: Any, arguments: Arguments, default: NDArray[np.float64] | None
) -> Callable[..., NDArray[np.float64]]:
    """``f(*arguments)`` on arrays (..., size of each), broadcast; ``default`` replaces missing parameters.

    Raises ShapeError naming an argument whose last axis has another size.
    """
    sympy = need_sympy()
    flat, shape = _flat(value)
    symbols = [x for group in arguments.values() for x in group]
    compute = sympy.lambdify(symbols, flat, modules="numpy", cse=True)

    def closed_form(*given: ArrayLike) -> NDArray[np.float64]:
        values = list(given)
        if len(values) == len(arguments) - 1 and "parameters" in arguments:
            if default is None:
                raise SpatialDynError(f"{name} needs its parameters, for an expression was given for some")
            values.append(default)
        if len(values) != len(arguments):
            raise SpatialDynError(f"{name} has {len(given)} arguments, expected {', '.join(arguments)}")
        columns: list[NDArray[np.float64]] = []
        for label, group, x in zip(arguments, arguments.values(), values, strict=False):
            array = np.asarray(x, dtype=float)
            if array.shape[-1:] != (len(group),):
                raise ShapeError(f"{label} has shape {array.shape}, expected (..., {len(group)})")
            columns += [array[..., k] for k in range(len(group))]
        batch = np.broadcast_shapes(*(x.shape for x in columns))
        out = np.empty((*batch, math.prod(shape)))
        for k, entry in enumerate(compute(*columns)):
            out[..., k] = entry
        return out.reshape(batch + shape)

    closed_form.__name__ = closed_form.__qualname__ = name
    closed_form.__doc__ = (
        f"{name}({', '.join(arguments)}) in closed form: arrays (..., size), a result {shape or 'scalar'}."
    )
    return closed_form


def python_code(name: str, value: Any, arguments: Arguments) -> str:
    """The text of a Python function that needs NumPy only."""
    from sympy.printing.numpy import NumPyPrinter

    printer = NumPyPrinter({"fully_qualified_modules": False, "allow_unknown_functions": True})
    _, shape = _flat(value)
    shared, results = _shared(value, arguments, lambda group, k: f"{group}[{k}]")
    used = ", ".join(sorted({f for x in [*results, *(e for _, e in shared)] for f in _functions(x)}))
    lines = ["import numpy as np"] + [f"from numpy import {used}"] * bool(used) + ["", ""]
    lines.append(f"def {name}({', '.join(arguments)}):")
    lines += [f"    {x} = {printer.doprint(e)}" for x, e in shared]
    listed = [f"        {printer.doprint(e)}," for e in results]
    lines += ["    return np.array([", *listed, f"    ]).reshape({shape})"]
    return "\n".join(lines) + "\n"


def _functions(x: Expr) -> set[str]:
    """NumPy functions that the text of an expression calls."""
    sympy = need_sympy()
    found = {f.func.__name__ for f in x.atoms(sympy.sin, sympy.cos, sympy.tan)}
    found |= {"sqrt"} if any(abs(p.exp) == sympy.S.Half for p in x.atoms(sympy.Pow)) else set()
    return found | ({"pi"} if x.has(sympy.pi) else set())


def c_code(name: str, value: Any, arguments: Arguments) -> str:
    """The text of a C99 function that writes its result, in C order, to its last argument."""
    from sympy.printing.c import C99CodePrinter

    printer = C99CodePrinter()
    _, shape = _flat(value)
    shared, results = _shared(value, arguments, lambda group, k: f"{group}[{k}]")
    size = math.prod(shape)
    sizes = ", ".join(f"{group}[{len(x)}]" for group, x in arguments.items())
    parameters = [f"const double *{group}" for group in arguments] + ["double *out"]
    lines = [
        "#include <math.h>",
        "",
        f"/* {name} of {sizes}; writes out[{size}]{f' of shape {shape}' if len(shape) > 1 else ''} */",
        f"void {name}({', '.join(parameters)})",
        "{",
        *(f"    const double {x} = {printer.doprint(e)};" for x, e in shared),
        *(f"    out[{k}] = {printer.doprint(e)};" for k, e in enumerate(results)),
        "}",
    ]
    return "\n".join(lines) + "\n"

"""A Specialized as a function of CasADi."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..calls.exported import Derivatives, Exported
from ..engines.programs.record.operations import (
    ABS,
    ATAN2,
    CONST,
    COS,
    DIV,
    EXP,
    FORMS,
    INPUT,
    SELECT,
    SIN,
    SQRT,
    UFP,
    signed,
)
from ..engines.programs.record.program import Program
from ..engines.programs.transform.casadi_code import by_columns, matrix
from ..engines.programs.transform.source_code import Shapes
from ..errors import SpatialDynError, literal
from .frameworks import framework


def to_casadi(given: Exported, derivatives: Derivatives | None) -> Any:
    """``Specialized.to_casadi``."""
    casadi = framework("casadi")
    if not casadi.Function.check_name(given.name):
        raise SpatialDynError(f"name is {literal(given.name)}, expected a name that CasADi takes")
    ins, outs = _Arrays(casadi, given.inputs), _Arrays(casadi, given.outputs)
    options: dict[str, Any] = {}
    if derivatives is not None:
        options = _derivatives(casadi, given, derivatives)
    results = outs.stacked(walk(casadi, given.program, ins.entries))
    scalars = casadi.Function(given.name, ins.symbols, results, ins.names, outs.names, options)
    if derivatives is None:
        return scalars
    # an MX function stays one node, also in results of ``factory``, which would expand an SX function
    symbols = [casadi.MX.sym(x, *shape) for x, shape in zip(ins.names, ins.shapes, strict=True)]
    node = scalars.call(symbols, False, True)
    return casadi.Function(given.name, symbols, node, ins.names, outs.names, options)


class _Arrays:
    """Named arrays as matrices of symbols; CasADi stores entries column by column, programs store them row by row."""

    def __init__(self, casadi: Any, arrays: Shapes, prefix: str = "") -> None:
        self.casadi, self.names = casadi, [prefix + x for x in arrays]
        self.shapes = [matrix(x) for x in arrays.values()]
        self.symbols = [casadi.SX.sym(x, *shape) for x, shape in zip(self.names, self.shapes, strict=True)]

    @property
    def entries(self) -> list[Any]:
        """The entries of all arrays, each in C order."""
        return [
            x[at]
            for x, shape in zip(self.symbols, self.shapes, strict=True)
            for at in np.argsort(by_columns(shape)).tolist()
        ]

    def stacked(self, values: Sequence[Any]) -> list[Any]:
        """Matrices of the entries of all arrays."""
        made, at = [], 0
        for rows, width in self.shapes:
            part = self.casadi.vertcat(*values[at : at + rows * width])
            made.append(self.casadi.reshape(part, width, rows).T)
            at += rows * width
        return made

    def places(self) -> list[list[int]]:
        """For each array its entries in CasADi's order, as places among all entries."""
        found, first = [], 0
        for shape in self.shapes:
            found.append([first + k for k in by_columns(shape)])
            first += len(found[-1])
        return found


def _jacobian(casadi: Any, name: str, ins: Sequence[_Arrays], outs: _Arrays, entries: Sequence[Any]) -> Any:
    """The CasADi function of derivatives of results by inputs; ``entries`` are the derivatives, result by result."""
    blocks = _blocks(casadi, ins, outs, entries)
    names = [x for group in ins for x in group.names]
    nominal = [casadi.SX.sym(f"out_{x}", *shape) for x, shape in zip(outs.names, outs.shapes, strict=True)]
    return casadi.Function(
        f"jac_{name}", [*(x for group in ins for x in group.symbols), *nominal], blocks,
        [*names, *(f"out_{x}" for x in outs.names)], [f"jac_{x}_{y}" for x in outs.names for y in names],
    )  # fmt: skip


def _blocks(casadi: Any, ins: Sequence[_Arrays], outs: _Arrays, entries: Sequence[Any]) -> list[Any]:
    """The derivatives of each result by each input, in CasADi's order; ``entries`` likewise in C order."""
    columns, first = [], 0
    for group in ins:
        columns += [[first + k for k in places] for places in group.places()]
        first += sum(map(len, group.places()))
    blocks = []
    for taken in outs.places():
        for order in columns:
            part = casadi.vertcat(*(entries[first * i + j] for j in order for i in taken))
            blocks.append(casadi.reshape(part, len(taken), len(order)))
    return blocks


def _derivatives(casadi: Any, given: Exported, derivatives: Derivatives) -> dict[str, Any]:
    """Options of a function: its Jacobian, and, in CasADi's cache of derivatives, one direction of each mode.

    The penalty makes CasADi use the cached derivatives for one direction, and the Jacobian for as many directions as
    there are results. The reverse derivative, which Hessians differentiate, has a Jacobian of its own.
    """
    ins, outs, n = _Arrays(casadi, given.inputs), _Arrays(casadi, given.outputs), given.program.inputs
    known, m = _Arrays(casadi, given.outputs, "out_"), len(given.program.outputs)
    along, weights = _Arrays(casadi, given.inputs, "fwd_"), _Arrays(casadi, given.outputs, "adj_")
    moved, slopes = _Arrays(casadi, given.outputs, "fwd_"), _Arrays(casadi, given.inputs, "adj_")
    jacobian = _jacobian(casadi, given.name, [ins], outs, walk(casadi, derivatives.jacobian, ins.entries))
    cache = {}
    for mode, program, seeds, results in (
        ("fwd", derivatives.along, along, moved), ("adj", derivatives.weighted, weights, slopes),
    ):  # fmt: skip
        symbols = [*ins.symbols, *known.symbols, *seeds.symbols]
        found = results.stacked(walk(casadi, program, [*ins.entries, *seeds.entries, *known.entries]))
        name, names = f"{mode}1_{given.name}", [*ins.names, *known.names, *seeds.names]
        second: dict[str, Any] = {}
        if mode == "adj" and derivatives.hessian is not None:
            second = _second(casadi, name, [ins, known, weights], slopes, jacobian, derivatives.hessian)
        cache[name] = casadi.Function(name, symbols, found, names, results.names, second)
    return {"custom_jacobian": jacobian, "jac_penalty": max(1.0 / m, 2.1 / n), "cache": cache}


def _second(
    casadi: Any, name: str, given: Sequence[_Arrays], slopes: _Arrays, jacobian: Any, program: Program
) -> dict[str, Any]:
    """Options of the reverse derivative of a function: its Jacobian, used from two directions on.

    Its derivatives by the inputs are a program, which takes the results as they follow from the inputs, so those by the
    results are 0; those by the weights are the function's Jacobian. It is inlined: a graph calls only what it needs.
    """
    ins, known, weights = given
    entries = walk(casadi, program, [*ins.entries, *weights.entries, *known.entries])
    symbols, names = [x for group in given for x in group.symbols], [x for group in given for x in group.names]
    n, count = len(ins.names), sum(math.prod(x) for group in given for x in group.shapes)
    blocks = _blocks(casadi, [ins], slopes, entries)
    hessian = casadi.Function(f"hess_{name}", symbols, blocks, names, [f"hess_{k}" for k in range(len(blocks))])
    at = [casadi.MX.sym(x, *shape) for group in given for x, shape in zip(group.names, group.shapes, strict=True)]
    nominal = [casadi.MX.sym(f"out_{x}", *shape) for x, shape in zip(slopes.names, slopes.shapes, strict=True)]
    m = len(known.names)
    by_inputs, by_each = hessian.call(at, False, True), jacobian.call(at[: n + m], False, True)
    made = []
    for k, shape in enumerate(slopes.shapes):
        made += by_inputs[n * k : n * k + n]
        made += [casadi.MX(math.prod(shape), math.prod(x)) for x in known.shapes]
        made += [by_each[n * j + k].T for j in range(m)]
    passed = [*names, *(f"out_{x}" for x in slopes.names)]
    by = [f"jac_{x}_{y}" for x in slopes.names for y in names]
    own = casadi.Function(f"jac_{name}", [*at, *nominal], made, passed, by, {"always_inline": True})
    return {"custom_jacobian": own, "jac_penalty": 1.5 / count}


def walk(casadi: Any, program: Program, inputs: Sequence[Any]) -> list[Any]:
    """The outputs of a program on symbols of CasADi, one per input."""
    functions = {
        DIV: lambda a, b: a / b, SQRT: casadi.sqrt, SIN: casadi.sin, COS: casadi.cos, EXP: casadi.exp,
        ATAN2: casadi.atan2, ABS: casadi.fabs, UFP: casadi.fabs, SELECT: lambda a, b, c: casadi.if_else(a > 0.0, b, c),
    }  # fmt: skip
    program.straight("CasADi")
    lines: list[Any] = []
    for op in program.lines:
        if op.code == INPUT:
            lines.append(inputs[op.a])
        elif op.code == CONST:
            lines.append(casadi.SX(op.value))
        else:
            made = functions.get(op.code, FORMS[op.code].numpy)
            lines.append(made(*(lines[k] if k >= 0 else -lines[-k - 1] for k in signed(op))))
    return [-lines[k] if minus else lines[k] for k, minus in program.outputs]

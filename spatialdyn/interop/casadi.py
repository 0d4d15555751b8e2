"""A Specialized as a function of CasADi."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..calls.exported import Exported
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
from ..errors import SpatialDynError, literal
from .frameworks import framework


def to_casadi(given: Exported, jacobian: Program | None) -> Any:
    """``Specialized.to_casadi``."""
    casadi = framework("casadi")
    if not casadi.Function.check_name(given.name):
        raise SpatialDynError(f"name is {literal(given.name)}, expected a name that CasADi takes")
    inputs, outputs = list(given.inputs), list(given.outputs)
    shapes, results = [matrix(x) for x in given.inputs.values()], [matrix(x) for x in given.outputs.values()]
    symbols = [casadi.SX.sym(x, *shape) for x, shape in zip(inputs, shapes, strict=True)]
    columns = [x[at] for x, shape in zip(symbols, shapes, strict=True) for at in np.argsort(by_columns(shape)).tolist()]
    entries = walk(casadi, given.program, columns)
    values, at = [], 0
    for rows, width in results:
        part = casadi.vertcat(*entries[at : at + rows * width])
        values.append(casadi.reshape(part, width, rows).T)
        at += rows * width
    if jacobian is None:
        return casadi.Function(given.name, symbols, values, inputs, outputs)
    found = walk(casadi, jacobian, columns)
    wide, blocks, row = len(columns), [], 0
    for shape in results:
        taken = [row + k for k in by_columns(shape)]
        first = 0
        for columns_of in shapes:
            order = [first + k for k in by_columns(columns_of)]
            part = casadi.vertcat(*(found[wide * i + j] for j in order for i in taken))
            blocks.append(casadi.reshape(part, len(taken), len(order)))
            first += len(order)
        row += len(taken)
    nominal = [casadi.SX.sym(f"out_{x}", *shape) for x, shape in zip(outputs, results, strict=True)]
    derivatives = casadi.Function(
        f"jac_{given.name}", [*symbols, *nominal], blocks, [*inputs, *(f"out_{x}" for x in outputs)],
        [f"jac_{x}_{y}" for x in outputs for y in inputs],
    )  # fmt: skip
    options = {"custom_jacobian": derivatives, "jac_penalty": 0}
    return casadi.Function(given.name, symbols, values, inputs, outputs, options)


def walk(casadi: Any, program: Program, inputs: list[Any]) -> list[Any]:
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

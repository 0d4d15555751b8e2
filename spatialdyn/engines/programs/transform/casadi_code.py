"""A Program and its Jacobian as one C file with the external interface of CasADi, which acados and IPOPT use too.

The file needs only <math.h>. It holds ``f`` and ``jac_f``. The further inputs of ``jac_f`` are the results of f, which
it does not read; its results are the derivatives of each result of f by each input. Matrices are stored column by
column, as in CasADi.

Source: CasADi's documentation, "Generating C-code", section on the API of the generated code.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..record.operations import FORMS, INPUT
from ..record.program import Program
from .source_code import C, Shapes, SourceText

CASADI = C._replace(value="const casadi_real {};", carried="casadi_real {};")

HEAD = """#include <math.h>

#ifndef casadi_real
#define casadi_real double
#endif
#ifndef casadi_int
#define casadi_int long long int
#endif
#ifdef _WIN32
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED
#endif
"""

FUNCTION = """
EXPORTED int {name}(const casadi_real **arg, casadi_real **res, casadi_int *iw, casadi_real *w, int mem)
{{
    static const casadi_real zeros[{most}] = {{0}};
{body}
    (void) iw, (void) w, (void) mem, (void) zeros, (void) arg, (void) res;
    return 0;
}}

EXPORTED void {name}_incref(void) {{}}
EXPORTED void {name}_decref(void) {{}}
EXPORTED casadi_int {name}_n_in(void) {{ return {n_in}; }}
EXPORTED casadi_int {name}_n_out(void) {{ return {n_out}; }}
EXPORTED const char *{name}_name_in(casadi_int i)
{{
    static const char *const names[] = {{{names_in}}};
    return i >= 0 && i < {n_in} ? names[i] : 0;
}}
EXPORTED const char *{name}_name_out(casadi_int i)
{{
    static const char *const names[] = {{{names_out}}};
    return i >= 0 && i < {n_out} ? names[i] : 0;
}}
EXPORTED const casadi_int *{name}_sparsity_in(casadi_int i)
{{
    static const casadi_int dense[][3] = {{{dense_in}}};
    return i >= 0 && i < {n_in} ? dense[i] : 0;
}}
EXPORTED const casadi_int *{name}_sparsity_out(casadi_int i)
{{
    static const casadi_int dense[][3] = {{{dense_out}}};
    return i >= 0 && i < {n_out} ? dense[i] : 0;
}}
EXPORTED int {name}_work(casadi_int *sz_arg, casadi_int *sz_res, casadi_int *sz_iw, casadi_int *sz_w)
{{
    if (sz_arg) *sz_arg = {n_in};
    if (sz_res) *sz_res = {n_out};
    if (sz_iw) *sz_iw = 0;
    if (sz_w) *sz_w = 0;
    return 0;
}}
"""


def casadi_code(name: str, program: Program, derivatives: Program, inputs: Shapes, outputs: Shapes) -> str:
    """The file. ``derivatives`` has the derivatives of output entries by input entries, row by row."""
    given = {x: matrix(shape) for x, shape in inputs.items()}
    made = {x: matrix(shape) for x, shape in outputs.items()}
    places, at = [], 0
    for shape in made.values():
        places.append([at + k for k in by_columns(shape)])
        at += math.prod(shape)
    text = HEAD + _function(name, program, inputs, given, made, places)
    width = sum(map(math.prod, given.values()))
    blocks, shapes = [], {}
    for (x, rows), taken in zip(made.items(), places, strict=True):
        at = 0
        for y, columns in given.items():
            shapes[f"jac_{x}_{y}"] = (math.prod(rows), math.prod(columns))
            blocks.append([width * row + at + column for column in by_columns(columns) for row in taken])
            at += math.prod(columns)
    nominal = given | {f"out_{x}": shape for x, shape in made.items()}
    return text + _function(f"jac_{name}", derivatives, inputs, nominal, shapes, blocks)


def matrix(shape: Sequence[int]) -> tuple[int, int]:
    """The shape of an array as a matrix: a vector is a column; the last two of three axes become the columns."""
    rows, *columns = (*shape, 1, 1)[: max(2, len(shape))]
    return rows, math.prod(columns)


def by_columns(shape: tuple[int, int]) -> list[int]:
    """The places in C order of a matrix's entries, taken column by column."""
    rows, columns = shape
    return [columns * i + j for j in range(columns) for i in range(rows)]


def _function(
    name: str,
    program: Program,
    read: Shapes,
    inputs: dict[str, tuple[int, int]],
    outputs: dict[str, tuple[int, int]],
    places: Sequence[Sequence[int]],
) -> str:
    """One function, and the functions that describe it.

    read    shapes of the inputs that the program reads: the first ones
    places  for each output, the program's outputs that are its entries, column by column
    """
    entries, owners = [], []
    for k, x in enumerate(read):
        rows, columns = inputs[x]
        entries += [f"{x}[{rows * j + i}]" for i in range(rows) for j in range(columns)]
        owners += [k] * (rows * columns)
    used = {owners[op.a] for op in program.lines if op.code == INPUT}
    text = SourceText(program, entries, {code: form.c for code, form in FORMS.items()}, "INFINITY")
    lines = [f"    const casadi_real *{x} = arg[{k}] ? arg[{k}] : zeros;" for k, x in enumerate(read) if k in used]
    lines += [f"    {line}" for line in text.lines(CASADI)]
    for k, taken in enumerate(places):
        lines.append(f"    if (res[{k}]) {{")
        results = text.results([f"res[{k}][{at}]" for at in range(len(taken))], taken)
        lines += [f"        {line};" for line in results] + ["    }"]
    return FUNCTION.format(
        name=name,
        most=max([1, *(math.prod(shape) for shape in inputs.values())]),
        body="\n".join(lines),
        n_in=len(inputs),
        n_out=len(outputs),
        names_in=", ".join(f'"{x}"' for x in inputs),
        names_out=", ".join(f'"{x}"' for x in outputs),
        dense_in=", ".join(f"{{{r}, {c}, 1}}" for r, c in inputs.values()),
        dense_out=", ".join(f"{{{r}, {c}, 1}}" for r, c in outputs.values()),
    )

"""The operations of a program, and the form of each in every backend.

``FORMS`` has a row for each operation and a column for each backend. A backend runs or prints programs by its column
alone: a new operation is one row, a new backend one column. ``tracer`` registers the functions that record operations
with ``algebra.scalars``.

A region of ``algebra.regions`` is a part of the list between two lines that compute nothing. Each value that a region
carries is a line CARRIED before the region; NEXT lines at the end of the region replace this value:

    CARRIED a        a value, at first a; a later reader reads the present value
    REPEAT a         run the lines up to AGAIN while the carried value a of any sample is above 0
    NEXT a b         the carried value a is b from here on
    AGAIN a          back to the line REPEAT a

In a sample where a is not above 0, each b is selected to be the present value, so other samples do not change it.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

INPUT, CONST, ADD, SUB, MUL, DIV, FMA, FMS, FNMA, SQRT, SIN, COS, EXP, ATAN2, SELECT, ABS, UFP = range(17)
CARRIED, REPEAT, NEXT, AGAIN = range(17, 21)  # lines of regions
REGIONS = {CARRIED: 1, REPEAT: 1, NEXT: 2, AGAIN: 1}  # how many lines each reads


class Operation(NamedTuple):
    """One line of a program: a code and up to three operands, each a line, or -line - 1 for a negated one."""

    code: int
    a: int = 0
    b: int = 0
    c: int = 0
    value: float = 0.0


class Form(NamedTuple):
    """The forms of an operation on a, b, c. Codes that compute nothing (INPUT, CONST, REGIONS) have no row.

    name           in listings; an operator is written between its operands
    arity          number of operands
    counts         names under which ``Program.operations`` counts it
    numpy          a function of arrays or floats; of Fractions too if ``exact``
    c              C99 on doubles, with <math.h>
    python         Python on arrays, with ``imports`` from NumPy
    llvm           a function of an ``llvm_vectors.Vectors`` and of values on lanes; returns the result's name
    double_double  a function of a ``to_double_double.Pairs`` and of Terms; None if there is no such form
    registers      text with functions of ``numbers.double_double``, where each operand is two floats
    exact          whether the operation is rational, and so exact on constants
    angle          whether the first operand is an angle, for which lanes have only the short sine
    signs          whether operands may be negated lines; otherwise the tracer moves signs out of the operation
    """

    name: str
    arity: int
    counts: tuple[str, ...]
    numpy: Callable[..., Any]
    c: str
    python: str
    llvm: Callable[..., str]
    double_double: Callable[..., Any] | None
    registers: str = ""
    imports: str = ""
    exact: bool = False
    angle: bool = False
    signs: bool = False


def _first_place(x: Any) -> Any:
    """Unit in the first place: the largest power of 2 up to |x|; 0 for 0; not finite where x is not finite."""
    m, e = np.frexp(x)
    return np.ldexp(np.where(m == 0.0, m, 0.5 + 0.0 * m), e)


FORMS: dict[int, Form] = {
    ADD: Form(
        "+", 2, ("add",), operator.add, "{a} + {b}", "{a} + {b}",
        lambda t, a, b: t.binary("fadd", a, b), lambda d, a, b: d.add(a.pair, b.pair),
        registers="add({a}, {b})", exact=True,
    ),
    SUB: Form(
        "-", 2, ("add",), operator.sub, "{a} - {b}", "{a} - {b}",
        lambda t, a, b: t.binary("fsub", a, b), lambda d, a, b: d.subtract(a.pair, b.pair),
        registers="subtract({a}, {b})", exact=True,
    ),
    MUL: Form(
        "*", 2, ("mul",), operator.mul, "{a} * {b}", "{a} * {b}",
        lambda t, a, b: t.binary("fmul", a, b), lambda d, a, b: d.multiply(a.factor, b.factor),
        registers="multiply({a}, {b})", exact=True,
    ),
    DIV: Form(
        "/", 2, ("div",), np.divide, "{a} / {b}", "{a} / {b}",
        lambda t, a, b: t.binary("fdiv", a, b), lambda d, a, b: d.divide(a.factor, b.factor),
        registers="divide({a}, {b})", exact=True,
    ),
    FMA: Form(
        "fma", 3, ("mul", "add"), lambda a, b, c: a * b + c, "{a} * {b} + {c}", "{a} * {b} + {c}",
        lambda t, a, b, c: t.fused(a, b, c), None, exact=True,
    ),
    FMS: Form(
        "fms", 3, ("mul", "add"), lambda a, b, c: a * b - c, "{a} * {b} - {c}", "{a} * {b} - {c}",
        lambda t, a, b, c: t.fused(a, b, t.negative(c)), None, exact=True,
    ),
    FNMA: Form(
        "fnma", 3, ("mul", "add"), lambda a, b, c: c - a * b, "{c} - {a} * {b}", "{c} - {a} * {b}",
        lambda t, a, b, c: t.fused(t.negative(a), b, c), None, exact=True,
    ),
    SQRT: Form(
        "sqrt", 1, ("sqrt",), np.sqrt, "sqrt({a})", "sqrt({a})",
        lambda t, a: t.unary("sqrt", a), None, registers="root({a})", imports="sqrt", signs=True,
    ),
    SIN: Form(
        "sin", 1, ("sincos",), np.sin, "sin({a})", "sin({a})",
        lambda t, a: t.sincos(a)[0], lambda d, a: d.turn(a.factor)[0],
        registers="sine({a}, 0.0)", imports="sin", angle=True,
    ),
    COS: Form(
        "cos", 1, ("sincos",), np.cos, "cos({a})", "cos({a})",
        lambda t, a: t.sincos(a)[1], lambda d, a: d.turn(a.factor)[1],
        registers="sine({a}, 1.0)", imports="cos", angle=True,
    ),
    EXP: Form(
        "exp", 1, ("exp",), np.exp, "exp({a})", "exp({a})",
        lambda t, a: t.exp(a), None, registers="exponential({a})", imports="exp", signs=True,
    ),
    ATAN2: Form(
        "atan2", 2, ("atan2",), np.arctan2, "atan2({a}, {b})", "atan2({a}, {b})",
        lambda t, a, b: t.atan2(a, b), None, imports="arctan2 as atan2", signs=True,
    ),
    SELECT: Form(
        "select", 3, ("select",), lambda a, b, c: np.where(a > 0.0, b, c),
        "{a} > 0.0 ? {b} : {c}", "where({a} > 0.0, {b}, {c})",
        lambda t, a, b, c: t.select(t.above_zero(a), b, c), None,
        registers="choose({a}, {b}, {c})", imports="where", signs=True,
    ),
    ABS: Form(
        "abs", 1, ("abs",), np.abs, "fabs({a})", "abs({a})", lambda t, a: t.unary("fabs", a), None, imports="abs",
        exact=True,
    ),
    UFP: Form(
        "ufp", 1, ("ufp",), _first_place, "exp2(logb({a}))", "spacing(abs({a})) * 4503599627370496.0",
        lambda t, a: t.first_place(a), None, imports="spacing",
    ),
}  # fmt: skip


def arities() -> dict[int, int]:
    """How many lines each operation reads."""
    return {INPUT: 0, CONST: 0, **REGIONS, **{code: form.arity for code, form in FORMS.items()}}


def name_of(code: int) -> str:
    """The name of an operation."""
    leaves: Mapping[int, str] = {
        INPUT: "input", CONST: "const", CARRIED: "carried", REPEAT: "repeat", NEXT: "next", AGAIN: "again"
    }  # fmt: skip
    return FORMS[code].name if code in FORMS else leaves[code]


def signed(op: Operation) -> tuple[int, ...]:
    """The operands of a line, as written."""
    form = FORMS.get(op.code)
    return (op.a, op.b, op.c)[: form.arity if form else REGIONS.get(op.code, 0)]


def operands(op: Operation) -> Iterator[int]:
    """The lines that a line reads."""
    return (k if k >= 0 else -k - 1 for k in signed(op))

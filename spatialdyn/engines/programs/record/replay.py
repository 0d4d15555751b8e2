"""Record operations of a program again on another tape, with operands that may be negated or constant."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

from .operations import ABS, ADD, CONST, COS, DIV, FMA, FMS, FNMA, FORMS, MUL, SELECT, SIN, SUB, UFP
from .tracer import Number, Tape

PLAIN: dict[int, Callable[[Any, Any], Any]] = {
    ADD: operator.add, SUB: operator.sub, MUL: operator.mul, DIV: operator.truediv,
}  # fmt: skip
EVEN = (COS, ABS, UFP)


def record(tape: Tape, code: int, given: Sequence[Any]) -> Any:
    """An operation on Numbers or floats, with the same bits as in the program from which it comes."""
    if code in PLAIN:
        return PLAIN[code](*given)
    numbers = [tape.number(x) for x in given]
    if code == SIN or code in EVEN:
        at = tape.line((code, numbers[0].line, 0, 0, 0.0))
        return Number(tape, at, numbers[0].minus and code not in EVEN)
    if code in (FMA, FMS, FNMA):
        a, b, c = numbers
        product, other = (a.minus != b.minus) != (code == FNMA), c.minus != (code == FMS)
        code = FMA if product == other else FMS if other else FNMA
        return Number(tape, tape.line((code, a.line, b.line, c.line, 0.0)), product and other)
    return line(tape, code, *numbers)


def line(tape: Tape, code: int, *given: Any) -> Number:
    """An operation whose operands may be negated."""
    places = [-x.line - 1 if x.minus else x.line for x in map(tape.number, given)]
    a, b, c = (*places, 0, 0)[:3]
    return Number(tape, tape.line((code, a, b, c, 0.0)), False)


def constant_of(x: Any) -> float | None:
    """The value of a constant; None if x varies."""
    if not isinstance(x, Number):
        return float(x)
    code, *_, value = x.tape.lines[x.line]
    return None if code != CONST else -value if x.minus else value


def folded(tape: Tape, code: int, given: Sequence[Any]) -> Any:
    """As ``record``, but folds operations on constants, with the rounding of floats, and selections by a constant."""
    known = [constant_of(x) for x in given]
    if code == SELECT and known[0] is not None:
        return given[1] if known[0] > 0.0 else given[2]
    if None not in known:
        return float(FORMS[code].numpy(*known))
    values = [x if k is None else k for x, k in zip(given, known, strict=True)]
    if code in (FMA, FMS, FNMA):  # products and sums absorb 0 and ±1
        a, b, c = values
        return a * b + c if code == FMA else a * b - c if code == FMS else c - a * b
    return record(tape, code, values)

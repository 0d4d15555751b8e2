"""Bounds on the rounding error of a program's results: running error analysis, line by line.

With each line x a number b is computed such that |x - x*| <= u b, where x* is the line in exact arithmetic on the same
inputs and the robot's numbers, and u is the unit roundoff. b follows from the b of the operands and from the line's own
rounding: half an ulp, which is u times the largest power of 2 up to |x|. That power is 0.72 |x| on average, and costs
no more than |x|. Products of two errors are kept, so the bound holds for errors of any size. The error of a constant
comes from its own arithmetic (``constants``). b is a sum of nonnegative terms, so its own rounding is a relative error,
which is less than ``slack``. A bound is infinite or NaN if nothing is known, as where a divisor may be 0.

Sources: Wilkinson, Rounding errors in algebraic processes (1963); Higham, Accuracy and stability of numerical
algorithms, 2nd ed. (2002), section 3.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..record.operations import (
    ABS,
    ADD,
    ATAN2,
    CONST,
    COS,
    DIV,
    EXP,
    FMA,
    FMS,
    FNMA,
    FORMS,
    INPUT,
    MUL,
    SELECT,
    SIN,
    SQRT,
    SUB,
    UFP,
    Operation,
    signed,
)
from ..record.program import Program
from ..record.replay import line, record
from ..record.tracer import Number, Tape

EXPONENTIAL, ANGLE = 3.0, 7.0  # errors of exp and atan2 in u |x|: an ulp is at most 2 u |x|
# Errors in u |x| of sin and cos on lanes without their last rounding, by size of a number and whether there is fused
# multiply-add. In float64, r = x - n π/2 is off by less than half an ulp (``low``). Of the sine, low (1 - 3 r²/2) is
# left, below 1.0 u |x|, and the polynomial's roundings and its own error are below 0.3 u |x| where r > 1/2, where low's
# share has fallen to 0.65. Of the cosine it is 0.5 for low, 0.56 for the roundings of r² and of the factor of r², 0.05
# for the rest; without fused multiply-add 0.35 for their product. In float32 the largest of all 478 million angles from
# 1e-7 to 1e5 was found: below 1.36 u |x|, beside REDUCED of half an ulp of the angle, which is what n multiples of π/2
# lack, and shows where x is small. Angles below have sin x = x and cos x = 1 to rounding.
TURN = {(8, True): 1.2, (8, False): 1.6, (4, True): 1.36, (4, False): 1.36}
REDUCED = {8: 0.0, 4: 1.5e-8}
LOST = 2.0**-40  # share of a result's error for what arithmetic of constants loses of other results' size: 2⁻¹⁰⁴ of it
UNDERFLOW = {8: 2.0**-900, 4: 2.0**-100}  # by size: far above what an underflow may come to in a result
INFINITE = math.inf


class Bounded(NamedTuple):
    """A line and b, the bound of its error in units of u. Both are Numbers or floats; b is not negative."""

    x: Any
    b: Any

    def __neg__(self) -> Bounded:
        return Bounded(-self.x, self.b)


class Bounding:
    """A tape of lines with bounds.

    u      unit roundoff
    fma    whether the host has fused multiply-add; without it a fused line rounds twice
    slack  more than the relative rounding error of a bound: a few u for each line on the longest path
    """

    def __init__(self, dtype: Any, depth: int, fma: bool) -> None:
        """For programs whose longest path has ``depth`` lines in all."""
        self.tape, self.fma, self.u = Tape(), fma, float(np.finfo(dtype).eps) / 2.0
        self.slack = 8.0 * (depth + 8) * self.u
        size = np.dtype(dtype).itemsize
        self._above, self._narrow = UNDERFLOW[size], size == 4
        self._turned, self._reduced = TURN[size, fma], REDUCED[size]

    def inputs(self, count: int, units: Sequence[Sequence[int]] = (), exact: bool = False) -> list[Bounded]:
        """The inputs of a program.

        In float32 an input is off by half an ulp unless it is exact, since it may have been rounded to float32. Inputs
        in a group of unit norm are off by the error of normalizing the group.
        """
        columns, rounded = [self.tape.input(k) for k in range(count)], self._narrow and not exact
        found = [Bounded(x, self.rounding(x) if rounded else 0.0) for x in columns]
        for group in units:
            excess: Any = -1.0
            for k in group:
                excess = self._line(FMA, columns[k], columns[k], excess)
            # (1 + s)^(-1/2) - 1 is at most 0.51 |s|, and s was rounded four times
            norms = self.fused(0.51 / self.u, self.magnitude(excess), 2.5 + rounded)
            for k in group:
                found[k] = Bounded(columns[k], norms * self.magnitude(columns[k]))
        return found

    def run(self, program: Program, inputs: Sequence[Bounded], bounds: bool = True) -> list[Bounded]:
        """The outputs of a program with their b; if ``bounds`` is false, each b is 0."""
        program.straight("a bound of errors")
        lines: list[Bounded] = []
        for op in program.lines:
            if op.code == INPUT:
                lines.append(inputs[op.a])
            elif op.code == CONST:
                x = self.tape.number(op.value)
                lines.append(Bounded(x, self._of_constant(program, op)) if bounds else self.exact(x))
            else:
                given = [lines[k] if k >= 0 else -lines[-k - 1] for k in signed(op)]
                made = self.apply(op.code, *given) if bounds else self.exact(self._value(op.code, given))
                lines.append(made)
        return [-lines[k] if minus else lines[k] for k, minus in program.outputs]

    def _of_constant(self, program: Program, op: Operation) -> float:
        """b of a constant: its own error, and in float32 the error of rounding it again."""
        assert program.errors is not None
        error = program.errors[op.c]
        if self._narrow:
            error += abs(float(np.float32(op.value)) - op.value)
        # a constant's own arithmetic has twice the digits: its error is far below 2⁻⁴⁰ u
        return error / self.u * (1.0 + self.slack) + abs(op.value) * (2.0**-40 * (error > 0.0))

    def exact(self, x: Any) -> Bounded:
        """A number that has no error."""
        return Bounded(x, 0.0)

    def absolute(self, b: Any) -> Any:
        """The bound of a result with error u b; infinite where b is NaN."""
        return self._known(self.fused(self.u * (1.0 + 2.0 * self.slack), b, self._above))

    def beside(self, values: Sequence[Bounded], found: Sequence[Bounded], places: Sequence[int]) -> list[Any]:
        """Bounds of values at these places, from other values of the same exact numbers whose error is known."""
        pairs = [(values[k].x, found[k]) for k in places]
        errors = [self.fused(1.0 / self.u, self.magnitude(x - y.x), y.b) for x, y in pairs]
        total: Any = 0.0
        for b in errors:
            total = total + b
        return [self.absolute(self.fused(LOST, total, b)) for b in errors]

    def solved(self, inverse: Sequence[Sequence[Bounded]], residual: Sequence[Bounded]) -> list[Any]:
        """Bounds |A⁻¹| |residual| of a solution x, from its residual A x - y and from A⁻¹ of known error."""
        sizes = [self.upper(r) for r in residual]
        found = []
        for row in inverse:
            total: Any = 0.0
            for entry, size in zip(row, sizes, strict=True):
                total = self.fused(self.upper(entry), size, total)
            found.append(self._known(self.fused(1.0 + 2.0 * self.slack, total, self._above)))
        return found

    def product(self, matrix: Sequence[Bounded], column: Sequence[Any], j: int) -> list[Bounded]:
        """A x - e, for a matrix A of known error, a column x of numbers without error, and e the unit vector j."""
        n, found = len(column), []
        for i in range(n):
            total = Bounded(self.tape.number(-1.0) if i == j else 0.0, 0.0)
            for entry, x in zip(matrix[n * i : n * i + n], column, strict=True):
                total = self.apply(FMA, entry, self.exact(x), total)
            found.append(total)
        return found

    def _known(self, bound: Any) -> Any:
        return self._above_zero(bound, bound, INFINITE)

    def apply(self, code: int, *given: Bounded) -> Bounded:
        """An operation, with its b."""
        x = self._value(code, given)
        known = not isinstance(x, Number) and all(_zero(y.b) for y in given)  # x - x is 0 of floats alone
        return Bounded(x, 0.0 if known else _RULES[code](self, x, *given))

    def _value(self, code: int, given: Sequence[Bounded]) -> Any:
        return record(self.tape, code, [x.x for x in given])

    # -- nonnegative numbers

    def magnitude(self, x: Any) -> Any:
        """|x|."""
        if not isinstance(x, Number):
            return abs(x)
        code, *_, constant = self.tape.lines[x.line]
        if code == CONST:
            return self.tape.number(abs(constant))
        return Number(self.tape, x.line if code == ABS else self.tape.line((ABS, x.line, 0, 0, 0.0)), False)

    def rounding(self, x: Any) -> Any:
        """Half an ulp of x in units of u: more than its rounding error."""
        code, *_, constant = self.tape.lines[x.line] if isinstance(x, Number) else (CONST, x)
        return self._line(UFP, Number(self.tape, x.line, False)) if code != CONST else float(FORMS[UFP].numpy(constant))

    def upper(self, x: Bounded) -> Any:
        """A bound on |x*|."""
        return self.fused(self.u * (1.0 + self.slack), x.b, self.magnitude(x.x))

    def fused(self, a: Any, b: Any, c: Any) -> Any:
        """a b + c in one operation."""
        if any(not isinstance(x, Number) and x in (0.0, 1.0) for x in (a, b)) or _zero(c):
            return a * b + c
        return self._line(FMA, a, b, c)

    def _above_zero(self, condition: Any, a: Any, b: Any) -> Any:
        """a where the condition is more than 0, else b."""
        return self._line(SELECT, condition, a, b)

    def _certain(self, x: Bounded) -> Any:
        """A lower bound of |x*|: more than 0 only if |x*| is certainly more than 0."""
        if _zero(x.b):
            return self.magnitude(x.x)
        return self._line(FNMA, self.u * (1.0 + self.slack), x.b, self.magnitude(x.x))

    def _line(self, code: int, *given: Any) -> Number:
        return line(self.tape, code, *given)

    # -- lines

    def _sum(self, x: Number, a: Bounded, b: Bounded) -> Any:
        return a.b + b.b + self.rounding(x)

    def _product(self, x: Number, a: Bounded, b: Bounded) -> Any:
        return self._of_product(a, b, self.rounding(x))

    def _of_product(self, a: Bounded, b: Bounded, rest: Any) -> Any:
        """b of a product and ``rest``: a* b* - a b = (b* - b) a* + (a* - a) b."""
        if not _zero(a.b):
            rest = self.fused(self.magnitude(b.x), a.b, rest)
        return rest if _zero(b.b) else self.fused(self.upper(a), b.b, rest)

    def _of_fused(self, x: Number, a: Bounded, b: Bounded, c: Bounded) -> Any:
        rest = c.b + self.rounding(x)
        if not self.fma:
            rest = self.fused(self.magnitude(a.x), self.magnitude(b.x), rest)
        return self._of_product(a, b, rest)

    def _quotient(self, x: Number, a: Bounded, b: Bounded) -> Any:
        last = self.rounding(x)
        if _zero(b.b):
            return last if _zero(a.b) else a.b / self.magnitude(b.x) + last
        least = self._certain(b)
        return self._above_zero(least, self.fused(self.magnitude(x), b.b, a.b) / least, INFINITE) + last

    def _root(self, x: Number, a: Bounded) -> Any:
        last = self.rounding(x)
        return last if _zero(a.b) else self._above_zero(x, a.b / x, INFINITE) + last

    def _turn(self, x: Number, a: Bounded) -> Any:
        moved = self.fused(self._reduced, self.rounding(a.x), a.b)
        return self.fused(self._turned, self.magnitude(x), moved + self.rounding(x))

    def _exponential(self, x: Number, a: Bounded) -> Any:
        if _zero(a.b):
            return EXPONENTIAL * x
        error = self.tape.number(self.u * (1.0 + self.slack)) * a.b  # e^error - 1 <= error + error² up to 1
        known = self._above_zero(1.0 - error, self.fused(error, a.b, a.b), INFINITE)
        return self.fused(known, x, EXPONENTIAL * x)

    def _angle(self, x: Number, a: Bounded, b: Bounded) -> Any:
        if _zero(a.b) and _zero(b.b):
            return ANGLE * self.magnitude(x)
        # moving a point at distance r by d turns it by at most π d / r; √2 r >= |x| + |y|; across the cut by 2 π
        moved = (math.pi * math.sqrt(2.0)) * (a.b + b.b) / (self.magnitude(a.x) + self.magnitude(b.x))
        left = b.x - self.u * (1.0 + self.slack) * b.b
        one_side = self._above_zero(self._certain(a), moved, self._above_zero(left, moved, INFINITE))
        return self.fused(ANGLE, self.magnitude(x), one_side)

    def _choice(self, x: Number, condition: Bounded, a: Bounded, b: Bounded) -> Any:
        chosen = self._above_zero(condition.x, a.b, b.b)
        if _zero(condition.b):
            return chosen
        either = self.fused(1.0 / self.u, self.magnitude(a.x - b.x), a.b + b.b)
        return self._above_zero(self._certain(condition), chosen, either)

    def _magnitude(self, x: Number, a: Bounded) -> Any:
        return a.b

    def _first_place(self, x: Number, a: Bounded) -> Any:
        return 0.0 if _zero(a.b) else (1.0 / self.u) * self.upper(a)


_RULES: dict[int, Callable[..., Any]] = {
    ADD: Bounding._sum, SUB: Bounding._sum, MUL: Bounding._product, DIV: Bounding._quotient, FMA: Bounding._of_fused,
    FMS: Bounding._of_fused, FNMA: Bounding._of_fused, SQRT: Bounding._root, SIN: Bounding._turn, COS: Bounding._turn,
    EXP: Bounding._exponential, ATAN2: Bounding._angle, SELECT: Bounding._choice, ABS: Bounding._magnitude,
    UFP: Bounding._first_place,
}  # fmt: skip


def _zero(x: Any) -> bool:
    return not isinstance(x, Number) and x == 0.0

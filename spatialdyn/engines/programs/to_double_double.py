"""Double-double on SIMD lanes: a program in which every number is a sum of two floats, made of plain float operations.

Sums and products of a recorded program become sequences that keep what a rounding loses (TwoSum; TwoProduct, by one
fused operation where the host has it), so the same recursion runs with 100 bits on the engine for floats. Nothing may
reorder these sequences: lanes are compiled without any fast-math flag, and the tracer fuses no product that is read
twice, as the product of a TwoProduct is.

sin and cos are those of float64, scaled to unit length: the exact pair of an angle that is off by an ulp or two.

Sources: Dekker, A floating-point technique for extending the available precision (1971); Joldes, Muller, Popescu, Tight
and rigorous error bounds for basic building blocks of double-word arithmetic (2017).
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from ...errors import SpatialDynError
from .tracer import ADD, CONST, COS, DIV, FMS, INPUT, MUL, SIN, SUB, Number, Operation, Program, Tape

SPLITTER = 134217729.0  # 2^27 + 1

EXACT: dict[int, Callable[[Fraction, Fraction], Fraction]] = {
    ADD: operator.add, SUB: operator.sub, MUL: operator.mul, DIV: operator.truediv
}  # fmt: skip

Pair = tuple[Any, Any]


def doubled(program: Program, fma: bool) -> Program:
    """A program, recorded without fused operations, in double-double; its results are rounded at the very end.

    fma  whether the host multiplies and adds in one rounding
    Raises SpatialDynError for an operation that there is not in double-double.
    """
    made = _Pairs(fma)
    pairs: list[Pair] = []
    normal: dict[int, Pair] = {}
    known: dict[int, Fraction] = {}  # what depends on the model alone

    def factor(k: int) -> Pair:
        """A pair whose low part is below the high one's last digit, as products need it."""
        if k not in normal:
            summed = program.lines[k].code in (ADD, SUB)
            normal[k] = made.quick_sum(*pairs[k]) if summed else pairs[k]
        return normal[k]

    for k, op in enumerate(program.lines):
        if op.code == CONST:
            known[k] = Fraction(op.value)
        elif op.code in EXACT and op.a in known and op.b in known:
            known[k] = EXACT[op.code](known[op.a], known[op.b])
        if k in known:
            high = float(known[k])
            low = float(known[k] - Fraction(high))
            known[k] = Fraction(high) + Fraction(low)
            pairs.append((made.constant(high), made.constant(low)))
        elif op.code == INPUT:
            pairs.append((made.tape.input(op.a), 0.0))
        elif op.code == ADD:
            pairs.append(made.add(pairs[op.a], pairs[op.b]))
        elif op.code == SUB:
            high, low = pairs[op.b]
            pairs.append(made.add(pairs[op.a], (-high, -low)))
        elif op.code == MUL:
            pairs.append(made.multiply(factor(op.a), factor(op.b)))
        elif op.code == DIV:
            pairs.append(made.divide(factor(op.a), factor(op.b)))
        elif op.code in (SIN, COS):
            pairs.append(made.turn(factor(op.a)[0])[op.code == COS])
        else:
            raise SpatialDynError(f"operation {op.code} has no double-double form, expected + - * / sin cos")
    results = [-(h + l) if minus else h + l for (h, l), minus in ((pairs[k], minus) for k, minus in program.outputs)]
    return Program(made.tape, results, program.inputs)


class _Pairs:
    """The arithmetic of pairs of Numbers; a low part may be the float 0.0, which costs nothing."""

    def __init__(self, fma: bool) -> None:
        """On a tape of its own."""
        self.tape, self.fma = Tape(), fma

    def constant(self, value: float) -> Any:
        """A Number, or 0 and 1 as they are, which cost nothing."""
        return value if value in (0.0, 1.0) else self.tape.number(value)

    def two_sum(self, a: Number, b: Number) -> Pair:
        """a + b as it is rounded, and what that loses."""
        s = a + b
        t = s - a
        return s, (a - (s - t)) + (b - t)

    def quick_sum(self, a: Any, b: Any) -> Pair:
        """The same for |a| >= |b|."""
        if not isinstance(a, Number) or not isinstance(b, Number):
            return a + b, 0.0
        s = a + b
        return s, b - (s - a)

    def two_product(self, a: Number, b: Number) -> Pair:
        """a b as it is rounded, and what that loses."""
        x, y = (a, b) if a.line <= b.line else (b, a)
        minus = a.minus != b.minus
        # as a line of its own: a Number takes x · (1/x) for 1, which here is what is asked
        p = Number(self.tape, self.tape.line(Operation(MUL, x.line, y.line)), minus)
        if not self.fma:
            t, u = SPLITTER * a, SPLITTER * b
            ah, bh = t - (t - a), u - (u - b)
            al, bl = a - ah, b - bh
            return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl
        return p, Number(self.tape, self.tape.line(Operation(FMS, x.line, y.line, p.line)), minus)

    def add(self, a: Pair, b: Pair) -> Pair:
        """a + b, to an ulp of 106 bits of |a| + |b|; the low part is not brought below the high one's last digit."""
        for x, other in ((a, b), (b, a)):
            if not isinstance(x[0], Number) and x[0] == 0.0:
                return other
        s, e = self.two_sum(*(self.tape.number(x) for x in (a[0], b[0])))
        return s, (a[1] + b[1]) + e

    def multiply(self, a: Pair, b: Pair) -> Pair:
        """a b of pairs in order."""
        for x, other in ((a, b), (b, a)):
            if not isinstance(x[0], Number):  # 0 or 1
                return other if x[0] else (0.0, 0.0)
        p, e = self.two_product(a[0], b[0])
        return p, (e + a[0] * b[1]) + a[1] * b[0]

    def divide(self, a: Pair, b: Pair) -> Pair:
        """a / b of pairs in order."""
        if not isinstance(b[0], Number) or (not isinstance(a[0], Number) and not a[0]):
            return a
        a = self.tape.number(a[0]), a[1]
        x = a[0] / b[0]
        p, e = self.two_product(x, b[0])
        rest = ((a[0] - p) - e) + (a[1] - x * b[1])  # a - p is exact
        return self.quick_sum(x, rest / b[0])

    def turn(self, angle: Number) -> tuple[Pair, Pair]:
        """(sin, cos) of a float, scaled to unit length."""
        s = Number(self.tape, self.tape.line(Operation(SIN, angle.line)), angle.minus)
        c = Number(self.tape, self.tape.line(Operation(COS, angle.line)), False)
        p, e = self.two_product(s, s)
        r, f = self.two_product(c, c)
        total, lost = self.two_sum(p, r)
        half = -0.5 * ((total - 1.0) + (lost + (e + f)))  # of what the squares have too much
        return (s, half * s), (c, half * c)

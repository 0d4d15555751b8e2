"""Double-double on SIMD lanes: a program whose numbers are sums of two floats, in plain float operations.

Sums and products of a recorded program become sequences that keep the rounding error (TwoSum; TwoProduct, by one fused
operation if the host has it), so the same recursion runs with 100 bits on the engine for floats. These sequences must
not be reordered or fused: lanes are compiled without any fast-math flag, and a Program fuses no product that is read
twice, which the product of a TwoProduct is.

sin and cos are those of float64, scaled to unit length: the exact pair of an angle that is off by an ulp or two.

Sources: Dekker, A floating-point technique for extending the available precision (1971); Joldes, Muller, Popescu, Tight
and rigorous error bounds for basic building blocks of double-word arithmetic (2017).
"""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from typing import Any

from ....errors import SpatialDynError
from ..record.constants import SPLITTER
from ..record.operations import ADD, CONST, COS, FMS, FORMS, INPUT, MUL, SIN, SUB, Operation, name_of, signed
from ..record.program import Program
from ..record.tracer import Number, Tape

Pair = tuple[Any, Any]


def to_double_double(program: Program, fma: bool) -> Program:
    """A program, recorded without fused operations, in double-double; only its results are rounded to float64.

    fma  whether the host has fused multiply-add
    Raises SpatialDynError for an operation without a double-double form.
    """
    program.straight("double-double")
    made = Pairs(fma)
    terms: list[Term] = []
    known: dict[int, Fraction] = {}  # {line: value} of lines that depend only on the model
    for k, op in enumerate(program.lines):
        form, places = FORMS.get(op.code), signed(op)
        if op.code == CONST:
            known[k] = Fraction(op.value)
        elif form and form.exact and known.keys() >= set(places):
            known[k] = form.numpy(*(known[i] for i in places))
        if k in known:
            high = float(known[k])
            low = float(known[k] - Fraction(high))
            known[k] = Fraction(high) + Fraction(low)
            pair: Pair = made.constant(high), made.constant(low)
        elif op.code == INPUT:
            pair = made.tape.input(op.a), 0.0
        elif form and form.double_double:
            pair = form.double_double(made, *(terms[i] for i in places))
        else:
            there = " ".join(form.name for form in FORMS.values() if form.double_double)
            raise SpatialDynError(f"operation {name_of(op.code)} has no double-double form, expected {there}")
        terms.append(Term(made, pair, op.code in (ADD, SUB)))
    pairs = [term.pair for term in terms]
    results = [-(h + l) if minus else h + l for (h, l), minus in ((pairs[k], minus) for k, minus in program.outputs)]
    return Program(made.tape, results, program.inputs)


class Term:
    """The pair of a line, in the forms that its readers need."""

    def __init__(self, made: Pairs, pair: Pair, summed: bool) -> None:
        """``summed``: the low part may overlap the high part."""
        self._made, self.pair, self._summed = made, pair, summed

    @cached_property
    def factor(self) -> Pair:
        """The pair without overlap, which products need."""
        return self._made.fast_two_sum(*self.pair) if self._summed else self.pair


class Pairs:
    """Arithmetic on pairs of Numbers; a low part that is the float 0.0 costs nothing."""

    def __init__(self, fma: bool) -> None:
        """Record on a new tape."""
        self.tape, self.fma = Tape(), fma

    def constant(self, value: float) -> Any:
        """A constant as a Number; 0 and 1 stay floats, which cost nothing."""
        return value if value in (0.0, 1.0) else self.tape.number(value)

    def two_sum(self, a: Number, b: Number) -> Pair:
        """a + b rounded, and the rounding error."""
        s = a + b
        t = s - a
        return s, (a - (s - t)) + (b - t)

    def fast_two_sum(self, a: Any, b: Any) -> Pair:
        """As ``two_sum``, for |a| >= |b|."""
        if not isinstance(a, Number) or not isinstance(b, Number):
            return a + b, 0.0
        s = a + b
        return s, b - (s - a)

    def two_product(self, a: Number, b: Number) -> Pair:
        """a b rounded, and the rounding error."""
        x, y = (a, b) if a.line <= b.line else (b, a)
        minus = a.minus != b.minus
        # written to the tape directly: the operator * would fold x · (1/x) to 1, but its error is needed here
        p = Number(self.tape, self.tape.line(Operation(MUL, x.line, y.line)), minus)
        if not self.fma:
            t, u = SPLITTER * a, SPLITTER * b
            ah, bh = t - (t - a), u - (u - b)
            al, bl = a - ah, b - bh
            return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl
        return p, Number(self.tape, self.tape.line(Operation(FMS, x.line, y.line, p.line)), minus)

    def add(self, a: Pair, b: Pair) -> Pair:
        """a + b, within an ulp (of 106 bits) of |a| + |b|; the low part may overlap the high part."""
        for x, other in ((a, b), (b, a)):
            if not isinstance(x[0], Number) and x[0] == 0.0:
                return other
        s, e = self.two_sum(*(self.tape.number(x) for x in (a[0], b[0])))
        return s, (a[1] + b[1]) + e

    def subtract(self, a: Pair, b: Pair) -> Pair:
        """a - b, as ``add``."""
        return self.add(a, (-b[0], -b[1]))

    def multiply(self, a: Pair, b: Pair) -> Pair:
        """a b of pairs without overlap."""
        for x, other in ((a, b), (b, a)):
            if not isinstance(x[0], Number):  # 0 or 1
                return other if x[0] else (0.0, 0.0)
        p, e = self.two_product(a[0], b[0])
        return p, (e + a[0] * b[1]) + a[1] * b[0]

    def divide(self, a: Pair, b: Pair) -> Pair:
        """a / b of pairs without overlap."""
        if not isinstance(b[0], Number) or (not isinstance(a[0], Number) and not a[0]):
            return a
        a = self.tape.number(a[0]), a[1]
        x = a[0] / b[0]
        p, e = self.two_product(x, b[0])
        rest = ((a[0] - p) - e) + (a[1] - x * b[1])  # a - p is exact
        return self.fast_two_sum(x, rest / b[0])

    def turn(self, a: Pair) -> tuple[Pair, Pair]:
        """(sin, cos) of the high part, scaled to unit length."""
        angle = a[0]
        s = Number(self.tape, self.tape.line(Operation(SIN, angle.line)), angle.minus)
        c = Number(self.tape, self.tape.line(Operation(COS, angle.line)), False)
        p, e = self.two_product(s, s)
        r, f = self.two_product(c, c)
        total, lost = self.two_sum(p, r)
        half = -0.5 * ((total - 1.0) + (lost + (e + f)))  # -1/2 times the excess of the squares over 1
        return (s, half * s), (c, half * c)

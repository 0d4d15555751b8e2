"""Constants of a program with twice the digits of float64, so that constant folding costs none.

Operations of a recorded recursion on the robot's numbers alone are folded into constants, D⁻¹ U Uᵀ of a tip body among
them. In float64 each of these operations would round, where Numba's kernels fuse a product and a sum: for a thin rod
hinged about an oblique axis a batch had 246 eps and a single call 15. Here a constant is a float and its rounding
error, and is rounded once, where it meets an input.
"""

from __future__ import annotations

import math
from typing import Any

SPLITTER = 134217729.0  # 2^27 + 1
REAL = (float, int)
_new = float.__new__


class Constant(float):
    """A float and its rounding error ``low``; a sum is 0 where that of the floats is, so programs keep their zeros.

    What such sums dropped is at most ``off``, which only bounds of a program's errors read.
    Comparisons, and functions of floats, use the float alone.
    """

    __slots__ = ("high", "low", "off")
    high: float
    low: float
    off: float

    def __new__(cls, high: float, low: float = 0.0, off: float = 0.0) -> Constant:
        """The sum of two floats without overlap."""
        made = _new(cls, high)
        made.high, made.low, made.off = high, low, off
        return made

    def __neg__(self) -> Constant:
        return Constant(-self.high, -self.low, self.off)

    def __abs__(self) -> Constant:
        return -self if self < 0.0 else self

    def __add__(self, other: Any) -> Any:
        return _sum(self, other) if isinstance(other, REAL) else NotImplemented

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return _sum(self, -other) if isinstance(other, REAL) else NotImplemented

    def __rsub__(self, other: Any) -> Any:
        return _sum(-self, other) if isinstance(other, REAL) else NotImplemented

    def __mul__(self, other: Any) -> Any:
        return _product(self, other) if isinstance(other, REAL) else NotImplemented

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        return _quotient(self, other) if isinstance(other, REAL) else NotImplemented

    def __rtruediv__(self, other: Any) -> Any:
        return _quotient(other, self) if isinstance(other, REAL) else NotImplemented


def constant(x: float) -> float:
    """A number of the robot: a Constant, or 0 as it is, with which floats compute exactly."""
    return Constant(x) if x else x


def error_of(x: Any) -> float:
    """By how much a number differs from the exact one that it stands for, at most."""
    return abs(x.low) + x.off if type(x) is Constant else 0.0


def _parts(x: float) -> tuple[float, float, float]:
    return (x.high, x.low, x.off) if type(x) is Constant else (float(x), 0.0, 0.0)


def _fast_two_sum(high: float, low: float, off: float) -> Constant:
    """The sum of a float and a smaller one; the float alone if the sum is not finite."""
    total = high + low
    if total - total == 0.0:  # finite
        made: Constant = _new(Constant, total)
        made.high, made.low, made.off = total, low - (total - high), off
        return made
    return Constant(high, 0.0, off)


def _two_product(a: float, b: float) -> tuple[float, float]:
    """a b rounded, and the rounding error (Dekker)."""
    p, t, u = a * b, SPLITTER * a, SPLITTER * b
    ah, bh = t - (t - a), u - (u - b)
    al, bl = a - ah, b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


def _sum(x: float, y: float) -> float:
    (a, low, off), (b, other, more) = _parts(x), _parts(y)
    s = a + b
    off += more
    if s == 0.0:
        off += abs(low + other)
        return Constant(0.0, 0.0, off) if off else 0.0
    t = s - a
    return _fast_two_sum(s, (a - (s - t)) + (b - t) + (low + other), off)


def _product(x: float, y: float) -> Constant:
    """With ``_two_product`` and ``_fast_two_sum`` written out: recording a model's numbers is mostly this."""
    a, low, off = (x.high, x.low, x.off) if type(x) is Constant else (float(x), 0.0, 0.0)
    b, other, more = (y.high, y.low, y.off) if type(y) is Constant else (float(y), 0.0, 0.0)
    p, t, u = a * b, SPLITTER * a, SPLITTER * b
    ah, bh = t - (t - a), u - (u - b)
    al, bl = a - ah, b - bh
    rest = ((ah * bh - p) + ah * bl + al * bh) + al * bl + (a * other + low * b)
    if off or more:
        off = _known(abs(a) * more + off * (abs(b) + more))
    total = p + rest
    if total - total != 0.0:  # not finite
        return Constant(p, 0.0, off)
    made: Constant = _new(Constant, total)
    made.high, made.low, made.off = total, rest - (total - p), off
    return made


def _quotient(x: float, y: float) -> Constant:
    (a, low, off), (b, other, more) = _parts(x), _parts(y)
    q = a / b
    p, lost = _two_product(q, b)
    if off or more:
        off = _known((off + abs(q) * more) / (abs(b) - more)) if abs(b) > more else math.inf
    return _fast_two_sum(q, ((a - p) - lost + (low - q * other)) / b, off)


def _known(off: float) -> float:
    return math.inf if math.isnan(off) else off

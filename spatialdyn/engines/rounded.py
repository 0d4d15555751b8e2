"""How far rounding carries a result: a recursion on numbers that round up or down by the toss of a coin.

A few runs of the same recursion differ by about what a run of its precision is off. Operations without a rounding
error (a product with 1 or 0, a sum that fits) toss nothing, so that what is exact in a model stays exact.

Results are computed in float64 and rounded to so many bits; those of float32 have its range too, and are infinite above
it and on its fixed grid below. For float64 itself these are DOUBLE, one less than it has:
whether an operation was exact is seen in the last bit, and the toss is worth half of it.
"""

from __future__ import annotations

import math
import random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import scalars
from ..recursions.spec import Spec
from .regroup import regroup
from .trace import evaluate, table

DOUBLE = 52
SINGLE = 24
RANGES = {DOUBLE: (-1073, 1024), SINGLE: (-125, 128)}  # exponents of a fraction below 1
# Standard error of an inexact operation in units of the last place (of 53 bits, of 24 bits): of a toss, which is off by
# 1 in half of all cases, or by f or 1 - f with f uniform; over that of rounding to nearest, √(1/12).
LOUDER = {DOUBLE: math.sqrt(1 / 2) * math.sqrt(12), SINGLE: math.sqrt(1 / 3) * math.sqrt(12)}


class Coin:
    """Rounding to so many bits, up or down by chance; one seed gives the same tosses again."""

    def __init__(self, bits: int, seed: int) -> None:
        """Of DOUBLE or SINGLE bits."""
        self.bits, self._toss = bits, random.Random(seed).random
        self._least, self._most = RANGES[bits]

    def rounded(self, x: float) -> Rounded:
        """One of the two neighbours of x, or x if it has no more bits."""
        fraction, exponent = math.frexp(x)
        bits = self.bits
        if exponent < self._least:
            bits += exponent - self._least
            if bits < 0:  # less than half of the least number
                return Rounded(0.0 * x, self)
        whole = math.ldexp(fraction, bits)
        if whole - whole == 0.0:  # neither infinite nor nan
            below = math.floor(whole)
            if below != whole:
                x = math.ldexp(below + (self._toss() < 0.5), exponent - bits)
            if exponent > self._most:
                x = math.copysign(math.inf, x)
        return Rounded(x, self)

    def number(self, x: float) -> Rounded:
        """A number that is given: to the nearest if float64 holds it, by toss if it loses digits on the way in."""
        if self.bits < DOUBLE:
            return self.rounded(x)
        fraction, exponent = math.frexp(x)
        return Rounded(math.ldexp(round(math.ldexp(fraction, DOUBLE)), exponent - DOUBLE), self)


class Rounded:
    """A number whose every operation is rounded by its coin."""

    __slots__ = ("coin", "x")

    def __init__(self, x: float, coin: Coin) -> None:
        """x, as it is."""
        self.x, self.coin = x, coin

    def __neg__(self) -> Rounded:
        return Rounded(-self.x, self.coin)

    def __abs__(self) -> Rounded:
        return Rounded(abs(self.x), self.coin)

    def __float__(self) -> float:
        return self.x

    def __add__(self, other: Any) -> Rounded:
        return self.coin.rounded(self.x + float(other))

    __radd__ = __add__

    def __sub__(self, other: Any) -> Rounded:
        return self.coin.rounded(self.x - float(other))

    def __rsub__(self, other: Any) -> Rounded:
        return self.coin.rounded(float(other) - self.x)

    def __mul__(self, other: Any) -> Rounded:
        return self.coin.rounded(self.x * float(other))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Rounded:
        return self.coin.rounded(self.x / float(other))

    def __rtruediv__(self, other: Any) -> Rounded:
        return self.coin.rounded(float(other) / self.x)

    def __gt__(self, other: Any) -> bool:
        return self.x > float(other)

    def __lt__(self, other: Any) -> bool:
        return self.x < float(other)

    def __ge__(self, other: Any) -> bool:
        return self.x >= float(other)

    def __le__(self, other: Any) -> bool:
        return self.x <= float(other)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, (float, int, Rounded)) and self.x == float(other)

    def __hash__(self) -> int:
        return hash(self.x)


scalars.sin.register(Rounded)(lambda a: a.coin.rounded(scalars.sin(a.x)))
scalars.cos.register(Rounded)(lambda a: a.coin.rounded(scalars.cos(a.x)))
scalars.sqrt.register(Rounded)(lambda a: a.coin.rounded(scalars.sqrt(a.x)))
scalars.atan2.register(Rounded)(lambda a, b: a.coin.rounded(math.atan2(a.x, float(b))))


def spread(
    spec: Spec,
    bodies: NDArray[Any],
    inputs: dict[str, NDArray[np.float64]],
    shape: tuple[int, ...],
    bits: int,
    runs: int,
    seed: int = 0,
) -> float:
    """The error to expect, of the largest entry: from the root mean square of how far runs are off their mean.

    inputs  arrays of one sample, by name
    shape   of the output
    Returns infinity where a run divides by zero or gives no numbers.
    """
    found = []
    if bits == SINGLE and spec.regroup:  # as a program has it, whose constants are rounded after that
        bodies = bodies.copy()
        regroup(bodies, spec.pivots)
    for run in range(runs):
        coin = Coin(bits, seed + run)
        given = {name: _numbers(coin, x) for name, x in inputs.items()}
        pivots = np.full(len(bodies) - 1, None, dtype=object)
        try:
            out = evaluate(spec, table(bodies, coin.number), shape, given, pivots)
        except (ZeroDivisionError, OverflowError):
            return math.inf
        found.append(out.astype(float))
    mean = np.mean(found, axis=0)
    size = float(abs(mean).max(initial=0.0))
    if not np.isfinite(found).all():
        return math.inf
    if size == 0.0:
        return 0.0
    off = abs(np.array(found) - mean).reshape(runs, -1).max(axis=1) / size
    return float(np.sqrt((off**2).sum() / (runs - 1))) / LOUDER[bits]


def _numbers(coin: Coin, x: NDArray[np.float64]) -> NDArray[Any]:
    made = np.empty(x.shape, dtype=object)
    for at in np.ndindex(x.shape):
        made[at] = coin.number(float(x[at]))
    return made

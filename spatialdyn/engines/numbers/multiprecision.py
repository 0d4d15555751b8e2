"""Truth: a recursion on numbers of any precision, or on exact rationals, from the very source that everything runs.

The numbers of a table are the doubles they are: what comes out is what float64 would give if it did not round while it
computes. Its rotations are orthonormal to rounding only, so two algorithms that are equal for true rotations (q̈ of
ABA, and the q̈ whose RNEA is τ) differ here by the condition of the problem times 1e-16, unless every entry is 0 or ±1.

``Digits`` are mpmath's numbers in a context of their own, whose precision nobody else sees. ``Rationals`` know no
sine: an angle is given as t = tan(q/2), which makes cos q = (1 - t²)/(1 + t²) and sin q = 2t/(1 + t²).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra import scalars
from ...bodies.table import PLANAR, REVOLUTE
from ...errors import SpatialDynError

LEAST = 53  # bits: float64's own
MOST = 1 << 20  # a product takes milliseconds
GUARD = 320  # bits more to compute in: the closed forms of lie cancel twice 36 digits next to no rotation


# --- exact rationals ----------------------------------------------------------------------------------------


class Ratio:
    """A fraction that takes the floats it meets at their exact binary value; a Fraction turns into a float there."""

    __slots__ = ("value",)

    def __init__(self, value: Any) -> None:
        """The fraction of an int, a float, a Fraction or another Ratio."""
        self.value: Fraction = value.value if isinstance(value, Ratio) else Fraction(value)

    def __neg__(self) -> Ratio:
        return Ratio(-self.value)

    def __abs__(self) -> Ratio:
        return Ratio(abs(self.value))

    def __add__(self, other: Any) -> Ratio:
        return Ratio(self.value + Ratio(other).value)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Ratio:
        return Ratio(self.value - Ratio(other).value)

    def __rsub__(self, other: Any) -> Ratio:
        return Ratio(Ratio(other).value - self.value)

    def __mul__(self, other: Any) -> Ratio:
        return Ratio(self.value * Ratio(other).value)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Ratio:
        return Ratio(self.value / Ratio(other).value)

    def __rtruediv__(self, other: Any) -> Ratio:
        return Ratio(Ratio(other).value / self.value)

    def __gt__(self, other: Any) -> bool:
        return self.value > Ratio(other).value

    def __le__(self, other: Any) -> bool:
        return self.value <= Ratio(other).value


class Angle:
    """An angle q given by t = tan(q/2); it has a sine and a cosine, and nothing else is known of it."""

    __slots__ = ("tangent",)

    def __init__(self, tangent: Ratio) -> None:
        """Of a tangent."""
        self.tangent = tangent

    def _refuse(self, *others: Any) -> Any:
        raise SpatialDynError(
            "an angle given as tan(q/2) has no rational value, expected a call that takes its sine and cosine only"
        )

    __neg__ = __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = __truediv__ = __rtruediv__ = _refuse
    __abs__ = __gt__ = __le__ = _refuse


def _irrational(name: str) -> Callable[..., Any]:
    def refuse(*x: Any) -> Any:
        raise SpatialDynError(f"{name} of a rational is no rational, expected a call made of + - * / or bits=240")

    return refuse


scalars.sin.register(Angle)(lambda q: 2.0 * q.tangent / (1.0 + q.tangent * q.tangent))
scalars.cos.register(Angle)(lambda q: (1.0 - q.tangent * q.tangent) / (1.0 + q.tangent * q.tangent))
scalars.sin.register(Ratio)(_irrational("sin"))
scalars.cos.register(Ratio)(_irrational("cos"))
scalars.sqrt.register(Ratio)(_irrational("sqrt"))
scalars.atan2.register(Ratio)(_irrational("atan2"))


class Rationals:
    """Arithmetic without rounding. ``eps`` is 0: a pivot is singular where it is 0."""

    eps = 0.0

    def number(self, x: Any) -> Ratio:
        """Of an int, a float, a Fraction. Raises SpatialDynError for what is none, or not finite."""
        try:
            return Ratio(x.item() if isinstance(x, np.generic) else x)
        except (TypeError, ValueError, OverflowError):
            raise SpatialDynError(f"{x!r} is no rational number, expected a finite one") from None

    def coordinates(self, bodies: NDArray[Any], q: NDArray[Any]) -> NDArray[Any]:
        """Coordinates (nq,) for the recursions, their angles taken for tangents of half of them."""
        q = q.copy()
        for row in bodies[1:]:
            place = {REVOLUTE: 0, PLANAR: 2}.get(int(row["kind"]))
            if place is not None:
                at = int(row["at"]) + place
                q[at] = Angle(q[at])
        return q

    def shown(self, x: Any) -> Fraction:
        """What the caller sees."""
        value: Fraction = x.tangent.value if isinstance(x, Angle) else Ratio(x).value
        return value

    def finite(self, x: Any) -> bool:
        """Every rational is."""
        return True


# --- digits -------------------------------------------------------------------------------------------------


class Digits:
    """Arithmetic in so many bits, with GUARD bits more until the end.

    context  mpmath's, of which results are: ``context.nstr(x, 30)``, ``context.mpf("0.1")``
    """

    def __init__(self, bits: int) -> None:
        """Raises SpatialDynError naming the extra if mpmath is not installed."""
        self.context, self._work = _context(bits), _context(bits + GUARD)
        self.eps = self._work.ldexp(1, 1 - bits - GUARD)

    def number(self, x: Any) -> Any:
        """Of an int, a float, a Fraction, another context's number, or a string such as "0.1"."""
        make = self._work.mpf
        try:
            if isinstance(x, Fraction):
                return make(x.numerator) / x.denominator
            if hasattr(x, "_mpf_"):
                return self._work.make_mpf(x._mpf_)
            return make(x.item() if isinstance(x, np.generic) else x)
        except (TypeError, ValueError):
            raise SpatialDynError(f"{x!r} is no real number, expected a float, a Fraction or mpmath's mpf") from None

    def coordinates(self, bodies: NDArray[Any], q: NDArray[Any]) -> NDArray[Any]:
        """Coordinates for the recursions: as they are."""
        return q

    def shown(self, x: Any) -> Any:
        """What the caller sees: rounded to the bits that were asked for."""
        return +self.context.make_mpf(self.number(x)._mpf_)

    def finite(self, x: Any) -> bool:
        """Whether a number is."""
        return bool(self._work.isfinite(x))


@cache
def _context(bits: int) -> Any:
    """An mpmath context of so many bits, whose numbers the recursions know; one each, for the registry keeps them."""
    try:
        from mpmath import MPContext
    except ImportError:
        raise SpatialDynError(
            'digits beyond float64 need mpmath, which is not installed; pip install "spatialdyn[exact]"'
        ) from None
    context: Any = MPContext()
    context.prec = bits
    kind: type = context.mpf
    scalars.sin.register(kind)(context.sin)
    scalars.cos.register(kind)(context.cos)
    scalars.sqrt.register(kind)(lambda x: context.sqrt(x) if x >= 0.0 else context.nan)
    scalars.atan2.register(kind)(lambda y, x: context.atan2(y, context.mpf(x)))
    scalars.summed.register(kind)(lambda x, series, closed: closed)
    return context


Arithmetic = Digits | Rationals


def arithmetic(bits: int | None) -> Arithmetic:
    """Digits, or Rationals for None. Raises SpatialDynError for fewer bits than float64 has, or more than MOST."""
    if bits is None:
        return Rationals()
    if isinstance(bits, bool) or not isinstance(bits, (int, np.integer)) or not LEAST <= bits <= MOST:
        raise SpatialDynError(f"bits is {bits!r}, expected at least {LEAST}, at most {MOST}, or None for rationals")
    return Digits(int(bits))


def numbers(made_by: Arithmetic, values: Sequence[Any] | NDArray[Any]) -> NDArray[Any]:
    """An object array of numbers, of the same shape; floats are taken at their exact binary value."""
    given = np.asarray(values, dtype=object)
    made = np.empty(given.shape, dtype=object)
    for at in np.ndindex(given.shape):
        made[at] = made_by.number(given[at])
    return made

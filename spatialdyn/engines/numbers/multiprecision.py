"""Reference values: the source of a recursion run on numbers of any precision, or on exact rationals.

The numbers of the table have their exact float64 values, so the result is that of float64 without rounding errors. The
rotations of the table are orthonormal only to rounding. So two algorithms that are equal for true rotations (q̈ of ABA,
and the q̈ whose RNEA is τ) differ here by the condition of the problem times 1e-16, unless every entry is 0 or ±1.

``Digits`` are mpmath's numbers in a context of their own: the precision of mpmath's global context does not change.
``Rationals`` have no sine: an angle is given as t = tan(q/2), with cos q = (1 - t²)/(1 + t²), sin q = 2t/(1 + t²).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra import scalars
from ...bodies.kinds import KINDS
from ...errors import SpatialDynError, literal, pip_install

LEAST = 53  # bits of float64
MOST = 1 << 20  # bits at which a product takes milliseconds
GUARD = 320  # additional bits while computing: the closed forms of lie cancel twice 36 digits near zero rotation


# --- exact rationals ----------------------------------------------------------------------------------------


class ExactRational:
    """A fraction that takes floats at their exact binary value, whereas a Fraction plus a float is a float."""

    __slots__ = ("value",)

    def __init__(self, value: Any) -> None:
        """The fraction of an int, a float, a Fraction or another ExactRational."""
        self.value: Fraction = value.value if isinstance(value, ExactRational) else Fraction(value)

    def __neg__(self) -> ExactRational:
        return ExactRational(-self.value)

    def __abs__(self) -> ExactRational:
        return ExactRational(abs(self.value))

    def __add__(self, other: Any) -> ExactRational:
        return ExactRational(self.value + ExactRational(other).value)

    __radd__ = __add__

    def __sub__(self, other: Any) -> ExactRational:
        return ExactRational(self.value - ExactRational(other).value)

    def __rsub__(self, other: Any) -> ExactRational:
        return ExactRational(ExactRational(other).value - self.value)

    def __mul__(self, other: Any) -> ExactRational:
        return ExactRational(self.value * ExactRational(other).value)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> ExactRational:
        return ExactRational(self.value / ExactRational(other).value)

    def __rtruediv__(self, other: Any) -> ExactRational:
        return ExactRational(ExactRational(other).value / self.value)

    def __gt__(self, other: Any) -> bool:
        return self.value > ExactRational(other).value

    def __le__(self, other: Any) -> bool:
        return self.value <= ExactRational(other).value


class Angle:
    """An angle q given by t = tan(q/2); it has a sine and a cosine, and no other operation."""

    __slots__ = ("tangent",)

    def __init__(self, tangent: ExactRational) -> None:
        """The angle of t = tan(q/2)."""
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


def _root(x: ExactRational) -> ExactRational:
    """√x if it is rational."""
    parts = x.value.as_integer_ratio()
    roots = [math.isqrt(n) if n >= 0 else -1 for n in parts]
    if any(root * root != n for root, n in zip(roots, parts, strict=True)):
        _irrational("sqrt")(x)
    return ExactRational(Fraction(*roots))


scalars.sin.register(Angle)(lambda q: 2.0 * q.tangent / (1.0 + q.tangent * q.tangent))
scalars.cos.register(Angle)(lambda q: (1.0 - q.tangent * q.tangent) / (1.0 + q.tangent * q.tangent))
scalars.sin.register(ExactRational)(_irrational("sin"))
scalars.cos.register(ExactRational)(_irrational("cos"))
scalars.sqrt.register(ExactRational)(_root)
scalars.exp.register(ExactRational)(_irrational("exp"))
scalars.atan2.register(ExactRational)(_irrational("atan2"))


class Rationals:
    """Arithmetic without rounding. ``eps`` is 0: only a pivot of 0 is singular."""

    eps = 0.0

    def number(self, x: Any) -> ExactRational:
        """Convert a finite int, float or Fraction. Raises SpatialDynError for other values."""
        try:
            return ExactRational(x.item() if isinstance(x, np.generic) else x)
        except (TypeError, ValueError, OverflowError):
            raise SpatialDynError(f"{literal(x)} is no rational number, expected a finite one") from None

    def coordinates(self, bodies: NDArray[Any], q: NDArray[Any]) -> NDArray[Any]:
        """Coordinates (nq,) for the recursions; the entries of angles are tan(q/2)."""
        q = q.copy()
        for row in bodies[1:]:
            place = KINDS[int(row["kind"])].angle
            if place is not None:
                at = int(row["q_index"]) + place
                q[at] = Angle(q[at])
        return q

    def shown(self, x: Any) -> Fraction:
        """The number as a Fraction, for the caller."""
        value: Fraction = x.tangent.value if isinstance(x, Angle) else ExactRational(x).value
        return value

    def finite(self, x: Any) -> bool:
        """True: every rational is finite."""
        return True


# --- digits -------------------------------------------------------------------------------------------------


class Digits:
    """Arithmetic in ``bits`` bits, with GUARD additional bits while computing.

    context  mpmath's context of the results: ``context.nstr(x, 30)``, ``context.mpf("0.1")``
    """

    def __init__(self, bits: int) -> None:
        """Raises SpatialDynError naming the extra if mpmath is not installed."""
        self.context, self._work = _context(bits), _context(bits + GUARD)
        self.eps = self._work.ldexp(1, 1 - bits - GUARD)

    def number(self, x: Any) -> Any:
        """Convert an int, a float, a Fraction, another context's number, or a string such as "0.1"."""
        make = self._work.mpf
        try:
            if isinstance(x, Fraction):
                return make(x.numerator) / x.denominator
            if hasattr(x, "_mpf_"):
                return self._work.make_mpf(x._mpf_)
            return make(x.item() if isinstance(x, np.generic) else x)
        except (TypeError, ValueError):
            raise SpatialDynError(
                f"{literal(x)} is no real number, expected a float, a Fraction or mpmath's mpf"
            ) from None

    def coordinates(self, bodies: NDArray[Any], q: NDArray[Any]) -> NDArray[Any]:
        """Coordinates for the recursions, unchanged."""
        return q

    def shown(self, x: Any) -> Any:
        """The number rounded to ``bits`` bits, for the caller."""
        return +self.context.make_mpf(self.number(x)._mpf_)

    def finite(self, x: Any) -> bool:
        """Whether a number is finite."""
        return bool(self._work.isfinite(x))


@cache
def _context(bits: int) -> Any:
    """An mpmath context of ``bits`` bits, its numbers registered in scalars; cached, as the registry keeps types."""
    try:
        from mpmath import MPContext
    except ImportError:
        raise SpatialDynError(
            f"digits beyond float64 need mpmath, which is not installed; {pip_install('exact')}"
        ) from None
    context: Any = MPContext()
    context.prec = bits
    kind: type = context.mpf
    scalars.sin.register(kind)(context.sin)
    scalars.cos.register(kind)(context.cos)
    scalars.sqrt.register(kind)(lambda x: context.sqrt(x) if x >= 0.0 else context.nan)
    scalars.exp.register(kind)(context.exp)
    scalars.atan2.register(kind)(lambda y, x: context.atan2(y, context.mpf(x)))
    scalars.series_or_closed.register(kind)(lambda x, series, closed: closed)
    return context


Arithmetic = Digits | Rationals


def arithmetic(bits: int | None) -> Arithmetic:
    """Digits, or Rationals for None. Raises SpatialDynError for less than LEAST or more than MOST bits."""
    if bits is None:
        return Rationals()
    if isinstance(bits, bool) or not isinstance(bits, (int, np.integer)) or not LEAST <= bits <= MOST:
        raise SpatialDynError(
            f"bits is {literal(bits)}, expected at least {LEAST}, at most {MOST}, or None for rationals"
        )
    return Digits(int(bits))


def numbers(made_by: Arithmetic, values: Sequence[Any] | NDArray[Any]) -> NDArray[Any]:
    """Values as an object array of numbers, of the same shape; floats are taken at their exact binary value."""
    given = np.asarray(values, dtype=object)
    made = np.empty(given.shape, dtype=object)
    for at in np.ndindex(given.shape):
        made[at] = made_by.number(given[at])
    return made

"""Closed forms: a recursion run once on exact polynomials in sines, cosines and parameters.

A Number is a quotient of polynomials with rational coefficients. For every angle α its ring has two generators, cos α
and sin α. In every product sin² is replaced by 1 - cos²; the square of a radical, and one square of a unit quaternion,
are replaced likewise. The result is a canonical form: two polynomials of the ring are equal as functions exactly if
they have the same terms, so no simplification is needed, and zero is recognized.

At the end ``Ring.expression`` turns products of sines and cosines into sums of cos(n·α) and sin(n·α): the Fourier
series of the function (``fourier``), which is canonical too. Its length grows exponentially with the number of angles
that an entry depends on, so closed forms are for arms of a few joints, and a Budget limits their cost.

The polynomials are SymPy's, which is imported when a Ring is made.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra import regions, scalars
from ...errors import SpatialDynError, literal, pip_install
from ...recursions.spec import Spec, shape_in
from ..programs.record.tracer import evaluate
from .fourier import fourier, length

Poly = Any  # sympy.polys.rings.PolyElement
Expr = Any  # sympy.Expr


def need_sympy() -> Any:
    """The module sympy. Raises SpatialDynError naming the extra if it is not installed."""
    try:
        import sympy
    except ImportError:
        raise SpatialDynError(f"symbols need sympy, which is not installed; {pip_install('symbolic')}") from None
    return sympy


class Number:
    """An element of a Ring, or a quotient of two elements; recursions compute with Numbers in place of floats.

    Floats are taken at their exact binary value, so the 0.5 and 2.0 of a recursion are exact.
    """

    __slots__ = ("den", "num", "ring")

    def __init__(self, ring: Ring, num: Poly, den: Poly = None) -> None:
        """num / den, reduced polynomials of the ring; den None for 1."""
        self.ring, self.num, self.den = ring, num, den

    def __neg__(self) -> Number:
        return Number(self.ring, -self.num, self.den)

    def __add__(self, other: Any) -> Any:
        other = self.ring.number_or_none(other)
        if other is None:
            return NotImplemented
        if not other.num:
            return self
        if not self.num:
            return other
        a, b = self.den, other.den
        if a is b or a == b:
            return Number(self.ring, self.num + other.num, a)
        times, one = self.ring.times, self.ring.one
        left = self.num if b is None else times(self.num, b)
        right = other.num if a is None else times(other.num, a)
        return Number(self.ring, left + right, times(one if a is None else a, one if b is None else b))

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self + (-other)

    def __rsub__(self, other: Any) -> Any:
        return (-self) + other

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, float) and other in (0.0, 1.0):
            return self if other else 0.0
        other = self.ring.number_or_none(other)
        if other is None:
            return NotImplemented
        times = self.ring.times
        num = times(self.num, other.num)
        if self.den is None or other.den is None:
            return Number(self.ring, num, self.den if other.den is None else other.den)
        return Number(self.ring, num, times(self.den, other.den))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        other = self.ring.number_or_none(other)
        if other is None:
            return NotImplemented
        return self * other.reciprocal()

    def __rtruediv__(self, other: Any) -> Any:
        return other * self.reciprocal()

    def reciprocal(self) -> Number:
        """1 / x. Raises ZeroDivisionError for 0."""
        if not self.num:
            raise ZeroDivisionError("division by a number that is 0 in every configuration")
        num = self.ring.one if self.den is None else self.den
        if self.num.is_ground:
            return Number(self.ring, num.mul_ground(1 / self.num.coeff(1)))
        return Number(self.ring, num, self.num)

    def _refuse(self, other: Any = None) -> bool:
        raise TypeError("a symbolic value has no truth and no order; a recursion chooses with scalars.select")

    __bool__ = __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _refuse
    __hash__ = None  # type: ignore[assignment]

    def __float__(self) -> float:
        return float(self.ring.expression(self))

    def __repr__(self) -> str:
        return f"Number({self.ring.expression(self)})"


def _unknown(name: str) -> Any:
    def refuse(x: Number, *others: Any) -> Number:
        raise SpatialDynError(
            f"{name} of the symbolic {literal(x)} has no closed form here, expected sums and products"
        )

    return refuse


scalars.sin.register(Number)(lambda x: x.ring.turn(x.ring.expression(x))[1])
scalars.cos.register(Number)(lambda x: x.ring.turn(x.ring.expression(x))[0])
scalars.sqrt.register(Number)(_unknown("sqrt"))
scalars.exp.register(Number)(_unknown("exp"))
scalars.atan2.register(Number)(_unknown("atan2"))
scalars.select.register(Number)(_unknown("select"))
regions.settled.register(Number)(_unknown("the end of a loop or a branch"))
scalars.exceeds.register(Number)(lambda x, floor: 1.0 if x.num else 0.0)  # in almost every configuration


@dataclass
class Budget:
    """Limit of the cost of a closed form: the number of products of two terms and of waves of a series.

    With more than 80 generators each of them counts more, in proportion to its time.

    owner  the owner of the closed form in words, for the error message
    most   most that may be spent until ``spent`` is reset to 0
    """

    owner: str = "this closed form"
    most: float = math.inf
    spent: int = 0

    def spend(self, n: int) -> None:
        """Add to ``spent``. Raises SpatialDynError, and resets ``spent``, beyond ``most``."""
        self.spent += n
        if self.spent > self.most:
            self.spent = 0
            raise SpatialDynError(
                f"{self.owner} takes more than {self.most:.0f} products of terms in closed form, expected fewer; "
                "limit=None lets it, and specialize(model, call).c_code() or python_code() is code for any robot"
            )


class Ring:
    """The ring of polynomials of one robot.

    angles  expressions whose cosine and sine are generators: symbols of coordinates, and constants without a closed
            form in radicals, such as 1/10 or pi/5
    plain   symbols that are generators themselves
    primes  primes whose square root is a generator
    units   symbols of ``plain`` whose squares sum to 1, one tuple for each quaternion or (cos, sin) pair
    budget  limit of its arithmetic, none by default
    """

    def __init__(
        self,
        angles: Iterable[Expr] = (),
        plain: Iterable[Expr] = (),
        primes: Iterable[int] = (),
        units: Iterable[tuple[Expr, ...]] = (),
        budget: Budget | None = None,
    ) -> None:
        """The ring of these generators."""
        self.budget = Budget() if budget is None else budget
        self._sympy = sympy = need_sympy()
        from sympy.polys.rings import PolyRing

        self.angles, self.plain = tuple(dict.fromkeys(angles)), tuple(dict.fromkeys(plain))
        self.primes, self.units = tuple(dict.fromkeys(primes)), tuple(units)
        self.values: list[Expr] = [f(a) for a in self.angles for f in (sympy.cos, sympy.sin)]
        self.values += [*self.plain, *(sympy.sqrt(p) for p in self.primes)]
        names = [sympy.Symbol(f"{f}({a})") for a in self.angles for f in ("cos", "sin")]
        names += [*self.plain, *(sympy.Symbol(f"sqrt({p})") for p in self.primes)]
        # SymPy's rings need a generator
        self.polynomials = PolyRing(names or [sympy.Symbol("none")], sympy.QQ, sympy.lex)
        self.one: Poly = self.polynomials.one
        self._gens = self.polynomials.gens
        self._weight = max(1, len(names) // 40)  # a product of 300 generators takes 10 times one of 40
        self._angle = {a: k for k, a in enumerate(self.angles)}
        self._place = {x: 2 * len(self.angles) + k for k, x in enumerate(self.plain)}
        self._root = {p: 2 * len(self.angles) + len(self.plain) + k for k, p in enumerate(self.primes)}
        self._squares: list[tuple[int, Poly]] = [
            *((2 * k + 1, 1 - self._gens[2 * k] ** 2) for k in range(len(self.angles))),
            *((at, self.polynomials(p)) for p, at in self._root.items()),
            *((self._place[u[-1]], 1 - sum(self._gens[self._place[x]] ** 2 for x in u[:-1])) for u in self.units),
        ]

    def extended(
        self, angles: Iterable[Expr] = (), plain: Iterable[Expr] = (), units: Any = (), budget: Budget | None = None
    ) -> Ring:
        """This ring with more generators, and with the same budget if none is given."""
        budget = self.budget if budget is None else budget
        return Ring((*self.angles, *angles), (*self.plain, *plain), self.primes, (*self.units, *units), budget)

    def taken(self, x: Any) -> Any:
        """Convert a Number of a ring that this ring extends; returns other values unchanged."""
        if not isinstance(x, Number) or x.ring is self:
            return x
        den = None if x.den is None else x.den.set_ring(self.polynomials)
        return Number(self, x.num.set_ring(self.polynomials), den)

    # --- arithmetic ---------------------------------------------------------------------------------------

    def times(self, a: Poly, b: Poly) -> Poly:
        """A product in canonical form."""
        if len(a) == 1 and a.is_ground:
            return b.mul_ground(a.coeff(1))
        if len(b) == 1 and b.is_ground:
            return a.mul_ground(b.coeff(1))
        self.budget.spend(len(a) * len(b) * self._weight)
        product = a * b
        highest = tuple(map(max, zip(*product, strict=True)))
        for at, square in self._squares:
            if product and highest[at] > 1:
                product = self._replaced(product, at, square)
        return product

    def _replaced(self, poly: Poly, at: int, square: Poly) -> Poly:
        """The polynomial with powers of the square of generator ``at`` replaced."""
        parts: dict[int, Poly] = {}
        for m, c in poly.items():
            part = parts.setdefault(m[at] // 2, self.polynomials.zero)
            part[(*m[:at], m[at] % 2, *m[at + 1 :])] = c
        return sum((part * square**k for k, part in parts.items()), self.polynomials.zero)

    def number_or_none(self, x: Any) -> Number | None:
        """A Number of an int, float, Fraction or SymPy expression; returns None if not applicable."""
        if isinstance(x, Number):
            return x
        if isinstance(x, (int, float, Fraction, np.integer, np.floating)):
            f = Fraction(int(x) if isinstance(x, np.integer) else float(x) if isinstance(x, np.floating) else x)
            return Number(self, self.polynomials(self._sympy.QQ(f.numerator, f.denominator)))
        return self.of(x) if isinstance(x, self._sympy.Expr) else None

    def turn(self, angle: Expr) -> tuple[Number, Number]:
        """Cosine and sine of an angle: a sum of integer multiples of the ring's angles and of constants.

        Raises SpatialDynError naming an angle that is no such sum.
        """
        sympy = self._sympy
        c, s = Number(self, self.one), Number(self, self.polynomials.zero)
        rest = sympy.S.Zero
        for term, n in sympy.expand(angle).as_coefficients_dict().items():
            if term not in self._angle or not n.is_Integer:
                rest += n * term
                continue
            k = self._angle[term]
            ck, sk = Number(self, self._gens[2 * k]), Number(self, self._gens[2 * k + 1])
            for _ in range(abs(int(n))):
                turned = sk if n > 0 else -sk
                c, s = c * ck - s * turned, s * ck + c * turned
        if rest:
            cr, sr = self._constant(rest)
            c, s = c * cr - s * sr, s * cr + c * sr
        return c, s

    def _constant(self, angle: Expr) -> tuple[Number, Number]:
        for sign in (1, -1):
            if sign * angle in self._angle:
                k = self._angle[sign * angle]
                return Number(self, self._gens[2 * k]), Number(self, self._gens[2 * k + 1] * sign)
        if (angle * 12 / self._sympy.pi).is_Integer:
            return self.of(self._sympy.cos(angle)), self.of(self._sympy.sin(angle))
        raise SpatialDynError(f"{angle} is no sum of whole multiples of {', '.join(map(str, self.angles)) or 'angles'}")

    def of(self, e: Any) -> Number:
        """An expression that is rational in the generators, sines and cosines, as a Number.

        Raises SpatialDynError naming a part that is not rational in them.
        """
        sympy = self._sympy
        e = sympy.sympify(e)
        if e in self._place:
            return Number(self, self._gens[self._place[e]])
        if e.is_Rational:
            return Number(self, self.polynomials(sympy.QQ(int(e.p), int(e.q))))
        if e.is_Float:
            if not math.isfinite(float(e)):
                raise SpatialDynError(f"{e!s:.40} is beyond the range of float64, expected a number within it")
            return self.of(sympy.Rational(repr(float(e))))
        if e.is_Add or e.is_Mul:
            total = self.of(e.args[0])
            for x in e.args[1:]:
                total = total + self.of(x) if e.is_Add else self.of(x) * total
            return total
        if e.is_Pow and e.exp.is_Integer:
            base, power = self.of(e.base), self.of(1)
            for _ in range(abs(int(e.exp))):  # one by one, so that squares are replaced
                power = base * power
            return power if e.exp > 0 else power.reciprocal()
        if e.is_Pow and (2 * e.exp).is_Integer and e.base.is_Rational:
            rest = self.of(e.base ** (e.exp - sympy.S.Half))
            return Number(self, self.times(self._radical(e.base), rest.num))
        if isinstance(e, (sympy.cos, sympy.sin)):
            return self.turn(e.args[0])[isinstance(e, sympy.sin)]
        if isinstance(e, sympy.tan):
            c, s = self.turn(e.args[0])
            return Number(self, s.num, c.num)
        raise SpatialDynError(f"{e} is not rational in {', '.join(map(str, self.plain))}, sines and cosines")

    def _radical(self, x: Expr) -> Poly:
        """√x of a positive rational: √(a/b) = √(a b) / b, prime by prime."""
        root = self.one.mul_ground(self._sympy.QQ(1, int(x.q)))
        for p, k in self._sympy.factorint(int(x.p) * int(x.q)).items():
            root = root.mul_ground(p ** (k // 2))
            if k % 2:
                if p not in self._root:
                    raise SpatialDynError(f"the square root of {p} is not among the ring's")
                root = root * self._gens[self._root[p]]
        return root

    def derivative(self, x: Any, symbol: Expr) -> Number:
        """∂x/∂symbol, with sines and cosines of the symbol."""
        x = self.of(0) + x
        if x.den is not None:
            num, den = Number(self, x.num), Number(self, x.den)
            top = self.derivative(num, symbol) * den - num * self.derivative(den, symbol)
            return Number(self, top.num, self.times(x.den, x.den))
        total = self.polynomials.zero
        if symbol in self._place:
            total = x.num.diff(self._gens[self._place[symbol]])
        if symbol in self._angle:
            c, s = self._gens[2 * self._angle[symbol] :][:2]
            total = total + self.times(x.num.diff(s), c) - self.times(x.num.diff(c), s)
        return Number(self, total)

    # --- back to expressions ------------------------------------------------------------------------------

    def expression(self, x: Any) -> Expr:
        """A Number as an expression: a Fourier series in the angles, or a quotient of two."""
        x = self.of(0) + x
        if x.den is None:
            return self._series(x.num)
        num, den = self._without_common(x.num, x.den)
        below = self._series(den)
        scale, below = below.as_content_primitive()
        steady = below.as_independent(self._sympy.cos, self._sympy.sin, as_Add=True)[0]
        if steady.could_extract_minus_sign():  # so that a determinant of M is written as a positive number
            scale, below = -scale, -below
        return self._sympy.expand(self._series(num) / scale, deep=False) / below

    def _series(self, poly: Poly) -> Expr:
        self.budget.spend(length(poly, len(self.angles)) * self._weight)
        return fourier(poly, self.angles, self.values)

    def _without_common(self, num: Poly, den: Poly) -> tuple[Poly, Poly]:
        """Numerator and denominator, divided by the constant and the product of generators that divide both."""
        if not num:
            return num, self.one
        drop = list(map(min, zip(*num, *den, strict=True)))
        scale = den.content() if den.LC > 0 else -den.content()
        return self._divided(num, drop, scale), self._divided(den, drop, scale)

    def _divided(self, poly: Poly, drop: Sequence[int], scale: Any) -> Poly:
        return self.polynomials.from_dict(
            {tuple(e - d for e, d in zip(m, drop, strict=True)): c / scale for m, c in poly.items()}
        )


# --- running ------------------------------------------------------------------------------------------------


def run(
    spec: Spec, ring: Ring, rows: Sequence[Any], sizes: Mapping[str, int], inputs: Mapping[str, Any]
) -> NDArray[Any]:
    """The output of a call on a table of Numbers, as an object array of Numbers.

    rows    the table of bodies, as of ``tracer.table``, its entries Numbers or the floats 0 and 1
    sizes   nq, nv, njoints, and those of static tables
    inputs  arrays of Numbers by name; an optional one may be missing
    """
    shape = shape_in(spec.output.shape, sizes)
    out = evaluate(spec, rows, shape, inputs, np.empty(sizes["nv"], dtype=object))
    flat = out.ravel()
    for k, x in enumerate(flat):
        flat[k] = ring.number_or_none(x)
    return out.reshape(shape)

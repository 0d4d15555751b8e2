"""Polynomials in sines and cosines as Fourier series, the form in which textbooks print M, C and g.

A polynomial is an element of a SymPy ring. Its first generators are cos α and sin α of each angle in turn, with sines
to the first power at most. The other generators (parameters, velocities and so on) are left unchanged.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any

Poly = Any  # sympy.polys.rings.PolyElement
Expr = Any  # sympy.Expr
Place = tuple[int, ...]


def length(poly: Poly, angles: int) -> int:
    """Number of waves in the terms of a polynomial, before equal waves are collected."""
    return sum(len(_waves(m[: 2 * angles])) for m in poly)


def fourier(poly: Poly, angles: Sequence[Expr], values: Sequence[Expr]) -> Expr:
    """Σ A_n cos(n·α) + B_n sin(n·α), where A and B are polynomials in the generators that are no sine or cosine.

    angles  angles of the first generators
    values  expressions of all generators
    """
    import sympy

    cut = 2 * len(angles)
    found: dict[tuple[Place, bool], dict[Place, Any]] = {}
    for m, c in poly.items():
        for key, part in _waves(m[:cut]):
            terms = found.setdefault(key, {})
            terms[m[cut:]] = terms.get(m[cut:], 0) + c * sympy.QQ(part.numerator, part.denominator)
    parts = []
    for (n, odd), terms in sorted(found.items()):
        kept = {m: c for m, c in terms.items() if c}
        if kept:
            angle = sympy.Add(*(k * a for k, a in zip(n, angles, strict=True)))
            wave = sympy.sin(angle) if odd else sympy.cos(angle)
            parts.append(_coefficient(kept, values[cut:]) * wave)
    return sympy.Add(*parts)


def _coefficient(terms: Mapping[Place, Any], values: Sequence[Expr]) -> Expr:
    """A polynomial in the other generators, with its common factor written in front."""
    import sympy

    common = tuple(map(min, zip(*terms, strict=True)))
    content = math.gcd(*(int(c.numerator) for c in terms.values()))
    content_den = math.lcm(*(int(c.denominator) for c in terms.values()))
    front = sympy.Rational(content, content_den)
    if terms[max(terms)] < 0:
        front = -front

    def product(m: Iterable[int]) -> Expr:
        return sympy.Mul(*(values[k] ** e for k, e in enumerate(m) if e))

    rest = sympy.Add(
        *(
            sympy.Rational(int(c.numerator), int(c.denominator))
            / front
            * product(e - d for e, d in zip(m, common, strict=True))
            for m, c in terms.items()
        )
    )
    return sympy.Mul(front, product(common), rest)


@lru_cache(maxsize=4096)
def _waves(powers: Place) -> tuple[tuple[tuple[Place, bool], Fraction], ...]:
    """Π cos^a sin^b over the angles as a sum of cos(n·α) and sin(n·α): ((n, whether a sine), coefficient) of each.

    powers  a and b (0 or 1) of each angle in turn

    By Euler's formulas with z = exp(iα), every factor is a Laurent polynomial in z with real coefficients, times -i for
    a sine.
    """
    lines: dict[Place, Fraction] = {(): Fraction(1)}
    sines = 0
    for a, b in zip(powers[::2], powers[1::2], strict=True):
        one: dict[int, Fraction] = {}
        for j in range(a + 1):
            half = Fraction(math.comb(a, j), 2**a)
            for shift, sign in ((1, 1), (-1, -1)) if b else ((0, 2),):
                one[a - 2 * j + shift] = one.get(a - 2 * j + shift, Fraction(0)) + sign * half / 2
        lines = {(*n, k): x * y for n, x in lines.items() for k, y in one.items() if y}
        sines += b
    odd = bool(sines % 2)
    sign = (1, 1, -1, -1)[sines % 4]
    waves = []
    for n, x in lines.items():
        first = next((k for k in n if k), 0)
        if first > 0:
            waves.append(((n, odd), 2 * sign * x))
        elif first == 0 and not odd:
            waves.append(((n, odd), sign * x))
    return tuple(waves)

"""Angles with their cosines and sines in plain Python, with the bits that compiled kernels compute."""

from __future__ import annotations

import math
import struct
from fractions import Fraction
from functools import cache
from typing import Any

from ...algebra.scalars import cos, sin
from ..polynomials import COSINE, HALF_PI, MAGIC, MAX_ANGLE, SINE

SHIFT, (LARGE, SMALL, LEAST) = MAGIC["double"], HALF_PI["double", True]


class Angle(float):
    """An angle with its cosine and sine."""

    cosine: float
    sine: float


cos.register(Angle)(lambda x: x.cosine)
sin.register(Angle)(lambda x: x.sine)


def fma(a: float, b: float, c: float) -> float:
    """a b + c, rounded once."""
    found = Fraction(a) * Fraction(b) + Fraction(c)
    return float(found) if found else a * b + c


def _angle(x: float) -> Angle:
    """An Angle by the polynomials of ``sines.turn``; by the C library for large x or without fused multiply-add."""
    made = Angle(x)
    if not abs(x) <= MAX_ANGLE or not _has_fma():
        made.cosine, made.sine = cos(x), sin(x)
        return made
    shifted = fma(x, 2.0 / math.pi, SHIFT)
    n = shifted - SHIFT
    whole = fma(n, -LARGE, x)
    r = fma(n, -LEAST, fma(n, -SMALL, whole))
    low = fma(n, -SMALL, whole - r)
    z = r * r
    p, c = SINE["double"][-1], COSINE["double"][-1]
    for a, b in zip(SINE["double"][-2::-1], COSINE["double"][-2::-1], strict=True):
        p, c = fma(z, p, a), fma(z, c, b)
    c = fma(z, c, -0.5)
    s, c = fma(z, fma(r, p, low), r), fma(z, c, 1.0)
    (quadrant,) = struct.unpack("<q", struct.pack("<d", shifted))
    if quadrant & 1:
        s, c = c, s
    made.cosine, made.sine = -c if quadrant + 1 & 2 else c, -s if quadrant & 2 else s
    return made


@cache
def _has_fma() -> bool:
    from .sines import has_fma

    return has_fma()


def turned(q: Any, room: Any = None) -> list[Angle]:
    """Coordinates with their cosines and sines, the form in which a recursion takes ``TURNED_Q`` in plain Python."""
    return [_angle(float(x)) for x in q]

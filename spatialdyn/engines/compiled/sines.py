"""cos and sin of all coordinates of a configuration at once, for kernels, in SIMD code.

The code uses the polynomials of the programs' lanes (``polynomials``). For larger angles, and on processors without
fused multiply-add, it calls the C library, whose functions are not SIMD code.
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from ...algebra.scalars import inline
from ..polynomials import COSINE, HALF_PI, MAGIC, MAX_ANGLE, SINE
from .target import target

TWO_OVER_PI = 2.0 / math.pi
SHIFT = MAGIC["double"]
LARGE, SMALL, LEAST = HALF_PI["double", True]
S0, S1, S2, S3, S4, S5 = SINE["double"]
C0, C1, C2, C3, C4, C5 = COSINE["double"]


def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


def _bits(typing_context: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.int64(types.float64), generate


def _signed(typing_context: Any, x: Any, quadrant: Any) -> Any:
    """x, negated in the quadrants 2 and 3 of each turn."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        x, quadrant = arguments
        word = quadrant.type
        sign = builder.and_(builder.shl(quadrant, word(62)), word(-(1 << 63)))
        return builder.bitcast(builder.xor(builder.bitcast(x, word), sign), x.type)

    return types.float64(types.float64, types.int64), generate


fma: Any = intrinsic(_fma)
bits: Any = intrinsic(_bits)
signed: Any = intrinsic(_signed)


def has_fma() -> bool:
    """Whether Numba compiles for a processor with fused multiply-add."""
    return target().fused


@inline
def _by_library(q: Any, turned: Any) -> None:
    """Write q, cos q and sin q (3, nq) by the C library."""
    for k in range(q.size):
        turned[0, k], turned[1, k], turned[2, k] = q[k], math.cos(q[k]), math.sin(q[k])


@inline
def _by_polynomials(q: Any, turned: Any) -> None:
    """Write q, cos q and sin q (3, nq) within 1.5 ulp, by SIMD code."""
    beyond = False
    for k in range(q.size):
        x = q[k]
        shifted = fma(x, TWO_OVER_PI, SHIFT)
        n = shifted - SHIFT
        whole = fma(n, -LARGE, x)
        r = fma(n, -LEAST, fma(n, -SMALL, whole))
        low = fma(n, -SMALL, whole - r)
        z = r * r
        p = fma(z, fma(z, fma(z, fma(z, fma(z, S5, S4), S3), S2), S1), S0)
        c = fma(z, fma(z, fma(z, fma(z, fma(z, fma(z, C5, C4), C3), C2), C1), C0), -0.5)
        s, c, quadrant = fma(z, fma(r, p, low), r), fma(z, c, 1.0), bits(shifted)
        turned[0, k] = x
        turned[1, k] = signed(s if quadrant & 1 else c, quadrant + 1)
        turned[2, k] = signed(c if quadrant & 1 else s, quadrant)
        beyond |= not abs(x) <= MAX_ANGLE
    if beyond:
        for k in range(q.size):
            if not abs(q[k]) <= MAX_ANGLE:
                turned[1, k], turned[2, k] = math.cos(q[k]), math.sin(q[k])


turn = _by_polynomials if has_fma() else _by_library

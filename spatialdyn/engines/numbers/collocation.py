"""Gauss collocation of order 32 in double-double for a recorded field ẏ = f(y), for several motions at once.

All stages of all motions are evaluated side by side and iterated until they no longer change.

Source: Hairer, Nørsett, Wanner, Solving ordinary differential equations I (1993), II.7, for the methods of Gauss. The
coefficients come from integrals of Legendre polynomials, computed here in fractions.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.scalars import inline
from ..compiled import numba_kernels
from .double_double import LANES, DoubleDouble, add, compile_unfused, compiled_interpreter, multiply, pair

Array = NDArray[np.float64]

STAGES = 16
MAX_SWEEPS = 60  # if more sweeps are needed, shorter steps cost less
CONVERGED = 1e-26  # a change below this part of the largest rate ends the iteration; the remaining error is smaller
ROUNDED = 1e-14  # a change below this part that no longer shrinks is rounding, amplified by unequal masses
FINE = 2**200  # denominator of the fractions that approximate irrational nodes


def collocate(f: DoubleDouble, start: Array, t: Array, steps: int) -> tuple[Array, Array] | None:
    """High and low parts (N, K, n) of motions at the times t (N,); None if the stages of a step do not converge.

    f      the program of ẏ (n) as a function of y (n)
    start  (2, n, K)  high and low parts of K states
    steps  number of steps between two times
    """
    A, (_, n, motions) = tableau(), start.shape
    whole = start.copy()
    y = whole.reshape(2, n * motions)  # a view
    slopes, sums = np.zeros((2, STAGES, n * motions)), np.empty((2, n * motions))
    scratch = np.zeros((-(-STAGES * motions // LANES), f.rows, 2 * LANES))
    made = np.empty((2, len(t), motions, n))
    made[:, 0] = whole.transpose(0, 2, 1)
    for k in range(1, len(t)):
        hh, hl = pair((Fraction(float(t[k])) - Fraction(float(t[k - 1]))) / steps)
        for _ in range(steps):
            if not _stepper()(f.code, f.value, f.outputs, A, hh, hl, y, slopes, sums, scratch):
                return None
        made[:, k] = whole.transpose(0, 2, 1)
    return made[0], made[1]


@cache
def tableau() -> Array:
    """(STAGES + 1, STAGES, 2): weights a_ij of the stages as pairs; the last row has the weights of the step.

    a_ij = b_j Σ_k (2k + 1) P_k(c_j) ∫_0^c_i P_k with P_k Legendre's polynomials of [0, 1]; the integral is
    (P_k+1 - P_k-1)(c_i) / (2 (2k + 1)), and c_i for k = 0.
    """
    nodes = [_zero(k) for k in range(STAGES)]
    at = [_legendre(c) for c in nodes]
    weights = [1 / sum((2 * k + 1) * P[k] ** 2 for k in range(STAGES)) for P in at]
    rows = []
    for c, P in [*zip(nodes, at, strict=True), (Fraction(1), _legendre(Fraction(1)))]:
        whole = [c] + [(P[k + 1] - P[k - 1]) / (2 * (2 * k + 1)) for k in range(1, STAGES)]
        rows.append(
            [b * sum((2 * k + 1) * Q[k] * whole[k] for k in range(STAGES)) for b, Q in zip(weights, at, strict=True)]
        )
    return np.array([[pair(x) for x in row] for row in rows])


def _legendre(c: Fraction) -> list[Fraction]:
    """Legendre's polynomials P_0 ... P_STAGES of [0, 1], at c."""
    x, P = 2 * c - 1, [Fraction(1), 2 * c - 1]
    for k in range(1, STAGES):
        P.append(Fraction(round(((2 * k + 1) * x * P[k] - k * P[k - 1]) / (k + 1) * FINE), FINE))
    return P


def _zero(k: int) -> Fraction:
    """Node k of STAGES, by Newton's method on P_STAGES, which starts from the node in floats."""
    c = Fraction(float(np.polynomial.legendre.leggauss(STAGES)[0][k])) / 2 + Fraction(1, 2)
    for _ in range(4):
        P, x = _legendre(c), 2 * c - 1
        slope = 2 * STAGES * (x * P[STAGES] - P[STAGES - 1]) / (x * x - 1)
        c = Fraction(round((c - P[STAGES] / slope) * FINE), FINE)
    return c


@inline
def advance(
    run: Any, code: Any, value: Any, outputs: Any, A: Any, hh: float, hl: float, y: Any, slopes: Any, sums: Any,
    scratch: Any,
) -> bool:  # fmt: skip
    """y ← y after a step h; returns whether its stages converged.

    run      runs a program
    y        (2, n · motions)          states, high and low parts
    slopes   (2, stages, n · motions)  written; the iteration starts from those of the previous step
    sums     (2, n · motions)          scratch
    scratch  (blocks, rows, 2 LANES)   registers of all stages and motions, LANES in a block
    """
    n, motions = len(outputs), y.shape[1] // len(outputs)
    before = np.inf
    for sweep in range(MAX_SWEEPS):
        for i in range(STAGES):
            weigh(A, i, hh, hl, y, slopes, sums)
            for m in range(motions):
                s = i * motions + m
                for k in range(n):
                    e = k * motions + m
                    scratch[s // LANES, k, s % LANES] = sums[0, e]
                    scratch[s // LANES, k, LANES + s % LANES] = sums[1, e]
        for block in range(len(scratch)):
            run(code, value, scratch[block])
        change, largest, finite = 0.0, 0.0, True
        for k in range(n):
            r, sign = (outputs[k], 1.0) if outputs[k] >= 0 else (-outputs[k] - 1, -1.0)
            for i in range(STAGES):
                for m in range(motions):
                    s, e = i * motions + m, k * motions + m
                    fh = sign * scratch[s // LANES, r, s % LANES]
                    fl = sign * scratch[s // LANES, r, LANES + s % LANES]
                    change = max(change, abs((fh - slopes[0, i, e]) + (fl - slopes[1, i, e])))
                    largest, finite = max(largest, abs(fh)), finite and fh - fh == 0.0
                    slopes[0, i, e], slopes[1, i, e] = fh, fl
        if not finite or (sweep > 3 and change > 1e3 * largest):
            return False
        if change <= CONVERGED * largest or (change <= ROUNDED * largest and not change < 0.5 * before):
            weigh(A, STAGES, hh, hl, y, slopes, sums)
            y[:] = sums
            return True
        if sweep > 20 and change > before:  # the change grows before it is as small as rounding
            return False
        before = change
    return False


@inline
def weigh(A: Any, i: int, hh: float, hl: float, y: Any, slopes: Any, sums: Any) -> None:
    """sums = y + h Σ_j a_ij slope_j."""
    for e in range(y.shape[1]):
        sums[0, e], sums[1, e] = 0.0, 0.0
    for j in range(STAGES):
        ah, al = multiply(hh, hl, A[i, j, 0], A[i, j, 1])
        for e in range(y.shape[1]):
            ph, pl = multiply(ah, al, slopes[0, j, e], slopes[1, j, e])
            sums[0, e], sums[1, e] = add(sums[0, e], sums[1, e], ph, pl)
    for e in range(y.shape[1]):
        sums[0, e], sums[1, e] = add(y[0, e], y[1, e], sums[0, e], sums[1, e])


@cache
def _stepper() -> Callable[..., bool]:
    """``advance``, compiled."""
    names = ["code", "value", "outputs", "A", "hh", "hl", "y", "slopes", "sums", "scratch"]
    body = ["stamp", f"return advance(run, {', '.join(names)})"]
    scope = {"advance": advance, "run": compiled_interpreter()}
    return compile_unfused(numba_kernels.kernel_from_text("collocation_step", names, body, scope))

"""The reference of a motion: Gauss collocation of order 32 in double-double, its error estimated by halving the step.

The state is (q, v) with quaternions and (cos, sin) pairs as coordinates, which the exact flow keeps at unit norm. All
stages of all motions are evaluated side by side by a program recorded of ``aba`` and ``coordinate_rate``, and iterated
until they change no longer.

Source: Hairer, Nørsett, Wanner, Solving ordinary differential equations I (1993), II.7, for the methods of Gauss; their
coefficients come from integrals of Legendre polynomials, here in fractions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..algebra.scalars import inline
from ..engines.compiled import numba_kernels
from ..engines.numbers.double_double import (
    LANES,
    DoubleDouble,
    add,
    compile_unfused,
    compiled_interpreter,
    multiply,
    record_double_double,
)
from ..engines.programs.record.mimic_rows import evaluate
from ..errors import SimulationError
from ..model.model import Model
from ..recursions import SPECS
from ..recursions.spec import Spec
from .methods.adaptive import coordinate_rate

Array = NDArray[np.float64]

STAGES = 16
MAX_SWEEPS = 60  # at most; beyond, shorter steps cost less
CONVERGED = 1e-26  # of the largest rate: a change this small ends the iteration; the error left is smaller
GOAL = 1e-13  # relative: of two runs that agree to this the finer is far more accurate, the order being 32
ROUNDED = 1e-14  # a change this small that no longer shrinks is rounding, amplified by unequal masses
HALVINGS = 10
FINE = 2**200  # denominator of the fractions that approximate irrational nodes


@dataclass(frozen=True)
class ReferenceMotion:
    """Motions of one robot from several states, at the same times.

    t      (N,)         [s], from 0
    q      (N, K, nq)   coordinates, rounded to float64
    v      (N, K, nv)   velocities
    error  (N,)         largest difference to the motion with twice the step, relative to the largest |v| and to the
                        largest change of a coordinate until then
    steps  number of steps of the finer motion
    """

    t: Array
    q: Array
    v: Array
    error: Array
    steps: int


def exact_motion(model: Model, q0: Array, v0: Array, t: Array, goal: float = GOAL, steps: int = 1) -> ReferenceMotion:
    """Free motions from (q0, v0) at the times t, to a relative error ``goal`` if that is within reach.

    q0     (K, nq)  [rad | m]; quaternions and (cos, sin) pairs are normalised
    v0     (K, nv)  [rad/s | m/s]
    t      (N,)     increasing, the first 0 [s]
    steps  first number of steps between two times; doubled until two runs agree to ``goal``, or HALVINGS times

    Returns a ReferenceMotion; ``error`` says how accurate it is: any arithmetic loses a chaotic motion after some time.
    Raises  SimulationError if the stages do not converge in the shortest steps.
    """
    before: tuple[Array, Array] | None = None
    finest = steps << HALVINGS
    while True:
        found = _run(model, q0, v0, t, steps)
        if found is not None and before is not None:
            error = _difference(model, before, found)
            if error.max(initial=0.0) <= goal or steps >= finest:
                q, v = np.split(found[0], [model.nq], axis=2)
                return ReferenceMotion(t, q, v, error, steps * (len(t) - 1))
        if found is None and steps >= finest:
            raise SimulationError(f"the motion does not settle in steps of {(t[1] - t[0]) / steps:.3g} s")
        before, steps = found, 2 * steps


def _difference(model: Model, one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Relative difference of two runs at each time, of coordinates and of velocities, each over its size until then."""
    off = abs((one[0] - other[0]) + (one[1] - other[1]))
    moved = np.maximum.accumulate(abs(other[0] - other[0][0]).max(axis=1), axis=0)
    fast = np.maximum.accumulate(abs(other[0]).max(axis=1), axis=0)
    size = np.where(np.arange(off.shape[2]) < model.nq, _most(moved, model.nq, True), _most(fast, model.nq, False))
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = off / size[:, None, :]
    return np.asarray(np.where(off == 0.0, 0.0, relative).max(axis=(1, 2)))


def _most(sizes: Array, nq: int, of_q: bool) -> Array:
    part = sizes[:, :nq] if of_q else sizes[:, nq:]
    return np.asarray(part.max(axis=1, initial=0.0)[:, None])


# --- the method ---------------------------------------------------------------------------------------------


@cache
def tableau() -> Array:
    """(STAGES + 1, STAGES, 2): weights a_ij of the stages as pairs, the last row those of the step.

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
    return np.array([[_pair(x) for x in row] for row in rows])


def _legendre(c: Fraction) -> list[Fraction]:
    """P_0 ... P_STAGES of [0, 1] at c."""
    x, P = 2 * c - 1, [Fraction(1), 2 * c - 1]
    for k in range(1, STAGES):
        P.append(Fraction(round(((2 * k + 1) * x * P[k] - k * P[k - 1]) / (k + 1) * FINE), FINE))
    return P


def _zero(k: int) -> Fraction:
    """Node k of STAGES: Newton's method on P_STAGES from the float's."""
    c = Fraction(float(np.polynomial.legendre.leggauss(STAGES)[0][k])) / 2 + Fraction(1, 2)
    for _ in range(4):
        P, x = _legendre(c), 2 * c - 1
        slope = 2 * STAGES * (x * P[STAGES] - P[STAGES - 1]) / (x * x - 1)
        c = Fraction(round((c - P[STAGES] / slope) * FINE), FINE)
    return c


def _pair(x: Any) -> tuple[float, float]:
    hi = float(x)
    return hi, float(x - Fraction(hi))


# --- the run ------------------------------------------------------------------------------------------------


@lru_cache(maxsize=16)
def field(model: Model) -> DoubleDouble:
    """(q̇, a) of (q, v) without torques."""
    aba, zero = numba_kernels.variant(SPECS["aba"], frozenset()), np.zeros(model.nv)

    def made(rows: Any, x: Any) -> list[Any]:
        q, v = x[: model.nq], x[model.nq :]
        dq = np.zeros(model.nq, dtype=object)
        coordinate_rate(rows, q, v, dq)
        a = evaluate(aba, rows, (model.nv,), {"q": q, "v": v, "tau": zero}, np.empty(model.nv, object))
        return [*dq, *a]

    return record_double_double(model.bodies, model.nq + model.nv, made)


def _normal(model: Model, q: Array) -> tuple[Array, Array]:
    """(nq, K) high and low parts of q normalised in double-double."""
    spec: Spec = SPECS["normalize"]

    def made(rows: Any, x: Any) -> list[Any]:
        return list(evaluate(spec, rows, (model.nq,), {"q": x}, None))

    return record_double_double(model.bodies, model.nq, made)(np.ascontiguousarray(q.T))


def _run(model: Model, q0: Array, v0: Array, t: Array, steps: int) -> tuple[Array, Array] | None:
    """High and low parts (N, K, nq + nv) of the states; None if the stages of a step do not converge."""
    f, A = field(model), tableau()
    n, motions = model.nq + model.nv, len(q0)
    whole = np.zeros((2, n, motions))
    whole[0, : model.nq], whole[1, : model.nq] = _normal(model, q0)
    whole[0, model.nq :] = v0.T
    y = whole.reshape(2, n * motions)  # a view
    slopes, sums = np.zeros((2, STAGES, n * motions)), np.empty((2, n * motions))
    scratch = np.zeros((-(-STAGES * motions // LANES), f.rows, 2 * LANES))
    made = np.empty((2, len(t), motions, n))
    made[:, 0] = whole.transpose(0, 2, 1)
    for k in range(1, len(t)):
        hh, hl = _pair((Fraction(float(t[k])) - Fraction(float(t[k - 1]))) / steps)
        for _ in range(steps):
            if not _stepper()(f.code, f.value, f.outputs, A, hh, hl, y, slopes, sums, scratch):
                return None
        made[:, k] = whole.transpose(0, 2, 1)
    return made[0], made[1]


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
        if sweep > 20 and change > before:  # diverges before it is rounding
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
    return compile_unfused(numba_kernels.kernel_from_text("reference_step", names, body, scope))

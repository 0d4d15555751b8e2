"""Double-double: a recorded program on numbers of two floats, of 106 bits, many samples side by side.

A recursion is traced on a table whose numbers are lines of the program, so nothing is folded in float64, and one
compiled loop runs any such program: 6 µs for a sample of an arm's ABA where mpmath takes 50 ms. It is what holds
thousands of samples, or every stage of an integrator, against the truth; ``multiprecision`` has any number of digits,
and is what this is held against.

A number is (hi, lo) with hi the float nearest to hi + lo. Nothing here may be contracted to fused operations: the
error of a product is found from the product as it was rounded.

Sources: Dekker, A floating-point technique for extending the available precision (1971); Joldes, Muller, Popescu, Tight
and rigorous error bounds for basic building blocks of double-word arithmetic (2017), whose algorithms 6 and 12 add and
multiply.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ...algebra.scalars import inlined
from ...errors import SpatialDynError
from ..compiled import numba_kernels
from ..programs.tracer import (
    ADD,
    CONST,
    COS,
    DIV,
    INPUT,
    MUL,
    SELECT,
    SIN,
    SQRT,
    SUB,
    Program,
    Tape,
    operands,
    signed,
    table,
)

Array = NDArray[np.float64]

EPS = 2.0**-104  # of one operation, at most a few of these; sin and cos to twice that
SPLITTER = 134217729.0  # 2^27 + 1
REACH = 1e8  # largest angle whose sine has all its digits


# --- numbers of two floats ----------------------------------------------------------------------------------


@inlined
def two_sum(a: float, b: float) -> tuple[float, float]:
    """a + b as it is rounded, and what that loses."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@inlined
def quick_sum(a: float, b: float) -> tuple[float, float]:
    """The same for |a| >= |b|."""
    s = a + b
    return s, b - (s - a)


@inlined
def two_product(a: float, b: float) -> tuple[float, float]:
    """a b as it is rounded, and what that loses."""
    p = a * b
    t, u = SPLITTER * a, SPLITTER * b
    ah, bh = t - (t - a), u - (u - b)
    al, bl = a - ah, b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


@inlined
def add(ah: float, al: float, bh: float, bl: float) -> tuple[float, float]:
    """a + b, to 3 · 2^-106 of itself also where it cancels."""
    sh, sl = two_sum(ah, bh)
    th, tl = two_sum(al, bl)
    vh, vl = quick_sum(sh, sl + th)
    return quick_sum(vh, tl + vl)


@inlined
def multiply(ah: float, al: float, bh: float, bl: float) -> tuple[float, float]:
    """a b."""
    p, e = two_product(ah, bh)
    return quick_sum(p, e + (ah * bl + al * bh))


@inlined
def divide(ah: float, al: float, bh: float, bl: float) -> tuple[float, float]:
    """a / b, digit by digit of 53 bits."""
    x = ah / bh
    ph, pl = multiply(x, 0.0, bh, bl)
    rh, rl = add(ah, al, -ph, -pl)
    y = rh / bh
    ph, pl = multiply(y, 0.0, bh, bl)
    rh, rl = add(rh, rl, -ph, -pl)
    xh, xl = quick_sum(x, y)
    return add(xh, xl, rh / bh, 0.0)


@inlined
def root(ah: float, al: float) -> tuple[float, float]:
    """√a: two steps of Newton's method from the float's."""
    if ah == 0.0:
        return 0.0, 0.0
    x = np.sqrt(ah)
    ph, pl = two_product(x, x)
    xh, xl = quick_sum(x, add(ah, al, -ph, -pl)[0] / (2.0 * x))
    ph, pl = multiply(xh, xl, xh, xl)
    return add(xh, xl, add(ah, al, -ph, -pl)[0] / (2.0 * x), 0.0)


def _pair(x: Fraction) -> tuple[float, float]:
    hi = float(x)
    return hi, float(x - Fraction(hi))


TERMS = 15  # of the series of sin and cos: the next is below 1e-33 at π/4
SINE = np.array([_pair(Fraction((-1) ** k, math.factorial(2 * k + 1))) for k in range(TERMS)])
COSINE = np.array([_pair(Fraction((-1) ** k, math.factorial(2 * k))) for k in range(TERMS)])
# π/2 = (3.14159265358979323846264338327950288419716939937510582097494459...) / 2 in three floats
_HALF_PI = Fraction(314159265358979323846264338327950288419716939937510582097494459230781640628621, 2 * 10**77)
P1 = float(_HALF_PI)
P2 = float(_HALF_PI - Fraction(P1))
P3 = float(_HALF_PI - Fraction(P1) - Fraction(P2))


@inlined
def _series(c: Any, h: float, l: float) -> tuple[float, float]:
    """Σ c_k x^k."""
    sh, sl = c[TERMS - 1, 0], c[TERMS - 1, 1]
    for k in range(TERMS - 2, -1, -1):
        sh, sl = multiply(sh, sl, h, l)
        sh, sl = add(sh, sl, c[k, 0], c[k, 1])
    return sh, sl


@inlined
def sine(ah: float, al: float, quarter: float) -> tuple[float, float]:
    """sin(a + quarter · π/2), for |a| to REACH; quarter is 0 or 1."""
    n = np.rint(ah / P1)
    ph, pl = two_product(n, P1)
    rh, rl = add(ah, al, -ph, -pl)
    ph, pl = two_product(n, P2)
    rh, rl = add(rh, rl, -ph, -pl)
    rh, rl = add(rh, rl, -n * P3, 0.0)
    turn = n + quarter
    turn -= 4.0 * np.floor(0.25 * turn)
    xh, xl = multiply(rh, rl, rh, rl)
    if turn == 1.0 or turn == 3.0:
        sh, sl = _series(COSINE, xh, xl)
    else:
        sh, sl = _series(SINE, xh, xl)
        sh, sl = multiply(sh, sl, rh, rl)
    if turn >= 2.0:
        return -sh, -sl
    return sh, sl


# --- programs of them ---------------------------------------------------------------------------------------


class Twofold(NamedTuple):
    """A program as the loop runs it.

    code     (lines, 5) int64: operation, register written, and up to three read; -r - 1 stands for minus register r
    value    (lines,) of constants
    inputs   how many there are; input k is in register k, which nothing overwrites
    outputs  (results,) registers, -r - 1 for minus register r
    rows     registers
    """

    code: NDArray[np.int64]
    value: Array
    inputs: int
    outputs: NDArray[np.int64]
    rows: int

    def __call__(self, inputs: Array, lows: Array | None = None) -> tuple[Array, Array]:
        """(results, samples) high and low parts, of inputs (inputs, samples) and, unless they are floats, their low
        parts.
        """
        samples, n = inputs.shape[1], self.inputs
        made = np.empty((2, len(self.outputs), samples))
        at = np.where(self.outputs < 0, -self.outputs - 1, self.outputs)
        sign = np.where(self.outputs < 0, -1.0, 1.0)[:, None]
        x = np.zeros((self.rows, 2 * LANES))
        for first in range(0, samples, LANES):
            part = slice(first, min(first + LANES, samples))
            count = part.stop - first
            x[:n, :count] = inputs[:, part]
            x[:n, LANES : LANES + count] = 0.0 if lows is None else lows[:, part]
            with np.errstate(all="ignore"):  # where nothing is compiled, of samples that only fill the lanes
                runner()(self.code, self.value, x)
            made[0, :, part] = sign * x[at, :count]
            made[1, :, part] = sign * x[at, LANES : LANES + count]
        return made[0], made[1]


LANES = 64  # samples side by side: a number that compiled code knows, so that it can work on several at once


def recorded(bodies: NDArray[Any], inputs: int, made: Callable[..., Sequence[Any]]) -> Twofold:
    """The program of ``made(rows, x)``: numbers made of a table's rows and of so many inputs x.

    Every number of the table becomes a constant of the program but 0 and ±1, so that none meets another in float64.
    Raises SpatialDynError for an operation that there is not in double-double, an arctangent.
    """
    tape = Tape()
    x = np.empty(inputs, dtype=object)
    x[:] = [tape.input(k) for k in range(inputs)]
    rows = table(bodies, tape.unfolded)
    return assembled(Program(tape, made(rows, x), inputs, fuse=False))


def assembled(program: Program) -> Twofold:
    """A program with registers in the place of lines, each used again after its last reader."""
    lines, kept = program.lines, {line for line, _ in program.outputs}
    last = {k: at for at, op in enumerate(lines) for k in operands(op)}
    register: dict[int, int] = {}
    free: list[int] = []
    rows, code, value = program.inputs, [], []
    for at, op in enumerate(lines):
        if op.code == INPUT:
            register[at] = op.a
            continue
        if op.code not in (CONST, ADD, SUB, MUL, DIV, SQRT, SIN, COS, SELECT):
            raise SpatialDynError(
                f"operation {op.code} has no double-double form, expected + - * / sqrt sin cos select"
            )
        read = [register[k] if k >= 0 else -register[-k - 1] - 1 for k in signed(op)]
        over = {k for k in operands(op) if last[k] == at and k not in kept and lines[k].code != INPUT}
        done = [register[k] for k in sorted(over)]
        if free:
            register[at] = free.pop()
        else:
            register[at], rows = rows, rows + 1
        free += done  # not before: an operation that writes where it reads would not run on several samples at once
        code.append([op.code, register[at], *read, *([0] * (3 - len(read)))])
        value.append(op.value)
    outputs = [-register[line] - 1 if minus else register[line] for line, minus in program.outputs]
    return Twofold(
        np.array(code, np.int64).reshape(-1, 5), np.array(value), program.inputs, np.array(outputs, np.int64), rows
    )


@inlined
def interpret(code: Any, value: Any, x: Any) -> None:
    """Run a program on registers x (rows, 2 LANES), high parts before low ones, whose first rows hold the inputs."""
    for k in range(len(code)):
        what, o, a, b = code[k, 0], code[k, 1], code[k, 2], code[k, 3]
        if what == MUL:
            for s in range(LANES):
                x[o, s], x[o, LANES + s] = multiply(x[a, s], x[a, LANES + s], x[b, s], x[b, LANES + s])
        elif what == ADD:
            for s in range(LANES):
                x[o, s], x[o, LANES + s] = add(x[a, s], x[a, LANES + s], x[b, s], x[b, LANES + s])
        elif what == SUB:
            for s in range(LANES):
                x[o, s], x[o, LANES + s] = add(x[a, s], x[a, LANES + s], -x[b, s], -x[b, LANES + s])
        elif what == CONST:
            for s in range(LANES):
                x[o, s], x[o, LANES + s] = value[k], 0.0
        elif what == DIV:
            for s in range(LANES):
                x[o, s], x[o, LANES + s] = divide(x[a, s], x[a, LANES + s], x[b, s], x[b, LANES + s])
        elif what in (SIN, COS):
            quarter = 1.0 if what == COS else 0.0
            for s in range(LANES):
                x[o, s], x[o, LANES + s] = sine(x[a, s], x[a, LANES + s], quarter)
        elif what == SQRT:
            for s in range(LANES):
                h, l = signed_at(x, a, s)
                x[o, s], x[o, LANES + s] = root(h, l)
        elif what == SELECT:
            for s in range(LANES):
                h, l = signed_at(x, a, s)
                x[o, s], x[o, LANES + s] = signed_at(x, b if h > 0.0 else code[k, 4], s)


@inlined
def signed_at(x: Any, a: int, s: int) -> tuple[float, float]:
    """A register, or its negative for -a - 1."""
    if a < 0:
        return -x[-a - 1, s], -x[-a - 1, LANES + s]
    return x[a, s], x[a, LANES + s]


@cache
def runner() -> Callable[..., None]:
    """``interpret``, compiled, without fused operations."""
    function = numba_kernels.define(
        "twofold_interpret", ["code", "value", "x"], ["stamp", "interpret(code, value, x)"], {"interpret": interpret},
    )  # fmt: skip
    return unfused(function)


def unfused(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function compiled, and kept on disk, without ``contract``; as it is where nothing is compiled."""
    made: Callable[..., Any] = njit(**{name: x for name, x in numba_kernels.FLAGS.items() if name != "fastmath"})(
        function
    )
    return made

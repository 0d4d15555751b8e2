"""Double-double: a recorded program on numbers of two floats (106 bits), many samples at once.

A recursion is traced on a table whose numbers are lines of the program, so no constant is folded in float64. One
compiled loop runs all such programs, far faster than mpmath. Double-double is the reference for thousands of samples
and for every stage of an integrator; its own reference is ``multiprecision``.

A number is (hi, lo), where hi is the float nearest to hi + lo. The compiler must not fuse operations here: the error of
a product is computed from the rounded product.

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
from numpy.typing import NDArray

from ...algebra.scalars import inline
from ...errors import SpatialDynError
from ..compiled import numba_kernels
from ..programs.record.constants import SPLITTER
from ..programs.record.mimic_rows import rows_of
from ..programs.record.operations import CONST, FORMS, INPUT, name_of, operands, signed
from ..programs.record.program import Program
from ..programs.record.tracer import Tape, table

Array = NDArray[np.float64]

EPS = 2.0**-104  # the relative error of an operation is a few EPS at most; for sin and cos it may be twice as large


# --- numbers of two floats ----------------------------------------------------------------------------------


@inline
def two_sum(a: float, b: float) -> tuple[float, float]:
    """a + b rounded, and the rounding error."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@inline
def fast_two_sum(a: float, b: float) -> tuple[float, float]:
    """As ``two_sum``, for |a| >= |b|."""
    s = a + b
    return s, b - (s - a)


@inline
def two_product(a: float, b: float) -> tuple[float, float]:
    """a b rounded, and the rounding error."""
    p = a * b
    t, u = SPLITTER * a, SPLITTER * b
    ah, bh = t - (t - a), u - (u - b)
    al, bl = a - ah, b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


@inline
def add(ah: float, al: float, bh: float, bl: float) -> tuple[float, float]:
    """a + b, with a relative error of at most 3 · 2^-106, also under cancellation."""
    sh, sl = two_sum(ah, bh)
    th, tl = two_sum(al, bl)
    vh, vl = fast_two_sum(sh, sl + th)
    return fast_two_sum(vh, tl + vl)


@inline
def subtract(ah: float, al: float, bh: float, bl: float) -> tuple[float, float]:
    """a - b."""
    return add(ah, al, -bh, -bl)


@inline
def multiply(ah: float, al: float, bh: float, bl: float) -> tuple[float, float]:
    """a b."""
    p, e = two_product(ah, bh)
    return fast_two_sum(p, e + (ah * bl + al * bh))


@inline
def divide(ah: float, al: float, bh: float, bl: float) -> tuple[float, float]:
    """a / b, digit by digit of 53 bits."""
    x = ah / bh
    ph, pl = multiply(x, 0.0, bh, bl)
    rh, rl = add(ah, al, -ph, -pl)
    y = rh / bh
    ph, pl = multiply(y, 0.0, bh, bl)
    rh, rl = add(rh, rl, -ph, -pl)
    xh, xl = fast_two_sum(x, y)
    return add(xh, xl, rh / bh, 0.0)


@inline
def root(ah: float, al: float) -> tuple[float, float]:
    """√a: two steps of Newton's method from the float square root."""
    if ah == 0.0:
        return 0.0, 0.0
    x = np.sqrt(ah)
    ph, pl = two_product(x, x)
    xh, xl = fast_two_sum(x, add(ah, al, -ph, -pl)[0] / (2.0 * x))
    ph, pl = multiply(xh, xl, xh, xl)
    return add(xh, xl, add(ah, al, -ph, -pl)[0] / (2.0 * x), 0.0)


@inline
def choose(ah: float, al: float, bh: float, bl: float, ch: float, cl: float) -> tuple[float, float]:
    """b where a > 0, else c."""
    return (bh, bl) if ah > 0.0 else (ch, cl)


def pair(x: Fraction | float) -> tuple[float, float]:
    """The high and low part of a number."""
    hi = float(x)
    return hi, float(x - Fraction(hi))


TERMS = 15  # terms of the series of sin and cos: the next term is below 1e-33 at π/4
SINE = np.array([pair(Fraction((-1) ** k, math.factorial(2 * k + 1))) for k in range(TERMS)])
COSINE = np.array([pair(Fraction((-1) ** k, math.factorial(2 * k))) for k in range(TERMS)])
# π/2 = (3.14159265358979323846264338327950288419716939937510582097494459...) / 2 in three floats
_HALF_PI = Fraction(314159265358979323846264338327950288419716939937510582097494459230781640628621, 2 * 10**77)
P1 = float(_HALF_PI)
P2 = float(_HALF_PI - Fraction(P1))
P3 = float(_HALF_PI - Fraction(P1) - Fraction(P2))


@inline
def _series(c: Any, h: float, l: float) -> tuple[float, float]:
    """Σ c_k x^k."""
    last = len(c) - 1
    sh, sl = c[last, 0], c[last, 1]
    for k in range(last - 1, -1, -1):
        sh, sl = multiply(sh, sl, h, l)
        sh, sl = add(sh, sl, c[k, 0], c[k, 1])
    return sh, sl


@inline
def sine(ah: float, al: float, quarter: float) -> tuple[float, float]:
    """sin(a + quarter · π/2), to all digits for |a| up to 1e8; quarter is 0 or 1."""
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


# ln 2 = 0.693147180559945309417232121458176568075500134360255254120680009493393621969694715605863326996418687542...
_LN2 = Fraction(693147180559945309417232121458176568075500134360255254120680009493393621969694716, 10**81)
L1 = float(_LN2)
L2 = float(_LN2 - Fraction(L1))
L3 = float(_LN2 - Fraction(L1) - Fraction(L2))
POWERS = 26  # terms of the series of exp: the next term is below 1e-37 at ln(2) / 2
EXPONENTIAL = np.array([pair(Fraction(1, math.factorial(k))) for k in range(POWERS)])


@inline
def exponential(ah: float, al: float) -> tuple[float, float]:
    """e^a; its low part loses digits where it underflows, below e^-670."""
    if ah > 709.782712893384:
        return np.inf, 0.0
    if ah < -745.2:
        return 0.0, 0.0
    n = np.rint(ah / L1)
    ph, pl = two_product(n, L1)
    rh, rl = add(ah, al, -ph, -pl)
    ph, pl = two_product(n, L2)
    rh, rl = add(rh, rl, -ph, -pl)
    rh, rl = add(rh, rl, -n * L3, 0.0)
    sh, sl = _series(EXPONENTIAL, rh, rl)
    half = np.floor(0.5 * n)
    a, b = 2.0**half, 2.0 ** (n - half)
    return sh * a * b, sl * a * b


# --- programs -----------------------------------------------------------------------------------------------


class DoubleDouble(NamedTuple):
    """A program for the interpreter.

    code     (lines, 5) int64: operation, register written, up to three registers read; -r - 1 is minus register r
    value    (lines,) of constants
    inputs   number of inputs; input k is in register k, which is never overwritten
    outputs  (results,) registers, -r - 1 for minus register r
    rows     number of registers
    """

    code: NDArray[np.int64]
    value: Array
    inputs: int
    outputs: NDArray[np.int64]
    rows: int

    def __call__(self, inputs: Array, lows: Array | None = None) -> tuple[Array, Array]:
        """High and low parts of the results, each (results, samples).

        inputs  (inputs, samples)
        lows    (inputs, samples) low parts of the inputs; None if the inputs are floats
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
            with np.errstate(all="ignore"):  # without compilation, lanes that hold no sample would warn
                compiled_interpreter()(self.code, self.value, x)
            made[0, :, part] = sign * x[at, :count]
            made[1, :, part] = sign * x[at, LANES : LANES + count]
        return made[0], made[1]


LANES = 64  # samples at once: a compile-time constant, so that loops over it vectorize


def record_double_double(bodies: NDArray[Any], inputs: int, made: Callable[..., Sequence[Any]]) -> DoubleDouble:
    """The program of ``made(rows, x)``: a function of a table's rows and of ``inputs`` inputs x.

    Every number of the table but 0 and ±1 becomes a constant of the program, so that none is folded in float64.
    Raises SpatialDynError for an operation without a double-double form, an arctangent.
    """
    tape = Tape()
    x = np.empty(inputs, dtype=object)
    x[:] = [tape.input(k) for k in range(inputs)]
    rows = rows_of(table(bodies, tape.unfolded))
    return allocate_registers(Program(tape, made(rows, x), inputs, fuse=False))


def allocate_registers(program: Program) -> DoubleDouble:
    """A program with registers in place of lines; a register is reused after its last reader."""
    program.straight("double-double")
    lines, kept = program.lines, {line for line, _ in program.outputs}
    last = {k: at for at, op in enumerate(lines) for k in operands(op)}
    register: dict[int, int] = {}
    free: list[int] = []
    rows, code, value = program.inputs, [], []
    for at, op in enumerate(lines):
        if op.code == INPUT:
            register[at] = op.a
            continue
        if op.code != CONST and not FORMS[op.code].registers:
            there = " ".join(form.name for form in FORMS.values() if form.registers)
            raise SpatialDynError(f"operation {name_of(op.code)} has no double-double form, expected {there}")
        read = [register[k] if k >= 0 else -register[-k - 1] - 1 for k in signed(op)]
        over = {k for k in operands(op) if last[k] == at and k not in kept and lines[k].code != INPUT}
        done = [register[k] for k in sorted(over)]
        if free:
            register[at] = free.pop()
        else:
            register[at], rows = rows, rows + 1
        free += done  # only now: an operation that writes a register it reads does not vectorize
        code.append([op.code, register[at], *read, *([0] * (3 - len(read)))])
        value.append(op.value)
    outputs = [-register[line] - 1 if minus else register[line] for line, minus in program.outputs]
    return DoubleDouble(
        np.array(code, np.int64).reshape(-1, 5), np.array(value), program.inputs, np.array(outputs, np.int64), rows
    )


@cache
def interpreter() -> Callable[[Any, Any, Any], None]:
    """``interpret(code, value, x)``: run a program on registers x (rows, 2 LANES), high parts before low parts.

    The first rows hold the inputs. Each operation of FORMS is a branch, with a loop over LANES samples.
    """
    text = ["stamp", "for k in range(len(code)):"]
    text += [f"    {name} = code[k, {at}]" for at, name in enumerate(("what", "o", "a", "b", "c"))]

    def branch(what: int, pair: str) -> list[str]:
        loop = [f"    if what == {what}:", "        for s in range(LANES):"]
        return [*loop, f"            x[o, s], x[o, LANES + s] = {pair}", "        continue"]

    text += branch(CONST, "value[k], 0.0")
    for code, form in FORMS.items():
        if form.registers:
            register = "high(x, {0}, s), low(x, {0}, s)" if form.signs else "x[{0}, s], x[{0}, LANES + s]"
            text += branch(code, form.registers.format(**{name: register.format(name) for name in "abc"}))
    functions = (add, subtract, multiply, divide, root, sine, exponential, choose, high, low)
    scope: dict[str, Any] = {function.__name__: function for function in functions}
    return numba_kernels.kernel_from_text("interpret", ["code", "value", "x"], text, {**scope, "LANES": LANES})


@inline
def high(x: Any, a: int, s: int) -> Any:
    """The high part of a register, or of its negative for -a - 1."""
    return -x[-a - 1, s] if a < 0 else x[a, s]


@inline
def low(x: Any, a: int, s: int) -> Any:
    """The low part, as ``high``."""
    return -x[-a - 1, LANES + s] if a < 0 else x[a, LANES + s]


@cache
def compiled_interpreter() -> Callable[..., None]:
    """The interpreter, compiled, without fused operations."""
    return compile_unfused(interpreter())


def compile_unfused(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function compiled without ``contract`` and cached on disk; in plain Python without compilation."""
    from ..compiled import jit

    return jit.numba_jit(function, contract=False)

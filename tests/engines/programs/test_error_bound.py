"""Bounds of lines hold against the same program in 200 bits, and fail to if a rule leaves its operands' errors out."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mpmath
import numpy as np
import pytest
from asymmetric import roots
from slow import slow_but

from spatialdyn.algebra import scalars
from spatialdyn.engines.programs.record.constants import constant, error_of
from spatialdyn.engines.programs.record.operations import (
    ADD,
    ATAN2,
    CONST,
    COS,
    DIV,
    EXP,
    FMA,
    FMS,
    FNMA,
    INPUT,
    MUL,
    SELECT,
    SIN,
    SQRT,
    SUB,
    Operation,
    signed,
)
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Number, Tape
from spatialdyn.engines.programs.transform import error_bound
from spatialdyn.engines.programs.transform.error_bound import Bounding

SAMPLES = 4000
IN_BITS: dict[int, Callable[..., Any]] = {
    ADD: lambda a, b: a + b, SUB: lambda a, b: a - b, MUL: lambda a, b: a * b, DIV: lambda a, b: a / b,
    FMA: lambda a, b, c: a * b + c, FMS: lambda a, b, c: a * b - c, FNMA: lambda a, b, c: c - a * b,
    SQRT: lambda a: mpmath.sqrt(a), SIN: lambda a: mpmath.sin(a), COS: lambda a: mpmath.cos(a),
    EXP: lambda a: mpmath.exp(a), ATAN2: lambda a, b: mpmath.atan2(a, b), SELECT: lambda a, b, c: b if a > 0 else c,
}  # fmt: skip


def spoilt(x: Any, y: Any) -> Any:
    """x + y of few correct digits: a sum that cancels."""
    return (x * 1e9 + y) - (x * 1e9 - 0.25 * y)


CASES: dict[int, Callable[..., Any]] = {
    ADD: lambda x, y, z: spoilt(x, y) + z,
    SUB: lambda x, y, z: z - spoilt(x, y),
    MUL: lambda x, y, z: spoilt(x, y) * spoilt(y, z),
    DIV: lambda x, y, z: spoilt(x, y) / spoilt(z, y),
    FMA: lambda x, y, z: spoilt(x, y) * z + x * y,
    FMS: lambda x, y, z: spoilt(x, y) * z - scalars.sqrt(x * x + y * y),
    FNMA: lambda x, y, z: x * y - spoilt(x, y) * z,
    SQRT: lambda x, y, z: scalars.sqrt(spoilt(x, y) * spoilt(x, y) + 1e-3 * z * z),
    SIN: lambda x, y, z: scalars.sin(spoilt(x, y)) + z,
    COS: lambda x, y, z: scalars.cos(spoilt(x, y)) + z,
    EXP: lambda x, y, z: scalars.exp(spoilt(x, y)) * z,
    ATAN2: lambda x, y, z: scalars.atan2(spoilt(x, y), spoilt(y, z)),
    SELECT: lambda x, y, z: scalars.select(spoilt(x, y), spoilt(y, z), spoilt(y, z) + 1e-3 * x),
}


def recorded(code: int) -> Program:
    """A program in which an operation has operands that have lost digits."""
    tape = Tape(errors=True)
    x = [tape.input(k) for k in range(3)]
    program = Program(tape, [CASES[code](*x)], 3, fuse=code in (FMA, FMS, FNMA))
    assert code in {op.code for op in program.lines}
    return program


def bounded(program: Program) -> Program:
    """The program's output and its bound."""
    made = Bounding(np.float64, program.operations["depth"], fma=False)  # NumPy rounds the product too
    (result,) = made.run(program, made.inputs(program.inputs))
    return Program(made.tape, [result.x, made.absolute(result.b)], program.inputs, fuse=False)


def truth(program: Program, sample: np.ndarray) -> Any:
    """The output in 200 bits, of constants as they are."""
    lines: list[Any] = []
    for op in program.lines:
        given = [lines[k] if k >= 0 else -lines[-k - 1] for k in signed(op)]
        leaf = mpmath.mpf(float(sample[op.a]) if op.code == INPUT else op.value)
        lines.append(leaf if op.code in (INPUT, CONST) else IN_BITS[op.code](*given))
    at, minus = program.outputs[0]
    return -lines[at] if minus else lines[at]


def broken(program: Program) -> int:
    """Samples of SAMPLES whose error is above the bound."""
    samples = np.random.default_rng(5).normal(size=(3, SAMPLES))
    found, bound = (np.broadcast_to(x, SAMPLES) for x in bounded(program).run(samples))
    np.testing.assert_array_equal(found, np.broadcast_to(program.run(samples)[0], SAMPLES))
    assert (bound > 0.0).all()
    with mpmath.workprec(200):
        errors = [abs(mpmath.mpf(float(found[k])) - truth(program, samples[:, k])) for k in range(SAMPLES)]
    return sum(not error <= mpmath.mpf(float(b)) for error, b in zip(errors, bound, strict=True))


@pytest.mark.parametrize("code", slow_but([*CASES][::2], CASES))
def test_a_bound_holds_where_digits_cancel(code: int) -> None:
    assert broken(recorded(code)) == 0


@pytest.mark.parametrize("code", slow_but([*CASES][1::2], CASES))
def test_a_rule_that_forgets_its_operands_is_found_out(code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    forgetful = {**error_bound._RULES, code: lambda self, x, *given: self.magnitude(x)}
    monkeypatch.setattr(error_bound, "_RULES", forgetful)
    assert broken(recorded(code)) > 0


def test_the_bound_of_a_sum_is_within_ten_times_its_error() -> None:
    """Of 1000 terms of one sign, whose rounding errors do not cancel on purpose."""
    tape = Tape(errors=True)
    total: Any = tape.input(0)
    for _ in range(1000):
        total = total + tape.input(1)
    (line,) = bounded(Program(tape, [total], 2)).run([1.0, 1.0 + 2.0**-30])[1:]
    assert 0.33 * 1000**2 * 2.0**-53 < line < 0.35 * 1000**2 * 2.0**-53  # Σ ufp k is 0.338 of 1000²


@pytest.mark.parametrize("excess", [1e-6, -1e-6, 1e-9, -1e-12])
@pytest.mark.parametrize("width", [2, 4])
def test_coordinates_off_unit_norm_are_bounded_by_what_norms_them(width: int, excess: float) -> None:
    """A quaternion or pair of norm 1 + excess is off x / |x| by that; the bound is less than 1.05 times it."""
    made = Bounding(np.float64, 1, fma=False)
    given = made.inputs(width, [range(width)])
    program = Program(made.tape, [made.absolute(x.b) for x in given], width, fuse=False)
    x = roots(width)
    x *= (1.0 + excess) / np.linalg.norm(x)
    with mpmath.workprec(200):
        whole = [mpmath.mpf(float(e)) for e in x]
        size = mpmath.sqrt(sum(e * e for e in whole))
        off = [abs(float(e / size - e)) for e in whole]
    for bound, error in zip(program.run(x), off, strict=True):
        assert error <= bound <= 1.05 * error + 1e-15


def test_a_divisor_that_may_be_zero_has_no_bound() -> None:
    tape = Tape(errors=True)
    x, y = tape.input(0), tape.input(1)
    program = bounded(Program(tape, [1.0 / ((x + y) - x)], 2))
    assert program.run([1e20, 1.0])[1] == math.inf
    assert program.run([1.0, 1.0])[1] < 1e-14


def test_constants_of_one_float_do_not_cancel_without_a_bound() -> None:
    """0.1 · 0.3 and the float that it rounds to: their difference is 0, and not that of the numbers."""
    tape = Tape(errors=True)
    x, product = tape.input(0), constant(0.1) * 0.3
    one, other = x * product, x * constant(float(product))
    program = Program(tape, [one - other, one, other], 1)
    made = Bounding(np.float64, program.operations["depth"], fma=False)
    result = made.run(program, made.inputs(1))[0]
    found, bound = Program(made.tape, [result.x, made.absolute(result.b)], 1, fuse=False).run([2.0])
    assert abs(found - 2.0 * error_of(product)) <= bound < 2.0**-53


def test_signs_of_operands_do_not_change_a_value() -> None:
    """Operations on results of another program, which may be negated."""
    tape = Tape(errors=True)
    x, y, z = (tape.input(k) for k in range(3))
    program = Program(tape, [x * y + z, x * z - (x + y), x - y * z], 3)
    assert {op.code for op in program.lines} >= {FMA, FMS, FNMA}
    values = np.random.default_rng(0).normal(size=3)
    for signs in np.ndindex(2, 2, 2):
        made = Bounding(np.float64, 9, fma=True)
        given = [made.exact(Number(made.tape, made.tape.input(k).line, bool(s))) for k, s in enumerate(signs)]
        outputs = [r.x for r in made.run(program, given)]
        got = Program(made.tape, outputs, 3, fuse=False).run(values)
        assert got == program.run(np.where(signs, -values, values))


def test_every_operation_has_a_rule() -> None:
    from spatialdyn.engines.programs.record.operations import FORMS

    assert set(error_bound._RULES) == set(FORMS)
    assert Operation(ADD).code in error_bound._RULES

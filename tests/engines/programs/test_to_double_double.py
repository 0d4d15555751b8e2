"""Double-double in plain float operations: sums and products that keep the rounding error."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from spatialdyn.algebra.scalars import cos, sin, sqrt
from spatialdyn.engines.programs.record.operations import FMS
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Number, Tape
from spatialdyn.engines.programs.transform.to_double_double import to_double_double
from spatialdyn.errors import SpatialDynError

SEEN = 2.0**-100  # rounding of a hundred bits in sums whose terms are of size 1
SEEDS = range(8)


def program_of(made: object, inputs: int, fma: bool = False) -> Program:
    """The program in double-double of a function of so many numbers and a constant of 53 bits."""
    tape = Tape()
    x = [tape.input(k) for k in range(inputs)]
    return to_double_double(Program(tape, [made(x, tape.number(1.0 / 3.0))], inputs, fuse=False), fma)  # type: ignore[operator]


def polynomial(x: list[Number], c: Number) -> Number:
    """Sums that cancel to 1e-16 of their terms, whose float64 has no digit."""
    a, b = x
    whole = (a + b) * (a - b) / c
    return whole * c - a * a + b * b + a * c * (b * c) * (a - b)


@pytest.mark.parametrize("seed", SEEDS)
def test_sums_products_and_quotients_have_a_hundred_bits(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=2).tolist()
    (found,) = program_of(polynomial, 2).run([a, b])
    x, y, c = Fraction(a), Fraction(b), Fraction(1.0 / 3.0)
    wanted = x * c * (y * c) * (x - y)
    assert abs(float(Fraction(float(found)) - wanted)) <= 2.0**-53 * abs(float(wanted)) + 16 * SEEN


@pytest.mark.parametrize("seed", SEEDS)
def test_cancellation_leaves_the_rounding_errors(seed: int) -> None:
    a, b = np.random.default_rng(seed).normal(size=2).tolist()
    (found,) = program_of(lambda x, c: (x[0] * x[1] + c) - c - x[0] * x[1] + x[0] * 1e-25, 2).run([a, b])
    assert abs(float(found) - 1e-25 * a) <= 16 * SEEN


def test_sine_and_cosine_lie_on_the_unit_circle() -> None:
    angles = np.random.default_rng(0).uniform(-4.0, 4.0, 64)
    (found,) = program_of(lambda x, c: sin(x[0]) * sin(x[0]) + cos(x[0]) * cos(x[0]) - c / c, 1).run([angles])
    assert abs(found).max() <= 16 * SEEN


def test_constants_meet_in_exact_arithmetic() -> None:
    (found,) = program_of(lambda x, c: x[0] * ((c * c) * (c * c) - c * c * (c * c)) + (c + 1e-20) - c, 1).run([1.0])
    assert abs(float(found) - 1e-20) <= 16 * SEEN


def test_products_keep_what_they_lose_in_one_fused_operation_where_the_host_has_it() -> None:
    assert any(op.code == FMS for op in program_of(polynomial, 2, fma=True).lines)
    assert not any(op.code == FMS for op in program_of(lambda x, c: x[0] * x[1], 2).lines)


def test_what_has_no_double_double_form_is_refused() -> None:
    with pytest.raises(SpatialDynError, match="double-double"):
        program_of(lambda x, c: sqrt(x[0]), 1)

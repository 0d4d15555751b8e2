"""Constants of a program keep their digits when they are folded."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record.constants import Constant, error_of
from spatialdyn.engines.programs.record.operations import CONST
from spatialdyn.engines.programs.record.recording import record
from spatialdyn.engines.programs.record.tracer import Tape
from spatialdyn.recursions import SPECS

DIGITS = Fraction(1, 2**98)  # of the larger operand or of the result: some operations in a row at 2^-104 each


def exact(x: float) -> Fraction:
    return Fraction(float(x)) + Fraction(x.low if isinstance(x, Constant) else 0)


def pair(rng: np.random.Generator) -> Constant:
    high = float(rng.normal() * 10.0 ** rng.integers(-8, 8))
    return Constant(high, float(rng.uniform(-0.4, 0.4)) * math.ulp(high))


@pytest.mark.parametrize("seed", range(50))
def test_sums_products_and_quotients_have_twice_the_digits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y, f = pair(rng), pair(rng), float(rng.normal())
    X, Y, F = exact(x), exact(y), Fraction(f)
    sums = [(x + y, X + Y), (x - y, X - Y), (x + f, X + F), (f + x, X + F), (x - f, X - F), (f - x, F - X)]
    for made, wanted in sums:
        assert abs(exact(made) - wanted) <= DIGITS * max(abs(X), abs(Y), abs(F))
    products = [(x * y, X * Y), (f * x, F * X), (x * f, F * X), (x / y, X / Y), (x / f, X / F), (f / x, F / X)]
    for made, wanted in [*products, (-x, -X), (abs(x), abs(X))]:
        assert abs(exact(made) - wanted) <= DIGITS * abs(wanted)
        assert float(made) == float(exact(made))


def test_what_a_cancellation_leaves_is_right() -> None:
    thin, J, u = 1e-12, Constant(1.0 / 12.0), Constant(0.6)
    D = u * u * J + 0.64 * thin
    left = J - (u * J) * ((1.0 / D) * (u * J))
    wanted = exact(J) - (exact(u) * exact(J)) ** 2 / exact(D)
    assert abs(exact(left) / wanted - 1) <= 2.0**-52
    assert abs(Fraction(1 / 12 - (0.6 / 12) * (1 / float(D) * (0.6 / 12))) / wanted - 1) >= 2.0**-20  # in float64


def test_a_sum_is_zero_where_that_of_the_floats_is() -> None:
    x = Constant(1.0, 1e-17)
    assert x - 1.0 == 0.0
    assert (x - Constant(1.0, -1e-17)) == 0.0
    assert type(Constant(1.0) - 1.0) is float


def test_what_a_sum_drops_is_an_error_that_later_numbers_carry() -> None:
    dropped = Constant(1.0, 1e-17) - 1.0
    assert error_of(dropped) == 1e-17
    assert error_of(dropped - dropped) == 2e-17
    assert error_of(-(3.0 * dropped)) == pytest.approx(3e-17)
    assert error_of((2.0 + dropped) / 4.0) == pytest.approx(0.25e-17)
    assert error_of(1.0 / (1e-17 * Constant(1.0) + dropped)) == math.inf
    assert error_of(Constant(1.5) * 2.0) == error_of(1.5) == 0.0
    assert error_of(Constant(0.1) * 3.0) == abs((Constant(0.1) * 3.0).low) > 0.0


def test_a_tape_of_errors_absorbs_exact_zeros_and_ones_alone() -> None:
    zero, one = Constant(1.0, 1e-17) - 1.0, Constant(1.0, 1e-17)
    for errors, lines in ((False, 0), (True, 3)):
        tape = Tape(errors)
        x = tape.input(0)
        before = len(tape.lines)
        made = [x + zero, x * zero, x * one]
        codes = [line[0] for line in tape.lines[before:]]
        assert len([code for code in codes if code != CONST]) == lines, made
        if errors:
            assert sorted(tape.errors or ()) == [0.0, 1e-17]


def test_numbers_too_large_for_twice_the_digits_are_floats() -> None:
    x = Constant(1e305)
    assert float(x * 2.0) == 2e305
    assert float(x + 1e305) == 2e305
    assert float(x / 0.5) == 2e305
    assert float(x * x) == math.inf
    with pytest.raises(ZeroDivisionError):
        x / 0.0


def test_what_is_no_float_is_left_to_its_own_arithmetic() -> None:
    for made in (Constant(0.5) * Fraction(1, 2), Fraction(1, 2) * Constant(0.5)):
        assert made == 0.25
    with pytest.raises(TypeError):
        Constant(1.0) + "1"


def test_a_program_folds_the_inertia_of_a_tip_exactly() -> None:
    """D⁻¹ U Uᵀ of a thin rod about an oblique axis cancels to 1e-12 of the rod's; folded in float64 it had 5 digits."""
    thin, along, across = Fraction(1e-12), Fraction(0.8), Fraction(-0.6)
    rod = (1.0, np.zeros(3), np.diag([float(thin), 1.0, 1.0]))
    made = sd.ModelBuilder("two").add_body("a", None, "revolute", (1.0, 0.0, 0.0), inertia=rod)
    model = made.add_body("b", "a", "revolute", (0.8, 0.0, -0.6), inertia=rod).build()
    lines = record((numba_kernels.variant(SPECS["aba"], frozenset()),), model.bodies).program.lines
    constants = [line.value for line in lines if line.code == CONST]
    D = along**2 * thin + across**2
    for wanted in (1 - across**2 / D, thin - (along * thin) ** 2 / D, -along * across * thin / D):
        assert min(abs(Fraction(x) / wanted - 1) for x in constants) <= 2.0**-50

"""Double-double agrees with exact arithmetic to its 104 bits, operation by operation and call by call."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
from dense import Array
from slow import slow_but
from trees import random_state, random_tree

import spatialdyn as sd
from spatialdyn.algebra.scalars import atan2, cos, exp, select, sin, sqrt
from spatialdyn.calls.dynamics import calls
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.numbers import double_double
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Tape, evaluate
from spatialdyn.errors import SpatialDynError
from spatialdyn.recursions import SPECS

ROUNDING = 4 * 2.0**-104  # of one operation: 10 · 2^-106 is the bound of a quotient
SINES = 64 * 2.0**-104  # of a series of 15 terms and an angle that was reduced
EXPONENTIAL = 64 * 2.0**-104  # of a series of 26 terms, times 1 + |x| for the argument's own error
SOLVED = 1e-28  # 1e4 operations of 2^-104 on an M whose condition is below 1e3
compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="heavy: an interpreter in Python")


def pairs(rng: np.random.Generator, count: int, spread: float = 30.0) -> list[tuple[float, float]]:
    """Random double-doubles of sizes within 2^±spread."""
    made = []
    for _ in range(count):
        hi = float(rng.normal() * 2.0 ** rng.uniform(-spread, spread))
        made.append(double_double.fast_two_sum(hi, hi * float(rng.uniform(-1, 1)) * 2.0**-54))
    return made


def value(x: tuple[float, float]) -> Fraction:
    return Fraction(float(x[0])) + Fraction(float(x[1]))


def relative(found: tuple[float, float], wanted: Fraction) -> float:
    return float(abs(value(found) - wanted) / abs(wanted)) if wanted else float(abs(value(found)))


def test_sums_products_quotients_and_roots_have_104_bits() -> None:
    rng = np.random.default_rng(0)
    for a, b in zip(pairs(rng, 300), pairs(rng, 300), strict=True):
        assert relative(double_double.add(*a, *b), value(a) + value(b)) <= ROUNDING
        assert relative(double_double.multiply(*a, *b), value(a) * value(b)) <= ROUNDING
        assert relative(double_double.divide(*a, *b), value(a) / value(b)) <= ROUNDING
        square = double_double.multiply(*a, *a)
        assert abs(relative(double_double.root(*square), abs(value(a)))) <= ROUNDING


def test_a_sum_that_cancels_keeps_its_digits() -> None:
    rng = np.random.default_rng(1)
    for a in pairs(rng, 100):
        b = double_double.fast_two_sum(-a[0], a[1] * float(rng.uniform(-1, 1)))
        assert relative(double_double.add(*a, *b), value(a) + value(b)) <= ROUNDING


def test_half_pi_in_three_floats_is_half_pi_to_150_bits() -> None:
    with mpmath.workprec(300):
        whole = mpmath.mpf(double_double.P1) + mpmath.mpf(double_double.P2) + mpmath.mpf(double_double.P3)
        assert abs(whole - mpmath.pi / 2) < 2.0**-150


@pytest.mark.parametrize("reach", [1e-9, 1.0, 10.0, 1e5])
def test_sine_and_cosine_have_100_bits(reach: float) -> None:
    rng = np.random.default_rng(2)
    angles = [*rng.uniform(-reach, reach, 100), math.pi / 2, math.pi, 1e5, 0.0]
    with mpmath.workprec(300):
        for h in angles:
            a = double_double.fast_two_sum(float(h), float(h) * 2.0**-55)
            exact = mpmath.mpf(a[0]) + mpmath.mpf(a[1])
            for quarter, wanted in ((0.0, mpmath.sin(exact)), (1.0, mpmath.cos(exact))):
                found = double_double.sine(*a, quarter)
                off = abs(mpmath.mpf(float(found[0])) + mpmath.mpf(float(found[1])) - wanted)
                assert off <= SINES * max(abs(wanted), SINES)


@pytest.mark.parametrize("reach", [1e-12, 0.3, 10.0, 600.0])
def test_exp_has_a_hundred_bits(reach: float) -> None:
    rng = np.random.default_rng(3)
    with mpmath.workprec(300):
        assert (
            abs(sum(map(mpmath.mpf, (double_double.L1, double_double.L2, double_double.L3))) - mpmath.ln2) < 2.0**-150
        )
        for h in [*rng.uniform(-reach, reach, 100), 0.0, math.log(2.0) / 2.0]:
            a = double_double.fast_two_sum(float(h), float(h) * 2.0**-55)
            found = double_double.exponential(*a)
            wanted = mpmath.exp(mpmath.mpf(a[0]) + mpmath.mpf(a[1]))
            off = abs(mpmath.mpf(float(found[0])) + mpmath.mpf(float(found[1])) - wanted)
            assert off <= EXPONENTIAL * (1.0 + reach) * wanted
    assert double_double.exponential(710.0, 0.0) == (math.inf, 0.0)
    assert double_double.exponential(-746.0, 0.0) == (0.0, 0.0)


def test_every_operation_of_a_program_runs_with_its_signs() -> None:
    tape = Tape()
    x, y = tape.input(0), tape.input(1)
    made = [x + y, x - y, y - x, -(x * y), x / y, -x / y, sqrt(x * x), sin(-x), cos(-x), select(-x, y, -y), x * 0.3]
    made.append(exp(-x))
    program = double_double.allocate_registers(Program(tape, made, 2, fuse=False))
    rng = np.random.default_rng(3)
    given = rng.normal(size=(2, 5))
    high, low = program(given)
    a, b = given
    wanted = [
        a + b, a - b, b - a, -a * b, a / b, -a / b, abs(a), -np.sin(a), np.cos(a), np.where(-a > 0, b, -b), a * 0.3,
        np.exp(-a),
    ]  # fmt: skip
    assert abs(high - wanted).max() <= 4 * np.finfo(float).eps
    assert (abs(low) <= abs(high) * 2.0**-52).all()


def test_an_operation_that_there_is_not_is_refused() -> None:
    tape = Tape()
    with pytest.raises(SpatialDynError, match="double-double"):
        double_double.allocate_registers(Program(tape, [atan2(tape.input(0), 1.0)], 1, fuse=False))


def by_call(model: sd.Model, name: str, arrays: list[Array]) -> tuple[Array, Array]:
    """A call of several samples in double-double, (samples, entries) high and low."""
    spec = numba_kernels.variant(SPECS[name], frozenset())
    ends = np.cumsum([0] + [x.shape[1] for x in arrays])
    shape = tuple({"nq": model.nq, "nv": model.nv}[str(s)] for s in spec.output.shape)

    def made(rows: Any, x: Any) -> list[Any]:
        given = {arg.name: x[ends[k] : ends[k + 1]] for k, arg in enumerate(spec.present)}
        return list(evaluate(spec, rows, shape, given, np.empty(model.nv, object)).ravel())

    high, low = double_double.record_double_double(model.bodies, int(ends[-1]), made)(np.concatenate(arrays, axis=1).T)
    return high.T, low.T


@compiled
@pytest.mark.parametrize(("seed", "options"), [(0, {}), (1, {"floating": True, "continuous": "cos_sin"})])
@pytest.mark.parametrize("name", slow_but(["rnea", "aba"], ["rnea", "crba", "aba", "crba_solve"]))
def test_calls_agree_with_the_exact_engine(name: str, seed: int, options: dict[str, Any]) -> None:
    """On more samples than LANES, of which a few are compared."""
    tree, rng = random_tree(seed, 5, **options), np.random.default_rng(seed)
    states = [random_state(tree.tree, rng) for _ in range(double_double.LANES + 3)]
    letters = {"rnea": "qva", "crba": "q", "aba": "qvt", "crba_solve": "qvt"}[name]
    words = {"q": "q", "v": "v", "a": "a", "t": "tau"}
    arrays = [np.array([getattr(s, words[x]) for s in states]) for x in letters]
    high, low = by_call(tree.model, name, arrays)
    for k in (0, len(states) - 1):
        truth = np.ravel(sd.exact(tree.model, calls[name], 240)(*(x[k] for x in arrays)))
        size = max(abs(x) for x in truth)
        assert (
            max(abs(x - float(h) - float(l)) for x, h, l in zip(truth, high[k], low[k], strict=True)) <= SOLVED * size
        )


@compiled
def test_nothing_is_fused_when_compiled() -> None:
    """Compiled code gives the bits of the same source in Python; a contracted product would not."""
    tree = random_tree(2, 4)
    state = random_state(tree.tree, np.random.default_rng(2))
    spec = numba_kernels.variant(SPECS["rnea"], frozenset())
    n, nq = tree.model.nv, tree.model.nq

    def made(rows: Any, x: Any) -> list[Any]:
        given = {"q": x[:nq], "v": x[nq : nq + n], "a": x[nq + n :]}
        return list(evaluate(spec, rows, (n,), given, None))

    program = double_double.record_double_double(tree.model.bodies, nq + 2 * n, made)
    x = np.zeros((program.rows, 2 * double_double.LANES))
    x[: program.inputs, : double_double.LANES] = np.concatenate([state.q, state.v, state.a])[:, None]
    y = x.copy()
    double_double.compiled_interpreter()(program.code, program.value, x)
    double_double.interpreter()(program.code, program.value, y)
    assert (x == y).all()


@compiled
def test_the_compiled_loop_is_cached_on_disk() -> None:
    """A second one, as in another process, is read from disk and gives the same bits; to compile it takes a second."""
    tape = Tape()
    x = [tape.input(k) for k in range(2)]
    program = double_double.allocate_registers(Program(tape, [x[0] * x[1] + sin(x[0]) / x[1]], 2, fuse=False))
    given, made = np.random.default_rng(0).normal(size=(2, 70)), []
    for _ in range(2):
        double_double.compiled_interpreter.cache_clear()
        made.append(program(given))
    assert sum(double_double.compiled_interpreter().stats.cache_hits.values()) == 1  # type: ignore[attr-defined]
    np.testing.assert_array_equal(*made)

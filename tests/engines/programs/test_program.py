"""Programs: what a tape's outputs need, products that one sum reads fused, and the text and counts of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from spatialdyn.algebra import scalars
from spatialdyn.engines.programs.record import operations
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Number, Tape


def tape_of(n: int) -> tuple[Tape, list[Number]]:
    """A tape with n inputs."""
    tape = Tape()
    return tape, [tape.input(k) for k in range(n)]


def test_dead_lines_are_dropped_and_inputs_stay_counted() -> None:
    tape, (x, y, z) = tape_of(3)
    scalars.sin(y) / z
    program = Program(tape, [x + z], 3)
    assert [op.code for op in program.lines] == [operations.INPUT, operations.INPUT, operations.ADD]
    assert [op.a for op in program.lines[:2]] == [0, 2]
    assert program.inputs == 3
    assert program.run([1.0, np.nan, 2.0]) == [3.0]


def test_lines_that_only_a_negated_operand_needs_stay() -> None:
    tape, (x, y) = tape_of(2)
    assert Program(tape, [scalars.sqrt(-(x - y * 2.0))], 2).run([1.0, 5.0]) == [3.0]
    assert Program(tape, [scalars.select(x, -(y * y), 0.0)], 2).run([1.0, 5.0])[0] == -25.0


def test_outputs_may_be_constants_inputs_negated_and_repeated() -> None:
    tape, (x,) = tape_of(1)
    program = Program(tape, [0.0, -2.5, x, -x, x, 1], 1)
    assert program.run([7.0]) == [0.0, -2.5, 7.0, -7.0, 7.0, 1.0]
    assert program.operations["depth"] == 0


def test_listing_and_counts_of_a_small_program() -> None:
    tape, (x, y) = tape_of(2)
    s = scalars.sin(x)
    program = Program(tape, [s * y + 2.0, -(s / y), scalars.sqrt(-y), scalars.select(x, -y, s)], 2)
    assert program.listing().splitlines() == [
        "x0 = input[0]",
        "x1 = input[1]",
        "x2 = sin(x0)",
        "x3 = 2.0",
        "x4 = fma(x1, x2, x3)",
        "x5 = x2 / x1",
        "x6 = sqrt(-x1)",
        "x7 = select(x0, -x1, x2)",
        "output[0] = x4",
        "output[1] = -x5",
        "output[2] = x6",
        "output[3] = x7",
    ]
    assert program.operations == dict(
        mul=1, add=1, div=1, sqrt=1, sincos=1, exp=0, atan2=0, select=1, abs=0, ufp=0, depth=2
    )


def test_a_product_of_one_use_joins_its_sum() -> None:
    for expression, name, value in (
        (lambda x, y, z: x * y + z, "fma", 13.0),
        (lambda x, y, z: z + y * x, "fma", 13.0),
        (lambda x, y, z: x * y - z, "fnma", -1.0),
        (lambda x, y, z: z - x * y, "fnma", 1.0),
        (lambda x, y, z: (z + y) * x - (z - y), "f", 16.0),
    ):
        tape, inputs = tape_of(3)
        program = Program(tape, [expression(*inputs)], 3)
        fused = [
            operations.name_of(op.code)
            for op in program.lines
            if op.code in (operations.FMA, operations.FMS, operations.FNMA)
        ]
        assert len(fused) == 1
        assert fused[0].startswith(name)
        assert not any(op.code == operations.MUL for op in program.lines)
        assert program.run([2.0, 3.0, 7.0]) == [value]
        plain = Program(tape, [expression(*inputs)], 3, fuse=False)
        assert plain.run([2.0, 3.0, 7.0]) == [value]
        assert plain.operations["mul"] == program.operations["mul"] == 1
        assert plain.operations["add"] == program.operations["add"]


def test_a_product_of_more_uses_stays() -> None:
    for outputs in (
        lambda x, y, z: [x * y + z, x * y],
        lambda x, y, z: [x * y + z, x * y - z],
        lambda x, y, z: [x * y + x * y],
        lambda x, y, z: [x * y + z, scalars.sqrt(-(x * y))],
    ):
        tape, inputs = tape_of(3)
        program = Program(tape, outputs(*inputs), 3)
        assert sum(op.code == operations.MUL for op in program.lines) == 1
        assert not any(op.code in (operations.FMA, operations.FMS, operations.FNMA) for op in program.lines)


def test_of_two_products_the_sum_takes_one() -> None:
    tape, (x, y, z) = tape_of(3)
    for sum_, value in ((x * y + y * z, 27.0), (x * y - y * z, -15.0), (y * z - x * y, 15.0)):
        program = Program(tape, [sum_], 3)
        assert program.operations["mul"] == 2
        assert len(program.lines) == 5  # three inputs, a product, a fused sum
        assert program.run([2.0, 3.0, 7.0]) == [value]


@pytest.mark.parametrize("seed", range(20))
def test_random_expressions_are_computed_to_the_bit(seed: int) -> None:
    """+ - * / and select of signs and constants agree with floats; fused sums too, which NumPy rounds twice."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=5).tolist()
    tape, numbers = tape_of(5)
    pool: list[tuple[Any, float]] = list(zip(numbers, values, strict=True))
    for _ in range(60):
        (a, x), (b, y), (c, z) = (pool[k] for k in rng.integers(len(pool), size=3))
        if rng.random() < 0.2:
            b = y = float(rng.choice([0.0, 1.0, -1.0, 2.0, -0.3]))
        if rng.random() < 0.3:
            a, x = -a, -x
        kind = rng.integers(5)
        if kind == 0:
            pool.append((a + b, x + y))
        elif kind == 1:
            pool.append((b - a, y - x))
        elif kind == 2:
            pool.append((a * b, x * y))
        elif kind == 3 and isinstance(a, Number) and isinstance(b, Number) and y != 0.0:
            pool.append((a / b, x / y))
        elif isinstance(a, Number):
            pool.append((scalars.select(a, b, c), y if x > 0.0 else z))
    results, wanted = zip(*pool[5:], strict=True)
    for fuse in (True, False):
        np.testing.assert_array_equal(Program(tape, results, 5, fuse).run(values), wanted)

"""Inputs that all samples share: read as constants are, tables of them by one index, to the bits of any input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from test_simd import WIDTHS, Runner, Shape

from spatialdyn.algebra.scalars import select
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.llvm import lookups, schedule, simd
from spatialdyn.engines.programs.record import structure
from spatialdyn.engines.programs.record.kernel_layout import KernelLayout
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Tape

pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: no programs")
SEGMENTS, VALUES = 5, 3
WIDTHS_OF_INPUTS = 1, SEGMENTS, SEGMENTS * VALUES


def table() -> Program:
    """Of the segment of t: its begin, and three values, and those times the time since."""
    tape = Tape()
    t, *rest = (tape.input(k) for k in range(sum(WIDTHS_OF_INPUTS)))
    times, values = rest[:SEGMENTS], rest[SEGMENTS:]

    def chosen(columns: list[Any]) -> Any:
        found = columns[0]
        for k in range(1, SEGMENTS):
            found = select(t - times[k], columns[k], found)
        return found

    begun = chosen(times)
    found = [chosen(values[m::VALUES]) for m in range(VALUES)]
    return Program(tape, [begun, *found, *(x * (t - begun) + values[0] for x in found)], sum(WIDTHS_OF_INPUTS))


def layout(common: tuple[int, ...]) -> KernelLayout:
    return KernelLayout(WIDTHS_OF_INPUTS, (tuple(range(1 + 2 * VALUES)),), common=common)


def numbers() -> tuple[np.ndarray, np.ndarray]:
    draw = np.random.default_rng(0)
    return np.arange(float(SEGMENTS)), draw.normal(size=SEGMENTS * VALUES)


def test_chains_of_selections_are_found_as_one_table() -> None:
    program = table()
    common = simd._common(program, layout((1, 2)))
    assert len(common) == SEGMENTS + SEGMENTS * VALUES
    found = lookups.find(program, common)
    ((conditions, chains),) = found.tables.items()
    assert len(conditions) == SEGMENTS - 1
    assert sorted((x.array, x.column, x.stride) for x in chains) == [(1, 0, 1), *((2, m, VALUES) for m in range(3))]
    assert not lookups.find(program, simd._common(program, layout((2,)))).tables.keys() - {conditions}
    assert not lookups.find(program, {}).tables


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("lanes", WIDTHS)
def test_common_inputs_give_the_same_bits(monkeypatch: pytest.MonkeyPatch, lanes: int, whole: bool) -> None:
    if not whole:
        monkeypatch.setattr(schedule, "MOST_WHOLE", 0)
        monkeypatch.setattr(schedule, "CHUNK_LENGTH", 7)
    program, shape = table(), Shape(lanes, False)
    alike = np.repeat([-1.0, 2.5, 9.0], lanes)  # one segment to a tile
    t = np.concatenate([alike, np.random.default_rng(1).uniform(-1.0, 6.0, 3 * lanes), np.arange(1.0, 1.0 + lanes)])
    t[4 * lanes - 1] = np.nan
    given = (t[:, None], *numbers())
    (wanted,), valid = Runner(program, layout(()), shape)(*given, steps=[1, 0, 0])
    (found,), also = Runner(program, layout((1, 2)), shape)(*given, steps=[1, 0, 0])
    np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(also, valid)
    assert (~valid).sum() == 1
    k = np.clip(np.searchsorted(numbers()[0], t, "left") - 1, 0, SEGMENTS - 1)
    by_hand = numbers()[1].reshape(SEGMENTS, VALUES)[k]
    np.testing.assert_array_equal(found[valid, 1 : 1 + VALUES], by_hand[valid])


def test_float32_looks_up_its_own_numbers() -> None:
    shape, t = Shape(4, False), np.array([0.5, 0.5, 0.5, 0.5, 0.5, 3.5, 1.5, 2.5])
    given = (t[:, None], *numbers())
    (wanted,), _ = Runner(table(), layout(()), shape, np.float32)(*given, steps=[1, 0, 0])
    (found,), valid = Runner(table(), layout((1, 2)), shape, np.float32)(*given, steps=[1, 0, 0])
    np.testing.assert_array_equal(found, wanted)
    assert valid.all()


def test_common_inputs_are_part_of_the_structure() -> None:
    assert structure.digest(table(), layout(())) != structure.digest(table(), layout((1,)))

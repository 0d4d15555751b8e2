"""The table of operations: every row has every column, the columns agree, and a new operation is one row."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.numbers import double_double
from spatialdyn.engines.programs.record.kernel_layout import KernelLayout
from spatialdyn.engines.programs.record.operations import (
    AGAIN,
    CONST,
    FMA,
    FMS,
    FNMA,
    FORMS,
    INPUT,
    MUL,
    REGIONS,
    UFP,
    Form,
    Operation,
    name_of,
    operands,
    signed,
)  # fmt: skip
from spatialdyn.engines.programs.record.program import Program
from spatialdyn.engines.programs.record.tracer import Tape
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.engines.programs.transform.source_code import c_code, python_code
from spatialdyn.engines.programs.transform.to_double_double import to_double_double
from spatialdyn.errors import SpatialDynError

CODES = list(FORMS)
ULPS = 4.0  # of sin, cos and atan2 of lanes against NumPy's; the others are equal, except for fused products
MADE_UP = 99
RELU = Form(
    "relu", 1, ("max",), lambda a: np.maximum(a, 0.0), "fmax({a}, 0.0)", "maximum({a}, 0.0)",
    lambda t, a: t.select(t.above_zero(a), a, t.constant(0.0)), lambda d, a: d.multiply(a.factor, a.factor),
    registers="choose({a}, {a}, 0.0, 0.0)", imports="maximum",
)  # fmt: skip


def one(code: int) -> Program:
    """The program of one operation, an input for each operand."""
    tape = Tape()
    count = FORMS[code].arity
    lines = [tape.input(k).line for k in range(count)]
    result = tape.number(0.0)
    result.line = tape.line(Operation(code, *lines))
    return Program(tape, [result], count, fuse=False)


def on_lanes(program: Program, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inputs (n, columns) through the compiled program."""
    layout = KernelLayout((x.shape[1],), ((0,),))
    out = np.empty((len(x), 1))
    again = batch_kernels.compiled(program, layout)([x], [out])
    assert again is not None
    assert not len(again)
    return out[:, 0]


def on_registers(program: Program, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inputs (LANES, columns) through the interpreter of double-double, in plain Python."""
    made, lanes = double_double.allocate_registers(program), double_double.LANES
    registers = np.zeros((made.rows, 2 * lanes))
    registers[: made.inputs, :lanes] = x.T
    double_double.interpreter.__wrapped__()(made.code, made.value, registers)
    (at,) = made.outputs
    return registers[at, :lanes]


def by_text(program: Program, count: int, x: NDArray[np.float64]) -> NDArray[np.float64]:
    scope: dict[str, object] = {}
    exec(python_code("f", program, {"x": (count,)}, {"y": ()}), scope)
    return scope["f"](x)  # type: ignore[operator, no-any-return]


@pytest.fixture
def relu(monkeypatch: pytest.MonkeyPatch) -> Iterator[Program]:
    """A program of an operation that is defined by a row of FORMS alone."""
    monkeypatch.setitem(FORMS, MADE_UP, RELU)
    return one(MADE_UP)


def samples(count: int) -> NDArray[np.float64]:
    return np.random.default_rng(count).normal(size=(64, count))


def test_every_code_has_a_row() -> None:
    assert sorted([INPUT, CONST, *FORMS]) == list(range(UFP + 1))
    assert sorted(REGIONS) == list(range(UFP + 1, AGAIN + 1))
    assert len({name_of(code) for code in (INPUT, CONST, *FORMS, *REGIONS)}) == AGAIN + 1


@pytest.mark.parametrize("code", CODES, ids=name_of)
def test_every_row_has_every_column(code: int) -> None:
    form = FORMS[code]
    letters = ["a", "b", "c"][: form.arity]
    for text in (form.c, form.python, *([form.registers] if form.registers else [])):
        assert sorted(set(re.findall(r"{(.)}", text))) == letters
    assert form.counts
    assert callable(form.numpy)
    assert callable(form.llvm)
    assert form.double_double is None or callable(form.double_double)
    op = Operation(code, 7, -3, 5)
    assert signed(op) == (7, -3, 5)[: form.arity]
    assert list(operands(op)) == [7, 2, 5][: form.arity]
    assert form.name in one(code).listing()
    assert c_code("f", one(code), {"x": (form.arity,)}, {"y": ()}).count("=") == 2


@pytest.mark.parametrize("code", CODES, ids=name_of)
def test_text_and_lanes_compute_what_numpy_does(code: int) -> None:
    program, x = one(code), samples(FORMS[code].arity)
    if name_of(code) == "sqrt":
        x = abs(x)
    wanted = program.run(list(x.T))[0]
    np.testing.assert_array_equal(by_text(program, x.shape[1], x), wanted)
    if not numba_kernels.PLAIN:
        scale = np.maximum(abs(wanted), abs(x[:, 0]) if code in (FMA, FMS, FNMA) else 0.0)
        assert (abs(on_lanes(program, x) - wanted) <= ULPS * np.spacing(np.maximum(scale, 0.5))).all()


@pytest.mark.parametrize("code", CODES, ids=name_of)
def test_double_double_computes_what_numpy_does_or_refuses_by_name(code: int) -> None:
    program, x = one(code), samples(FORMS[code].arity)
    if FORMS[code].double_double is None:
        with pytest.raises(SpatialDynError, match=f"operation {re.escape(name_of(code))} has no double-double form"):
            to_double_double(program, False)
    else:
        wanted = program.run(list(x.T))[0]
        found = to_double_double(program, False).run(list(x.T))[0]
        assert (abs(found - wanted) <= ULPS * np.spacing(abs(wanted))).all()


@pytest.mark.parametrize("code", [code for code in CODES if FORMS[code].registers], ids=name_of)
def test_registers_compute_what_numpy_does(code: int) -> None:
    x = samples(FORMS[code].arity) ** 2
    np.testing.assert_allclose(on_registers(one(code), x), one(code).run(list(x.T))[0], rtol=ULPS * 2.0**-53, atol=0.0)


def test_what_is_exact_computes_with_fractions() -> None:
    from fractions import Fraction

    third = Fraction(1, 3)
    for form in FORMS.values():
        if form.exact:
            assert isinstance(form.numpy(*[third] * form.arity), Fraction)
    assert FORMS[MUL].numpy(third, third) == Fraction(1, 9)


def test_a_made_up_operation_is_one_row(relu: Program) -> None:
    x = samples(1)
    wanted = np.maximum(x[:, 0], 0.0)
    np.testing.assert_array_equal(relu.run([x[:, 0]])[0], wanted)
    np.testing.assert_array_equal(by_text(relu, 1, x), wanted)
    np.testing.assert_array_equal(on_lanes(relu, x), wanted)
    np.testing.assert_array_equal(to_double_double(relu, False).run([x[:, 0]])[0], x[:, 0] ** 2)  # its row
    np.testing.assert_array_equal(on_registers(relu, x), wanted)
    assert "x1 = relu(x0)" in relu.listing()
    assert relu.operations["max"] == 1
    assert "fmax(x[0], 0.0)" in c_code("f", relu, {"x": (1,)}, {"y": ()})

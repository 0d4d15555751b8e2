"""The tracer: a recursion run once on numbers that write down what is done to them.

What comes out is a Program: the operations of one model as a straight line, its zeros and constants folded away,
equal operations shared, signs moved out of the way, dead ones dropped. The recursion is not changed and not
copied; it is called, on rows whose fields are floats and on inputs that are ``Number``. A recursion that branched
on a value would lose a branch here, so comparing a Number raises.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...algebra import scalars
from ...recursions.spec import Spec

INPUT, CONST, ADD, SUB, MUL, DIV, FMA, FMS, FNMA, SQRT, SIN, COS, ATAN2, SELECT = range(14)
NAMES = ("input", "const", "+", "-", "*", "/", "fma", "fms", "fnma", "sqrt", "sin", "cos", "atan2", "select")
COUNTED = {ADD: "add", SUB: "add", MUL: "mul", DIV: "div", SQRT: "sqrt", SIN: "sincos", COS: "sincos", ATAN2: "atan2"}


class Operation(NamedTuple):
    """One line of a program: a code and up to three operands, each a line or, negative, that line's -value - 1."""

    code: int
    a: int = 0
    b: int = 0
    c: int = 0
    value: float = 0.0


class Tape:
    """Where Numbers write: lines in order, each once."""

    def __init__(self) -> None:
        """An empty tape."""
        self.lines: list[Operation] = []
        self._known: dict[Operation, int] = {}

    def line(self, operation: Operation) -> int:
        """The line of an operation, written if it is new."""
        at = self._known.get(operation)
        if at is None:
            at = self._known[operation] = len(self.lines)
            self.lines.append(operation)
        return at

    def input(self, index: int) -> Number:
        """The number that stands for input ``index``."""
        return Number(self, self.line(Operation(INPUT, index)), False)

    def number(self, value: Any) -> Number:
        """A Number of a constant, its sign apart."""
        if isinstance(value, Number):
            return value
        x = float(value)
        return Number(self, self.line(Operation(CONST, value=abs(x))), bool(np.signbit(x)))

    def unfolded(self, value: float) -> Any:
        """A Number of a constant but 0 and ±1, so that none meets another in float64."""
        return value if value in (0.0, 1.0, -1.0) else self.number(value)


class Number:
    """A value to be computed: a line of the tape, and whether it is negated.

    + - * / write lines; 0 and ±1 are absorbed, x - x is 0, x · (1/x) is 1 (which is what zeroes the joint's own
    row of an articulated inertia), and a sign costs nothing.
    """

    __slots__ = ("line", "minus", "tape")
    __array_ufunc__ = None  # NumPy's scalars leave the arithmetic to us

    def __init__(self, tape: Tape, line: int, minus: bool) -> None:
        """A line of a tape, negated or not."""
        self.tape, self.line, self.minus = tape, line, minus

    def __neg__(self) -> Number:
        return Number(self.tape, self.line, not self.minus)

    def __add__(self, other: Any) -> Any:
        if not isinstance(other, Number):
            if other == 0.0:
                return self
            other = self.tape.number(other)
        if self.line == other.line and self.minus != other.minus:
            return 0.0
        a, b = (self, other) if self.line <= other.line else (other, self)
        if a.minus == b.minus:
            return Number(self.tape, self.tape.line(Operation(ADD, a.line, b.line)), a.minus)
        # a - b or b - a: one line for both, its sign outside
        return Number(self.tape, self.tape.line(Operation(SUB, a.line, b.line)), a.minus)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self + (-other)

    def __rsub__(self, other: Any) -> Any:
        return (-self) + other

    def __mul__(self, other: Any) -> Any:
        if not isinstance(other, Number):
            if other == 0.0:
                return 0.0
            if other in (1.0, -1.0):
                return self if other == 1.0 else -self
            other = self.tape.number(other)
        a, b = (self, other) if self.line <= other.line else (other, self)
        minus = a.minus != b.minus
        lines = self.tape.lines
        for x, y in ((a, b), (b, a)):
            inverse = lines[y.line]
            if inverse.code == DIV and inverse.b == x.line and lines[inverse.a] == ONE:
                return -1.0 if minus else 1.0
        return Number(self.tape, self.tape.line(Operation(MUL, a.line, b.line)), minus)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if not isinstance(other, Number):
            return self * (1.0 / other)
        if self.line == other.line:
            return -1.0 if self.minus != other.minus else 1.0
        made = self.tape.line(Operation(DIV, self.line, other.line))
        return Number(self.tape, made, self.minus != other.minus)

    def __rtruediv__(self, other: Any) -> Any:
        return 0.0 if other == 0.0 else self.tape.number(other) / self

    def _refuse(self, other: Any = None) -> bool:
        raise TypeError("a recorded value has no truth and no order; a recursion chooses with scalars.select")

    __bool__ = __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _refuse
    __hash__ = None  # type: ignore[assignment]

    def __float__(self) -> float:
        raise TypeError("a recorded value is no float; a recursion uses the functions of scalars")


ONE = Operation(CONST, value=1.0)


def _function(code: int, odd: bool) -> Callable[[Number], Number]:
    """One of sin, cos, sqrt on a Number; the sign of an odd function's argument goes outside, an even one's is lost."""

    def record(x: Number) -> Number:
        return Number(x.tape, x.tape.line(Operation(code, x.line)), x.minus and odd)

    return record


def _sqrt(x: Number) -> Number:
    return Number(x.tape, x.tape.line(Operation(SQRT, _operand(x))), False)


def _operand(x: Number) -> int:
    """A line, or -line - 1 for its negative."""
    return -x.line - 1 if x.minus else x.line


def _atan2(y: Any, x: Any) -> Number:
    tape = y.tape if isinstance(y, Number) else x.tape
    y, x = tape.number(y), tape.number(x)
    return Number(tape, tape.line(Operation(ATAN2, _operand(y), _operand(x))), False)


def _select(x: Number, positive: Any, otherwise: Any) -> Any:
    tape = x.tape
    p, o = tape.number(positive), tape.number(otherwise)
    return Number(tape, tape.line(Operation(SELECT, _operand(x), _operand(p), _operand(o))), False)


scalars.sin.register(Number)(_function(SIN, odd=True))
scalars.cos.register(Number)(_function(COS, odd=False))
scalars.sqrt.register(Number)(_sqrt)
scalars.atan2.register(Number)(_atan2)
scalars.select.register(Number)(_select)


# --- tables of plain objects --------------------------------------------------------------------------------


class Row:
    """A row of a table, or a field of it that has fields: plain attributes, which a recursion reads and writes."""

    def __init__(self, dtype: np.dtype, values: Any = None, number: Callable[[float], Any] = float) -> None:
        """A row of that layout, from a record or all zero; ``number`` makes of a float what stands for it."""
        for name in dtype.names or ():
            part = dtype[name]
            value = None if values is None else values[name]
            if part.names:
                self.__dict__[name] = Row(part, value, number)
            elif part.subdtype:
                self.__dict__[name] = np.zeros(part.shape, object)
            elif part.kind == "i":
                self.__dict__[name] = 0 if value is None else value.item()
            else:
                self.__dict__[name] = 0.0 if value is None else number(value.item())


def table(records: NDArray[Any], number: Callable[[float], Any] = float) -> list[Row]:
    """A structured array as rows of Python's own numbers, or of what ``number`` makes of its floats."""
    return [Row(records.dtype, record, number) for record in records]


def scratch(dtype: np.dtype | None, rows: int) -> list[Row] | None:
    """An empty table."""
    return None if dtype is None else [Row(dtype) for _ in range(rows)]


def evaluate(
    spec: Spec, rows: Sequence[Any], shape: tuple[int, ...], inputs: Mapping[str, Any], pivots: NDArray[Any] | None
) -> NDArray[Any]:
    """The output of a recursion on a table of objects and arrays of numbers by name; an optional input may be missing.

    shape   of the output; a number comes as an array of one
    pivots  (rows,) of objects, written if the recursion has them
    """
    out = np.full(shape or (1,), 0.0, dtype=object)
    passed: list[Any] = [] if spec.work is None else [scratch(spec.work, len(rows))]
    passed += [None if x is None else inputs.get(x.name) if x.optional else inputs[x.name] for x in spec.inputs]
    beside: list[Any] = [np.empty(size, dtype=object) for size in spec.beside(len(rows) - 1)]
    if spec.pivots:
        beside[0] = pivots
    spec.recursion(rows, *passed, out, *beside)
    return out


# --- programs -----------------------------------------------------------------------------------------------


class Program:
    """The straight line of one traced run.

    lines    operations in order; operands are lines, or -line - 1 for a negated one where a code says so
    outputs  for each number that was asked for, its line and sign
    inputs   how many inputs there are
    """

    def __init__(self, tape: Tape, outputs: Sequence[Any], inputs: int, fuse: bool = True) -> None:
        """What of a tape the outputs need."""
        marked = [tape.number(x) for x in outputs]
        lines, roots = _alive(tape.lines, [x.line for x in marked])
        if fuse:
            lines, roots = _alive(_fused(lines, roots), roots)
        self.lines: list[Operation] = lines
        self.outputs: list[tuple[int, bool]] = [(r, x.minus) for r, x in zip(roots, marked, strict=True)]
        self.inputs = inputs

    def only(self, outputs: Iterable[int]) -> Program:
        """The program of some of its outputs, by their places."""
        chosen = [self.outputs[k] for k in outputs]
        made = copy(self)
        made.lines, roots = _alive(self.lines, [line for line, _ in chosen])
        made.outputs = [(line, minus) for line, (_, minus) in zip(roots, chosen, strict=True)]
        return made

    @property
    def operations(self) -> dict[str, int]:
        """Counts of mul, add, div, sqrt and sincos (a fused multiply-add is one of each, a sign is free), and depth."""
        count = dict.fromkeys(("mul", "add", "div", "sqrt", "sincos", "atan2", "select"), 0)
        depth: list[int] = []
        angles = set()
        for op in self.lines:
            depth.append(max((depth[k] for k in operands(op)), default=-1) + 1)
            if op.code in (FMA, FMS, FNMA):
                count["mul"] += 1
                count["add"] += 1
            elif op.code in (SIN, COS):
                angles.add(op.a)
            elif op.code == SELECT:
                count["select"] += 1
            elif op.code in COUNTED:
                count[COUNTED[op.code]] += 1
        count["sincos"] = len(angles)
        return {**count, "depth": max(depth, default=0)}

    def listing(self) -> str:
        """The program, a line each."""
        text = []
        for k, op in enumerate(self.lines):
            if op.code == INPUT:
                what = f"input[{op.a}]"
            elif op.code == CONST:
                what = repr(op.value)
            elif op.code in (ADD, SUB, MUL, DIV):
                what = f"x{op.a} {NAMES[op.code]} x{op.b}"
            else:
                what = f"{NAMES[op.code]}({', '.join(f'x{i}' if i >= 0 else f'-x{-i - 1}' for i in signed(op))})"
            text.append(f"x{k} = {what}")
        text += [f"output[{k}] = {'-' if minus else ''}x{line}" for k, (line, minus) in enumerate(self.outputs)]
        return "\n".join(text)

    def run(self, inputs: Sequence[Any] | NDArray[Any]) -> list[Any]:
        """The program on NumPy arrays (or floats), one per input: its own oracle; one result per output."""
        x: list[Any] = []

        def at(k: int) -> Any:
            return x[k] if k >= 0 else -x[-k - 1]

        rules: dict[int, Callable[[Operation], Any]] = {
            INPUT: lambda op: inputs[op.a],
            CONST: lambda op: op.value,
            ADD: lambda op: x[op.a] + x[op.b],
            SUB: lambda op: x[op.a] - x[op.b],
            MUL: lambda op: x[op.a] * x[op.b],
            DIV: lambda op: np.divide(x[op.a], x[op.b]),
            FMA: lambda op: x[op.a] * x[op.b] + x[op.c],
            FMS: lambda op: x[op.a] * x[op.b] - x[op.c],
            FNMA: lambda op: x[op.c] - x[op.a] * x[op.b],
            SQRT: lambda op: np.sqrt(at(op.a)),
            SIN: lambda op: np.sin(x[op.a]),
            COS: lambda op: np.cos(x[op.a]),
            ATAN2: lambda op: np.arctan2(at(op.a), at(op.b)),
            SELECT: lambda op: np.where(at(op.a) > 0.0, at(op.b), at(op.c)),
        }
        with np.errstate(all="ignore"):
            for op in self.lines:
                x.append(rules[op.code](op))
            return [-x[k] if minus else x[k] for k, minus in self.outputs]


def signed(op: Operation) -> tuple[int, ...]:
    """The operands of a line, as written."""
    if op.code in (INPUT, CONST):
        return ()
    if op.code in (SQRT, SIN, COS):
        return (op.a,)
    if op.code in (FMA, FMS, FNMA, SELECT):
        return (op.a, op.b, op.c)
    return (op.a, op.b)


def operands(op: Operation) -> Iterator[int]:
    """The lines that a line reads."""
    return (k if k >= 0 else -k - 1 for k in signed(op))


def _alive(lines: Sequence[Operation], roots: Iterable[int]) -> tuple[list[Operation], list[int]]:
    """The lines that the roots need, numbered anew in the same order."""
    roots = list(roots)
    needed = set()
    stack = list(roots)
    while stack:
        k = stack.pop()
        if k not in needed:
            needed.add(k)
            stack.extend(operands(lines[k]))
    number = {k: i for i, k in enumerate(sorted(needed))}

    def moved(k: int) -> int:
        return number[k] if k >= 0 else -number[-k - 1] - 1

    kept = []
    for k in sorted(needed):
        op, n = lines[k], len(signed(lines[k]))
        parts = [moved(x) for x in (op.a, op.b, op.c)[:n]]
        kept.append(op._replace(**dict(zip("abc", parts, strict=False))))
    return kept, [number[k] for k in roots]


def _fused(lines: Sequence[Operation], roots: Sequence[int]) -> list[Operation]:
    """Products that only one sum reads, made part of it: decided here, so every machine rounds the same way."""
    uses = [0] * len(lines)
    for op in lines:
        for k in operands(op):
            uses[k] += 1
    for k in roots:
        uses[k] += 1
    made = list(lines)
    for k, op in enumerate(lines):
        if op.code not in (ADD, SUB):
            continue
        # the later product: the earlier one is ready by then, so the sum waits less
        for product, other, first in sorted(((op.a, op.b, True), (op.b, op.a, False)), reverse=True):
            p = made[product]
            if p.code == MUL and uses[product] == 1 and product != other:
                code = FMA if op.code == ADD else FMS if first else FNMA
                made[k] = Operation(code, p.a, p.b, other)
                break
    return made

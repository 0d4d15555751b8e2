"""The tracer: runs a recursion once on numbers that record their operations.

The tape then holds the operations of one model, with constants folded, equal operations shared and signs moved out; a
``program.Program`` is made from it. The recursion is neither changed nor copied: it is called on rows whose fields are
floats and on inputs that are ``Number``. A branch on a value cannot be recorded, so comparing a Number raises.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....algebra import heights, regions, scalars
from ....algebra.regions import Carried
from ....errors import SpatialDynError
from ....recursions.spec import Spec
from ...polynomials import MAX_ANGLE
from .constants import error_of
from .operations import (
    ABS,
    ADD,
    AGAIN,
    ATAN2,
    CARRIED,
    CONST,
    COS,
    DIV,
    EXP,
    INPUT,
    MUL,
    NEXT,
    REPEAT,
    SELECT,
    SIN,
    SQRT,
    SUB,
)

MOST_UNROLLED = 16  # passes of a region, and of those within it, that are recorded in a straight line
Line = tuple[int, int, int, int, float]  # an Operation as a tuple; a Program keeps a third of the recorded ones


class Tape:
    """The recorded operations, each once, as lines in order.

    lines     operations
    known     line -> its index
    inverses  index of 1 / x -> index of x
    errors    by how much inexact constants may be off; the line of such a constant has its index in ``c``. None if
              errors are not recorded; if they are, only an exact 0 or ±1 is absorbed
    inside    for each region being recorded, the outermost first, a value that is above 0 while a sample runs it
    looped    whether there are regions
    unrolled  passes of the regions around, if they are recorded in a straight line
    """

    def __init__(self, errors: bool = False) -> None:
        """An empty tape."""
        self.lines: list[Line] = []
        self.known: dict[Line, int] = {}
        self.inverses: dict[int, int] = {}
        self.errors: dict[float, int] | None = {0.0: 0} if errors else None
        self.inside: list[Number] = []
        self.looped = False
        self.unrolled = 1

    def line(self, operation: Line) -> int:
        """The index of an operation; a new operation is appended."""
        at = self.known.get(operation)
        return self.new(operation) if at is None else at

    def new(self, operation: Line) -> int:
        """The index of an operation that is not yet recorded."""
        at = self.known[operation] = len(self.lines)
        self.lines.append(operation)
        return at

    def append(self, operation: Line) -> int:
        """The index of an operation that is never shared."""
        self.lines.append(operation)
        return len(self.lines) - 1

    def repeat(self, cap: int, x: Any, carried: Carried) -> Iterator[None]:
        """A region of ``algebra.regions``; its body runs once, on carried values that are new Numbers.

        The region also carries how often it may still run, and a number that is above 0 while a sample runs.
        """
        if not isinstance(x, Number) and not x > 0.0:
            return
        before = carried.get()
        fresh = [self._carry(value) for value in before]
        running = self._carry(_select(self.inside[-1], x, 0.0) if self.inside else x)
        rest = self._carry(float(cap)) if cap > 1 else None
        head = self.append((REPEAT, running.line, 0, 0, 0.0))
        self.looped = True
        self.inside.append(running)
        carried.put(fresh)
        yield
        self.inside.pop()
        after = [self.number(value) for value in carried.get()]
        changes = [(x, y) for x, y in zip(fresh, after, strict=True) if (x.line, x.minus) != (y.line, y.minus)]
        if rest is None:
            changes.append((running, self.number(0.0)))
        else:
            fewer = rest - 1.0
            changes += [(rest, fewer), (running, _select(fewer, carried.left[0], 0.0))]
        chosen = [(x.line, _select(running, y, x).line) for x, y in changes]
        for to, line in chosen:
            self.append((NEXT, to, line, 0, 0.0))
        self.append((AGAIN, head, 0, 0, 0.0))
        for line in self.lines[head:]:  # these lines are not computed if the region does not run
            if line[0] not in (INPUT, CONST):
                self.known.pop(line, None)
        changed = {to for to, _ in chosen}
        carried.put(y if y.line in changed else x for x, y in zip(before, fresh, strict=True))

    def unroll(self, cap: int, x: Any, carried: Carried) -> Iterator[None]:
        """A region as ``repeat``, of few passes in a straight line: for transforms that take no other programs."""
        if cap * self.unrolled > MOST_UNROLLED:
            yield from self.repeat(cap, x, carried)
            return
        self.unrolled *= cap
        for _ in range(cap):
            if not isinstance(x, Number) and not x > 0.0:
                break
            before = carried.get()
            self.inside.append(self.number(x))
            yield
            self.inside.pop()
            after = carried.get()
            carried.put(
                scalars.select(x, y, old) if y is not old else old for old, y in zip(before, after, strict=True)
            )
            x = x if carried.left is None else carried.left[0]
        self.unrolled //= cap

    def _carry(self, value: Any) -> Number:
        """A carried value, at first ``value``."""
        return Number(self, self.append((CARRIED, _operand(self.number(value)), 0, 0, 0.0)), False)

    def input(self, index: int) -> Number:
        """The Number of input ``index``."""
        return Number(self, self.line((INPUT, index, 0, 0, 0.0)), False)

    def number(self, value: Any) -> Number:
        """A Number of a constant. The sign is in the value, unless the constant of the other sign is recorded.

        So models with other numbers have the same structure, and x - k y is -k y + x.
        """
        if isinstance(value, Number):
            return value
        x, at = float(value), 0
        if self.errors is not None and error_of(value):
            at = self.errors.setdefault(error_of(value), len(self.errors))
        elif x in (0.0, 1.0, -1.0):  # most operations absorb these numbers with their signs
            return Number(self, self.line((CONST, 0, 0, 0, abs(x))), bool(np.signbit(x)))
        opposite = self.known.get((CONST, 0, 0, at, -x))
        if opposite is not None:
            return Number(self, opposite, True)
        return Number(self, self.line((CONST, 0, 0, at, x)), False)

    def absorbs(self, value: float) -> bool:
        """Whether operations absorb a 0 or ±1."""
        return self.errors is None or not error_of(value)

    def unfolded(self, value: float) -> Any:
        """A Number of a constant, so that it is not folded in float64; 0 and ±1 stay floats."""
        return value if value in (0.0, 1.0, -1.0) else self.number(value)


class Number:
    """A recorded value: a line of the tape, and whether it is negated.

    + - * / append lines. 0 and ±1 are absorbed, x - x is 0, x · (1/x) is 1 (so the joint's own row of an articulated
    inertia becomes zero), and a sign costs nothing.
    """

    __slots__ = ("line", "minus", "tape")
    __array_ufunc__ = None  # NumPy's scalars then call our operators

    def __init__(self, tape: Tape, line: int, minus: bool) -> None:
        """A line of a tape, negated or not."""
        self.tape, self.line, self.minus = tape, line, minus

    def __neg__(self) -> Number:
        return Number(self.tape, self.line, not self.minus)

    def __abs__(self) -> Number:
        return Number(self.tape, self.tape.line((ABS, self.line, 0, 0, 0.0)), False)

    def __add__(self, other: Any) -> Any:
        if not isinstance(other, Number):
            if other == 0.0 and self.tape.absorbs(other):
                return self
            other = self.tape.number(other)
        tape, a, b, minus = self.tape, self.line, other.line, self.minus
        code = ADD
        if minus != other.minus:  # a - b and b - a share a line; the sign is in ``minus``
            if a == b:
                return 0.0
            code = SUB
        key = (code, a, b, 0, 0.0)
        if a > b:
            key, minus = (code, b, a, 0, 0.0), other.minus
        at = tape.known.get(key)
        return Number(tape, tape.new(key) if at is None else at, minus)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Any:
        return self + (-other)

    def __rsub__(self, other: Any) -> Any:
        return (-self) + other

    def __mul__(self, other: Any) -> Any:
        if not isinstance(other, Number):
            if other in (0.0, 1.0, -1.0) and self.tape.absorbs(other):
                return 0.0 if other == 0.0 else self if other == 1.0 else -self
            other = self.tape.number(other)
        tape, a, b, minus = self.tape, self.line, other.line, self.minus != other.minus
        inverses = tape.inverses
        if inverses and (inverses.get(a) == b or inverses.get(b) == a):
            return -1.0 if minus else 1.0
        key = (MUL, a, b, 0, 0.0) if a <= b else (MUL, b, a, 0, 0.0)
        at = tape.known.get(key)
        return Number(tape, tape.new(key) if at is None else at, minus)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        if not isinstance(other, Number):
            return self * (1.0 / other)
        if self.line == other.line:
            return -1.0 if self.minus != other.minus else 1.0
        made = self.tape.line((DIV, self.line, other.line, 0, 0.0))
        if self.tape.lines[self.line] == ONE:
            self.tape.inverses[made] = other.line
        return Number(self.tape, made, self.minus != other.minus)

    def __rtruediv__(self, other: Any) -> Any:
        return 0.0 if other == 0.0 and self.tape.absorbs(other) else self.tape.number(other) / self

    def _refuse(self, other: Any = None) -> bool:
        raise TypeError("a recorded value has no truth and no order; a recursion chooses with scalars.select")

    __bool__ = __lt__ = __le__ = __gt__ = __ge__ = __eq__ = __ne__ = _refuse
    __hash__ = None  # type: ignore[assignment]

    def __float__(self) -> float:
        raise TypeError("a recorded value is no float; a recursion uses the functions of scalars")


ONE = (CONST, 0, 0, 0, 1.0)


def _function(code: int, odd: bool) -> Callable[[Number], Number]:
    """sin or cos of a Number: an odd function takes the sign of its argument, an even one drops it."""

    def record(x: Number) -> Number:
        tape, at = x.tape, x.line
        if tape.inside and (code, at, 0, 0, 0.0) not in tape.known:  # not checked: the sample may have finished
            angle = Number(tape, at, False)
            at = _select(MAX_ANGLE * MAX_ANGLE - angle * angle, angle, math.nan).line
        return Number(tape, tape.line((code, at, 0, 0, 0.0)), x.minus and odd)

    return record


def _sqrt(x: Number) -> Number:
    return Number(x.tape, x.tape.line((SQRT, _operand(x), 0, 0, 0.0)), False)


def _exp(x: Number) -> Number:
    return Number(x.tape, x.tape.line((EXP, _operand(x), 0, 0, 0.0)), False)


def _operand(x: Number) -> int:
    """An operand: a line, or -line - 1 for its negative."""
    return -x.line - 1 if x.minus else x.line


def _atan2(y: Any, x: Any) -> Number:
    tape = y.tape if isinstance(y, Number) else x.tape
    y, x = tape.number(y), tape.number(x)
    return Number(tape, tape.line((ATAN2, _operand(y), _operand(x), 0, 0.0)), False)


def _settled(x: Number) -> bool:
    if not x.tape.inside:
        raise SpatialDynError("a recursion has repeat or when, expected one without, of which this can be recorded")
    return False


def _select(x: Number, positive: Any, otherwise: Any) -> Any:
    tape = x.tape
    p, o = tape.number(positive), tape.number(otherwise)
    return Number(tape, tape.line((SELECT, _operand(x), _operand(p), _operand(o), 0.0)), False)


scalars.sin.register(Number)(_function(SIN, odd=True))
scalars.cos.register(Number)(_function(COS, odd=False))
scalars.sqrt.register(Number)(_sqrt)
scalars.exp.register(Number)(_exp)
scalars.atan2.register(Number)(_atan2)
scalars.select.register(Number)(_select)
regions.settled.register(Number)(_settled)
heights.bilinear.register(Number)(heights.by_weights)


# --- tables of plain objects --------------------------------------------------------------------------------


class Row:
    """A row of a table, or a structured field of a row: plain attributes, which a recursion reads and writes."""


@cache
def _fields(dtype: np.dtype) -> tuple[tuple[str, Any], ...]:
    """(name, kind) of each field; a kind is a struct's fields, an array's shape, 0 for an integer, 0.0 for a float."""
    found: list[tuple[str, Any]] = []
    for name in dtype.names or ():
        part = dtype[name]
        what: Any = _fields(part) if part.names else part.shape if part.subdtype else 0 if part.kind == "i" else 0.0
        found.append((name, what))
    return tuple(found)


def _row(fields: tuple[tuple[str, Any], ...], values: Sequence[Any] | None, number: Callable[[float], Any]) -> Row:
    """A Row with these fields, and a record's values or zeros."""
    row = Row()
    held = row.__dict__
    for k, (name, what) in enumerate(fields):
        if type(what) is float:
            held[name] = 0.0 if values is None else number(values[k])
        elif type(what) is int:
            held[name] = 0 if values is None else values[k]
        elif what and type(what[0]) is tuple:
            held[name] = _row(what, None if values is None else values[k], number)
        else:
            held[name] = np.zeros(what, object)
    return row


def table(records: NDArray[Any], number: Callable[[float], Any] = float) -> list[Row]:
    """A structured array as Rows; ``number`` converts its floats."""
    fields = _fields(records.dtype)
    return [_row(fields, record, number) for record in records.tolist()]


def scratch(dtype: np.dtype | None, rows: Sequence[Any]) -> list[Row] | None:
    """Scratch of a recursion: a table of zeros; None if the recursion needs none.

    rows  of the table of bodies; if they have a ``tree``, all its rows have scratch
    """
    return None if dtype is None else [_row(_fields(dtype), None, float) for _ in getattr(rows, "tree", rows)]


def evaluate(
    spec: Spec, rows: Sequence[Any], shape: tuple[int, ...], inputs: Mapping[str, Any], pivots: NDArray[Any] | None,
    start: float = 0.0,
) -> NDArray[Any]:  # fmt: skip
    """The output of a recursion on a table of Rows and object arrays by name; an optional input may be missing.

    A static table is a list of Rows too.

    shape   shape of the output; (1,) for a scalar
    pivots  (rows,) of objects, written in place if the recursion has pivots
    start   value of entries that the recursion does not write
    """
    out = np.full(shape or (1,), start, dtype=object)
    beside = spec.run(rows, scratch(spec.work, rows), inputs, out, lambda size: np.empty(size, dtype=object))
    if spec.pivots and pivots is not None:
        pivots[:] = beside[0]
    return out

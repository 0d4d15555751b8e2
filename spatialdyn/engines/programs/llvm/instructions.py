"""Programs as arrays of instructions on slots, which the machine code of ``interpreter_text`` runs one by one.

The checks of a sample are instructions too. They use the same operations as compiled code and sum in the same order, so
an interpreted program rejects the same samples as the compiled program.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....algebra.rotations import UNIT_TOLERANCE
from ....errors import SpatialDynError
from ...polynomials import MAX_ANGLE
from ..record.kernel_layout import KernelLayout
from ..record.operations import (
    ADD,
    AGAIN,
    CARRIED,
    CONST,
    COS,
    FMA,
    FMS,
    FNMA,
    FORMS,
    INPUT,
    MUL,
    NEXT,
    REPEAT,
    SIN,
    SUB,
    arities,
)
from ..record.program import Program
from .schedule import angles

# Codes in addition to those of FORMS. ALSO is no instruction: it follows a TURN and stands for the cosine's value.
ALSO, TURN, NEGATE, FINITE, WITHIN, ABOVE, END = range(-7, 0)
SIGN = np.uint64(1 << 63)  # bit of an output that is negated
CODE_BITS = 8  # bits of the code in an instruction's first word; the other bits hold the slot written

Row = tuple[int, int, int, int, int]  # code, value written or NONE, up to three values read or NONE
NONE = -1


class Encoded(NamedTuple):
    """A program as instructions on slots, and its checks.

    code       (m, 4) uint32: the opcode and, above CODE_BITS, the slot written; three slots read, 0 where unused
    constants  (k,) values of the first slots
    inputs     count of numbers in all inputs, which fill the slots behind the constants
    slots      number of slots
    outputs    for each output array, (columns,) uint64: slots, with SIGN where the result is negated
    """

    code: NDArray[np.uint32]
    constants: NDArray[np.float64]
    inputs: int
    slots: int
    outputs: tuple[NDArray[np.uint64], ...]


class Fused(NamedTuple):
    """An operation as a fused multiply-add x y + z with the same bits.

    x, y, z  index of an operand, or a constant: a + b is a 1 + b, and a b is a b - 0
    minus_x, minus_z  whether x or z is negated
    """

    x: int | float
    y: int | float
    z: int | float
    minus_x: bool = False
    minus_z: bool = False


# Operations without a branch of their own: almost all lines of a program.
ARITHMETIC: dict[int, Fused] = {
    ADD: Fused(0, 1.0, 1), SUB: Fused(1, 1.0, 0, minus_x=True), MUL: Fused(0, 1, -0.0),
    FMA: Fused(0, 1, 2), FMS: Fused(0, 1, 2, minus_z=True), FNMA: Fused(0, 1, 2, minus_x=True),
}  # fmt: skip


def opcodes() -> dict[int, int]:
    """The opcode of each code: first the codes of ARITHMETIC, then the others of FORMS, then

    TURN    writes the sine of the first value read, and its cosine to the second slot read
    NEGATE  writes the value with the other sign
    FINITE  rejects the sample unless all three values are finite
    WITHIN  rejects the sample unless the first value's magnitude is at most the second value
    ABOVE   rejects the sample unless the first value is more than the second value
    CARRIED writes the first value read
    REPEAT  if the first value is above 0 in no sample, jumps forward by as many instructions as the second slot says
    AGAIN   jumps back by as many instructions as the first slot says
    END     ends the program
    """
    codes = dict.fromkeys((*ARITHMETIC, *FORMS, TURN, NEGATE, FINITE, WITHIN, ABOVE, CARRIED, REPEAT, AGAIN, END))
    return {code: k for k, code in enumerate(codes)}


class _Encoder:
    """The values of a program by number: lines, then input columns, then the values that checks and signs need."""

    def __init__(self, program: Program, layout: KernelLayout) -> None:
        self.program, self.layout = program, layout
        self.columns = sum(layout.inputs)
        n = len(program.lines)
        self.table = program.table
        self.number = np.arange(n + self.columns + 1)  # number of a line's value; the last entry is for NONE
        given = np.flatnonzero(self.table[:, 0] == INPUT)
        self.number[given] = n + self.table[given, 1]
        self.number[-1] = NONE
        self.constant_at = np.flatnonzero(self.table[:, 0] == CONST)
        self.constants: list[float] = program.constants.tolist()
        self.extra: dict[str, int] = {}  # {``float.hex`` of a further constant: number of its value}
        self.count = n + self.columns
        self.negated: dict[int, int] = {}

    def input(self, column: int) -> int:
        """The value of an input column."""
        return len(self.program.lines) + column

    def value(self, line: int) -> int:
        """The value of a line."""
        return int(self.number[line])

    def new(self) -> int:
        self.count += 1
        return self.count - 1

    def constant(self, value: float) -> int:
        """A constant that no line holds."""
        name = value.hex()
        if name not in self.extra:
            self.extra[name] = self.new()
        return self.extra[name]

    def negative(self, value: int, rows: list[Row]) -> int:
        """The value with the other sign."""
        if value not in self.negated or self.program.regions:  # in a region it may be missing, or of an earlier value
            self.negated[value] = self.new()
            rows.append((NEGATE, self.negated[value], value, NONE, NONE))
        return self.negated[value]

    # -- checks

    def finite(self, values: list[int]) -> list[Row]:
        """Checks that reject samples where a value is not finite."""
        filled = [*values, *values[-1:] * (-len(values) % 3)]
        return [(FINITE, NONE, *three) for three in zip(filled[::3], filled[1::3], filled[2::3], strict=True)]

    def unit(self, values: Sequence[int]) -> list[Row]:
        """Checks that reject samples where the squares of the values do not sum to 1."""
        rows, total = [], self.constant(-1.0)
        for x in values:
            rows.append((FMA, self.new(), x, x, total))
            total = rows[-1][1]
        return [*rows, (WITHIN, NONE, total, self.constant(UNIT_TOLERANCE), NONE)]

    def reach(self, values: Sequence[int]) -> list[Row]:
        """Checks that reject samples where an angle is too large for the short sine."""
        rows: list[Row] = []
        for x in values:
            code, total = (FMA, rows[-1][1]) if rows else (MUL, NONE)
            rows.append((code, self.new(), x, x, total))
        return [*rows, (WITHIN, NONE, rows[-1][1], self.constant(MAX_ANGLE * MAX_ANGLE), NONE)] if rows else []

    def before(self) -> list[Row]:
        """The checks of inputs."""
        rows = self.finite([self.input(k) for k in range(self.columns)])
        for group in self.layout.units:
            rows += self.unit([self.input(k) for k in group])
        return rows

    def behind(self) -> list[Row]:
        """The checks of angles and results, then END."""
        rows: list[Row] = []
        for group in angles(self.program, self.layout):
            rows += self.reach([self.value(line) for line in group])
        lines, outputs = self.program.lines, self.program.outputs
        for place, least in self.layout.pivots:
            line, minus = outputs[place]
            x = self.value(line)
            rows.append((ABOVE, NONE, self.negative(x, rows) if minus else x, self.constant(least), NONE))
        for part in self.layout.norms:
            rows += self.unit([self.value(outputs[place][0]) for place in part])
        found = dict.fromkeys(outputs[place][0] for part in self.layout.checked for place in part)
        rows += self.finite([self.value(line) for line in found if lines[line].code not in (INPUT, CONST)])
        return [*rows, (END, NONE, NONE, NONE, NONE)]

    # -- lines

    def lines(self) -> NDArray[np.int64]:
        """The program's rows; sine and cosine of one angle are together."""
        table = self.table
        work = np.flatnonzero((table[:, 0] != INPUT) & (table[:, 0] != CONST))
        arity_of = arities()
        arity = np.zeros(max(arity_of) + 1, np.int64)
        arity[list(arity_of)] = list(arity_of.values())
        operands = np.where(np.arange(3) < arity[table[work, 0], None], table[work, 1:], len(self.number) - 1)
        place = 4 * np.arange(len(work))
        signs: list[Row] = []
        before: list[int] = []  # places of those
        more: list[int] = []
        for k, column in np.argwhere(operands < 0).tolist():
            line = -int(operands[k, column]) - 1
            value = self.negative(self.value(line), signs)
            before += [4 * k - 1] * (len(signs) - len(before))
            operands[k, column] = len(self.number) + len(more)
            more.append(value)
        number = np.concatenate((self.number, np.array(more, np.int64)))
        rows = np.column_stack((table[work, 0], work, number[operands]))
        if self.program.regions:
            nexts = np.flatnonzero(rows[:, 0] == NEXT)
            rows[nexts, 0], rows[nexts, 1], rows[nexts, 2], rows[nexts, 3] = CARRIED, *rows[nexts, 2:4].T, NONE
            markers = np.flatnonzero((rows[:, 0] == REPEAT) | (rows[:, 0] == AGAIN))
            rows[markers, 1] = NONE
            rows[rows[:, 0] == AGAIN, 2] = NONE
        first: dict[int, int] = {}
        for k in np.flatnonzero((rows[:, 0] == SIN) | (rows[:, 0] == COS)).tolist():
            at = first.setdefault(int(rows[k, 2]), k)
            if rows[k, 2] >= len(self.program.lines):  # of inputs: in a row at the start, where jumps are predicted
                place[k] = 4 * (k - len(rows))
            if at != k:
                sine, cosine = (at, k) if rows[at, 0] == SIN else (k, at)
                rows[at, 1], rows[k, 1] = work[sine], work[cosine]
                rows[at, 0], rows[k] = TURN, (ALSO, rows[k, 1], NONE, NONE, NONE)
                place[k] = place[at] + 1
        order = np.argsort(np.concatenate((place, np.array(before, np.int64))), kind="stable")
        return np.concatenate((rows, np.array(signs, np.int64).reshape(-1, 5)))[order]

    def encoded(self) -> Encoded:
        """All rows on slots."""
        before, lines, behind = self.before(), self.lines(), self.behind()
        rows = np.concatenate((np.array(before, np.int64).reshape(-1, 5), lines, np.array(behind, np.int64)))
        for code, fused in ARITHMETIC.items():
            these = np.flatnonzero(rows[:, 0] == code)
            operands = rows[these, 2:]
            for place, operand in enumerate(fused[:3]):
                constant = isinstance(operand, float)
                rows[these, 2 + place] = self.constant(operand) if constant else operands[:, int(operand)]
        slot, slots = self.slots(rows)
        places = slot[rows[:, 1:]]
        places[rows[:, 1:] == NONE] = 0
        turns = np.flatnonzero(rows[:, 0] == TURN)
        places[turns, 2] = places[turns + 1, 0]
        known = opcodes()
        opcode = np.zeros(max(known) - min(known) + 1, np.int64)
        opcode[np.array(list(known)) - min(known)] = list(known.values())
        places[:, 0] = places[:, 0] << CODE_BITS | opcode[np.maximum(rows[:, 0], min(known)) - min(known)]
        kept = rows[:, 0] != ALSO
        for head, end in _regions(rows):
            places[head, 2] = kept[head : end + 1].sum()
            places[end, 1] = kept[head:end].sum()
        code = places[kept].astype(np.uint32)
        lines_of = np.array([line for line, _ in self.program.outputs], np.int64)
        signs = np.where([minus for _, minus in self.program.outputs], SIGN, np.uint64(0))
        entries = slot[self.number[lines_of]].astype(np.uint64) | signs if len(lines_of) else signs
        outputs = tuple(entries[list(part)] for part in self.layout.outputs)
        constants = np.array([*self.constants, *map(float.fromhex, self.extra)], np.float64)
        return Encoded(code, constants, self.columns, slots, outputs)

    def slots(self, rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
        """The slot of each value, and the number of slots; a slot is reused after its value's last reader."""
        fixed = [*self.constant_at.tolist(), *self.extra.values(), *map(self.input, range(self.columns))]
        slot = np.full(self.count + 1, NONE)
        slot[fixed] = np.arange(len(fixed))
        at, read = np.arange(len(rows)), rows[:, 2:]
        last = np.full(self.count + 1, NONE)  # index of the last reader; the last entry is for NONE
        for column in range(3):
            last[read[:, column]] = np.maximum(last[read[:, column]], at)
        last[fixed[: len(fixed) - self.columns]] = len(rows)  # constants stay
        last[self.number[[line for line, _ in self.program.outputs]]] = len(rows)
        last[NONE] = len(rows)
        released: dict[int, list[int]] = {}  # {end of a region: values from before it whose last reader is in it}
        if self.program.regions:
            first = np.full(self.count + 1, len(rows))
            np.minimum.at(first, rows[:, 1], at)
            first[fixed] = -1
            for head, end in _regions(rows):
                held_on = (first < head) & (last > head) & (last < end)
                last[held_on] = end
            for value in np.flatnonzero(np.isin(last, [end for _, end in _regions(rows)])).tolist():
                released.setdefault(int(last[value]), []).append(value)
        ends = last[read] == at[:, None]
        ends[:, 1] &= read[:, 1] != read[:, 0]
        ends[:, 2] &= (read[:, 2] != read[:, 0]) & (read[:, 2] != read[:, 1])
        held: list[int] = slot.tolist()
        free: list[int] = []
        count = len(fixed)
        columns = (rows[:, 1].tolist(), *np.where(ends, read, NONE).T.tolist())
        for k, (value, a, b, c) in enumerate(zip(*columns, strict=True)):
            if a >= 0:
                free.append(held[a])
            if b >= 0:
                free.append(held[b])
            if c >= 0:
                free.append(held[c])
            if k in released:
                free += [held[x] for x in released[k]]
            if value >= 0 and (not released or held[value] < 0):
                if free:
                    held[value] = free.pop()
                else:
                    held[value] = count
                    count += 1
        return np.array(held), count


def _regions(rows: NDArray[np.int64]) -> list[tuple[int, int]]:
    """The rows REPEAT and AGAIN of each region; an inner region comes before the one around it."""
    found, heads = [], []
    for k in np.flatnonzero((rows[:, 0] == REPEAT) | (rows[:, 0] == AGAIN)).tolist():
        if rows[k, 0] == REPEAT:
            heads.append(k)
        else:
            found.append((heads.pop(), k))
    return found


def encode(program: Program, layout: KernelLayout) -> Encoded:
    """The instructions of a program and its layout's checks, in float64.

    Raises SpatialDynError if the layout has a range, which only float32 programs have.
    """
    if layout.range is not None:
        raise SpatialDynError(f"range is {layout.range}, expected None for an interpreted program, which is in float64")
    return _Encoder(program, layout).encoded()

"""Programs on SIMD lanes: one recorded program on as many samples at once as a register holds.

A Program becomes one LLVM function over tiles of W samples, where W is the host's vector width. The rows of a tile are
read with whole-vector loads and transposed in registers, the program runs on <W x double>, and the results are
transposed back; memory is used only for a small workspace. Longer programs (``schedule.MOST_WHOLE``), and their long
regions, are cut into several functions, between which values are spilled to the workspace.

The code computes only ordinary samples. In addition to the results it writes one bit per sample: whether every input is
finite, every quaternion has unit norm, every angle is in the range of the short sine, every pivot is regular and every
result is finite; in float32, with ``ranged``, also whether underflow cannot matter. Checks that others make needless
are left out, see ``finite``. The recursion in NumPy recomputes samples whose bit is 0 and finds the fault.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ....algebra.rotations import UNIT_TOLERANCE
from ...polynomials import MAX_ANGLE
from ..record import finite
from ..record.kernel_layout import Float32Range, KernelLayout
from ..record.operations import AGAIN, CONST, FORMS, INPUT, REPEAT, signed
from ..record.program import Program
from ..record.structure import Numbers
from . import columns, lookups
from .host_cpu import host, lanes_of, object_code
from .llvm_module import module
from .llvm_vectors import ZERO, Vectors
from .region_text import Regions, RegionWriter
from .schedule import Schedule, held, is_whole

STORED = 128  # most columns that one function of a long program writes


def _common(program: Program, layout: KernelLayout) -> dict[int, tuple[int, int]]:
    """The array and column of each line that is an input for all samples."""
    ends = np.cumsum([0, *layout.inputs])
    places = {int(ends[a]) + k: (a, k) for a in layout.common for k in range(layout.inputs[a])}
    return {k: places[op.a] for k, op in enumerate(program.lines) if op.code == INPUT and op.a in places}


class Writer:
    """The LLVM module of one program.

    most_reach  largest sum of squares of the angles of a function
    together    most angles whose sines and cosines are computed in step: more need more registers than there are
    """

    most_reach = MAX_ANGLE * MAX_ANGLE

    def __init__(
        self,
        program: Program,
        layout: KernelLayout,
        dtype: Any,
        lanes: int,
        fma: bool,
        stream: bool = False,
        whole: bool | None = None,
    ) -> None:
        """``whole``: in one function; by default unless ``schedule.is_whole`` says no."""
        self.program, self.layout = program, layout
        self.scalar = "double" if np.dtype(dtype) == np.float64 else "float"
        self.lanes, self.fma, self.stream = lanes, fma, stream
        self.schedule = Schedule(program, layout, is_whole(program, layout) if whole is None else whole)
        self.numbers = Numbers(program, layout)
        self.bounded = layout.range is None and finite.bounded(program)
        nothing: frozenset[int] = frozenset()
        self.implied = finite.implied(program, layout) if layout.range is None else (nothing, nothing)
        self.common = _common(program, layout)
        self.whole = self.schedule.whole
        kept = lanes == 1 and self.whole and not layout.bounds  # numbers of one sample are spilled as they are
        self.afresh = not (kept or held(program, layout))
        self.poison_slot = self.schedule.slot_count  # followed by the floor's slot, if ranges are checked
        self.stage = self.poison_slot + (1 if layout.range is None else 2)  # slots of rows to be streamed
        self.staged = [columns.staged(len(places), lanes, stream) for places in layout.outputs]
        staged = [len(places) for places, first in zip(layout.outputs, self.staged, strict=True) if first]
        slots = self.stage + max(staged, default=0)
        self.regions = Regions(program, self.schedule.cut, slots)
        slots += len(self.regions.carried)
        self.lookups = lookups.find(program, self.common if self.whole else {})
        if self.lookups.tables:  # only in programs of one function, whose values have no other slots
            self.schedule.slots |= {end: slots + at for at, end in enumerate(self.lookups.of_end)}
            slots += len(self.lookups.of_end)
        size = 8 if self.scalar == "double" else 4
        self.workspace = slots * lanes * size
        self.together = 6 if lanes == 1 or lanes * size == 64 else 3

    def text(self) -> str:
        """The module."""
        self.values: dict[int, str] = {}
        functions: list[str] = []
        main = Vectors(self.scalar, self.lanes, self.fma)
        poison, floor = self._prologue(main)
        if self.whole:
            poison = self._operations(main, self.schedule.chunks[0], poison, inside=False)
        else:
            main.store_vector(poison, "%ws", self.poison_slot)
            if floor:
                main.store_vector(floor, "%ws", self.poison_slot + 1)
            for i, chunk in enumerate(self.schedule.chunks):
                if i in self.schedule.control:
                    for k in chunk:
                        self.regions.write_around(main, k, self.program.lines[k], lambda k: self._kept(main, k))
                    continue
                functions.append(self._chunk(len(functions), chunk))
                main.do(f"call void @chunk{len(functions) - 1}(ptr %ws, ptr %numbers)")
            poison = main.load_vector("%ws", self.poison_slot)
            floor = main.load_vector("%ws", self.poison_slot + 1) if floor else floor
        self._epilogue(main, functions, poison, floor)
        return module(main, functions, self.layout, self.workspace, self.stream)

    # -- the parts of a tile

    def _prologue(self, t: Vectors) -> tuple[str, str]:
        """Read the tile's rows and transpose them.

        Returns the poison of the inputs (0, or NaN in lanes of invalid samples), and the least sum of squares of an
        output array, "" if there is none.
        """
        index = {op.a: k for k, op in enumerate(self.program.lines) if op.code == INPUT and k not in self.common}
        if not self.whole:
            for k, (a, column) in self.common.items():
                t.store_vector(t.spread(f"%in{a}", column), "%ws", self.schedule.slots[k])
        zero = t.constant(0.0)
        poison = [ZERO] * 4
        given: list[str] = []
        wide = self.layout.range
        driving: list[str] = []
        for a, width in enumerate(self.layout.inputs):
            if a in self.layout.common:
                given += [""] * width
                continue
            found = columns.read(t, f"%in{a}", f"%step{a}", width)
            given += found
            if wide and a in (wide.driving or ()):
                driving += found
        for i, x in enumerate(given):
            if not x:
                continue
            if i not in self.implied[0]:
                poison[i % 4] = t.fused(x, x if wide else zero, poison[i % 4])
            if i in index:
                self.values[index[i]] = x
                if not self.whole:
                    t.store_vector(x, "%ws", self.schedule.slots[index[i]])
        base = self._added(t, poison)
        floor = ""
        if wide:
            small = t.compare("ole", base, t.spread("%numbers", self.numbers.most))
            base = t.poisoned_unless(small, ZERO)
            floor = self._floor(t, wide, driving)
        for group in self.layout.units:
            base = t.poisoned_unless(self._unit(t, [given[i] for i in group]), base)
        return base, floor

    def _floor(self, t: Vectors, wide: Float32Range, driving: Sequence[str]) -> str:
        """The least sum of squares of an output array, 0 where all driving inputs are 0, to the bit."""
        least = t.spread("%numbers", self.numbers.least)
        if wide.driving is None:
            return least
        if not driving:
            return ZERO
        bits = t.integer(0)
        for x in driving:
            bits = t.put(f"or {t.bits} {bits}, {t.put(f'bitcast {t.vector} {x} to {t.bits}')}")
        size = t.put(f"shl {t.bits} {bits}, {t.integer(1)}")  # shifts the signs out
        moves = t.put(f"icmp ne {t.bits} {size}, zeroinitializer")
        return t.select(moves, least, ZERO)

    def _unit(self, t: Vectors, group: Sequence[str]) -> str:
        """The mask of samples in which the squares of a group of inputs sum to 1."""
        total = t.constant(-1.0)
        for x in group:
            total = t.fused(x, x, total)
        return t.compare("ole", t.unary("fabs", total), t.constant(UNIT_TOLERANCE))

    def _chunk(self, i: int, chunk: list[int]) -> str:
        """One function of a long program, which loads values from the workspace and spills values to it."""
        t = Vectors(self.scalar, self.lanes, self.fma)
        self.values = {}
        poison = t.load_vector("%ws", self.poison_slot)
        poison = self._operations(t, chunk, poison, inside=True)
        t.store_vector(poison, "%ws", self.poison_slot)
        t.do("ret void")
        return t.function(f"define internal void @chunk{i}(ptr noalias %ws, ptr noalias %numbers)", " noinline #0")

    def _kept(self, t: Vectors, k: int) -> str:
        """The value of an operand that is a number, or in the workspace."""
        if k < 0:
            return t.negative(self._kept(t, -k - 1))
        if self.program.lines[k].code == CONST:
            return t.spread("%numbers", self.numbers.of_line[k])
        return self._absent(t, k)

    def _operations(self, t: Vectors, chunk: Sequence[int], poison: str, inside: bool) -> str:
        """Write some lines; ``inside``: in one of several functions, which spills values that others need."""
        lines, values = self.program.lines, self.values
        angles: set[int] = set()
        tables: set[tuple[int, ...]] = set()  # tables that have been looked up
        reach = ""
        within = self.schedule.within(chunk)
        waiting = self._input_angles(chunk)

        def value(k: int) -> str:
            if k < 0:
                return t.negative(value(-k - 1))
            if lines[k].code == CONST:
                return t.spread("%numbers", self.numbers.of_line[k], self.afresh)
            if k in self.common and self.whole:
                a, column = self.common[k]
                return t.spread(f"%in{a}", column)
            if k not in values:
                values[k] = self._absent(t, k)
            return values[k]

        regions = RegionWriter(self.regions, t, values, value, lambda k: self._computed(t, k, inside))
        for k in chunk:
            op = lines[k]
            if regions.write(k, op):
                continue
            if k in self.lookups.links:
                continue
            if k in self.lookups.of_end:
                conditions = self.lookups.of_end[k]
                if conditions not in tables:
                    tables.add(conditions)
                    self._look_up(t, [value(c) for c in conditions], self.lookups.tables[conditions])
                continue
            form, given = FORMS[op.code], [value(operand) for operand in signed(op)]
            if form.angle and not (regions.within or within) and op.a not in angles:  # in regions, out of range is NaN
                angles.add(op.a)
                x = given[0]
                reach = t.fused(x, x, reach) if reach else t.binary("fmul", x, x)
            if form.angle and op.a in waiting:
                at = waiting.index(op.a)
                t.turn([value(angle) for angle in waiting[at : at + self.together]])
                del waiting[at : at + self.together]
            values[k] = form.llvm(t, *given)
            self._computed(t, k, inside)
        if reach:
            poison = t.poisoned_unless(t.compare("ole", reach, t.constant(self.most_reach)), poison)
        return poison

    def _input_angles(self, chunk: Sequence[int]) -> list[int]:
        """The angles that are inputs, in the order of their first readers, without those read in regions only."""
        lines, depth = self.program.lines, int(self.schedule.within(chunk))
        found: dict[int, None] = {}
        for k in chunk:
            op = lines[k]
            depth += (op.code == REPEAT) - (op.code == AGAIN)
            if op.code in FORMS and FORMS[op.code].angle and not depth and op.a >= 0 and lines[op.a].code == INPUT:
                found[op.a] = None
        return list(found)

    def _absent(self, t: Vectors, k: int) -> str:
        """The value of a line that this function has not computed."""
        carried = self.regions.carried
        return t.load_vector("%ws", carried[k] if k in carried else self.schedule.slots[k])

    def _computed(self, t: Vectors, k: int, inside: bool) -> None:
        """Spill the value of a line if another function reads it; ``inside`` as of ``_operations``."""
        if inside and k in self.schedule.slots:
            t.store_vector(self.values[k], "%ws", self.schedule.slots[k])

    def _look_up(self, t: Vectors, conditions: Sequence[str], chains: Sequence[lookups.Chain]) -> None:
        """Write looked-up values to their slots: at once if all lanes have the same row, else lane by lane."""
        slots, name, index = self.schedule.slots, f"table{chains[0].end}", ZERO
        for j, x in enumerate(conditions, 1):
            index = t.put(f"select {t.truth} {t.above_zero(x)}, {t.bits} {t.integer(j)}, {t.bits} {index}")
        rows = [t.put(f"extractelement {t.bits} {index}, i64 {lane}") for lane in range(self.lanes)]
        if t.size < 8:
            rows = [t.put(f"sext i32 {row} to i64") for row in rows]
        same = "true"
        for row in rows[1:]:
            same = t.put(f"and i1 {same}, {t.put(f'icmp eq i64 {row}, {rows[0]}')}")
        t.branch(same, f"{name}.one", f"{name}.each", then=f"{name}.one")
        for end, array, column, stride in chains:
            x = t.spread(t.number(f"%in{array}", t.times(rows[0], stride)), column)
            t.store_vector(x, "%ws", slots[end])
        t.jump(f"{name}.done", then=f"{name}.each")
        for lane, row in enumerate(rows):
            for end, array, column, stride in chains:
                x = t.load_number(t.number(f"%in{array}", t.times(row, stride)), column)
                t.store(self.scalar, x, t.number("%ws", slots[end] * self.lanes + lane), t.size)
        t.jump(f"{name}.done", then=f"{name}.done")

    def _epilogue(self, t: Vectors, functions: list[str], poison: str, floor: str) -> None:
        """Transpose the results into their rows and write the tile's bits."""
        if not self.whole:
            self.values = {}
        sums = [self._checked_results(t, poison), ZERO, ZERO, ZERO]
        apart, per = not self.whole and not floor, max(1, STORED // self.lanes)
        if apart:
            t.store_vector(sums[0], "%ws", self.poison_slot)
        seen: set[int] = set()
        for a, places in enumerate(self.layout.outputs):
            blocks = list(columns.blocks(len(places), self.lanes))
            if apart:
                for at in range(0, len(blocks), per):
                    functions.append(self._output_function(len(functions), a, blocks[at : at + per], seen))
                    t.do(f"call void @chunk{len(functions) - 1}(ptr %ws, ptr %numbers, ptr %out{a}, i64 %first)")
            else:
                squares = self._write_columns(t, a, blocks, set() if floor else seen, sums, bool(floor))
            if self.staged[a]:
                to = t.at(t.vector, "%ws", self.stage)
                t.do(f"call void @copy(ptr %out{a}, i64 %tile, i64 {len(places)}, ptr {to})")
            if floor and squares:
                total = self._added(t, squares)
                sums[0] = t.poisoned_unless(t.compare("oge", total, floor), sums[0])
                sums[1] = t.fused(total, t.constant(0.0), sums[1])
        total = t.load_vector("%ws", self.poison_slot) if apart else self._added(t, sums)
        bits = t.put(f"bitcast {t.truth} {t.compare('oeq', total, ZERO)} to i{self.lanes}")
        if self.lanes < 16:
            bits = t.put(f"zext i{self.lanes} {bits} to i16")
        t.store("i16", bits, t.at("i16", "%bits", "%tile"), 2)

    def _output_function(self, i: int, a: int, blocks: Sequence[tuple[int, int]], seen: set[int]) -> str:
        """The function of some blocks of an output of a long program: its results are in the workspace."""
        t = Vectors(self.scalar, self.lanes, self.fma)
        self.values = {}
        sums = [t.load_vector("%ws", self.poison_slot), ZERO, ZERO, ZERO]
        self._write_columns(t, a, blocks, seen, sums, False)
        t.store_vector(self._added(t, sums), "%ws", self.poison_slot)
        t.do("ret void")
        given = f"ptr noalias %ws, ptr noalias %numbers, ptr noalias %out{a}, i64 %first"
        return t.function(f"define internal void @chunk{i}({given})", " noinline #0")

    def _write_columns(
        self, t: Vectors, a: int, blocks: Sequence[tuple[int, int]], seen: set[int], sums: list[str], floor: bool
    ) -> list[str]:
        """Write blocks of an output's columns, and add results that are not ``seen`` to ``sums``, which are NaN if one
        is not finite; returns four sums of their squares if there is a floor and there are such results.
        """
        lines, zero, places = self.program.lines, t.constant(0.0), self.layout.outputs[a]
        squares = [t.spread("%numbers", self.numbers.squares[a]), *[ZERO] * 3] if floor else []
        if self.staged[a]:
            to = t.at(t.vector, "%ws", self.stage)
            starts = [t.number(to, r * len(places)) for r in range(self.lanes)]
        else:
            starts = columns.starts(t, f"%out{a}", len(places))
        past = self.stream and not self.staged[a]  # whether stores bypass the CPU caches
        align = t.size * (self.lanes if past else 1)
        for first, size in blocks:
            vectors = []
            for c in range(first, first + size):
                x = self._result(t, places[c])
                line = self.program.outputs[places[c]][0]
                checked = a < len(self.layout.checked) and not self.bounded and line not in self.implied[1]
                if checked and line not in seen and lines[line].code != CONST:
                    seen.add(line)
                    i = len(seen) % 4
                    if floor:
                        squares[i] = t.fused(x, x, squares[i])
                    else:
                        sums[i] = t.fused(x, zero, sums[i])
                vectors.append(x)
            columns.write(t, starts, first, vectors, align, past)
        return squares if seen else []

    def _result(self, t: Vectors, place: int) -> str:
        """The result at an index of the program's outputs."""
        line, minus = self.program.outputs[place]
        if self.program.lines[line].code == CONST:
            x = t.spread("%numbers", self.numbers.of_line[line])
        elif line in self.common and self.whole:
            x = t.spread(f"%in{self.common[line][0]}", self.common[line][1])
        else:
            if line not in self.values:
                self.values[line] = self._absent(t, line)
            x = self.values[line]
        return t.negative(x) if minus else x

    def _checked_results(self, t: Vectors, poison: str) -> str:
        """The poison, set to NaN where a pivot is too small or a result is not of unit norm."""
        for (place, _), at in zip(self.layout.pivots, self.numbers.of_pivot, strict=True):
            regular = t.compare("ogt", self._result(t, place), t.spread("%numbers", at))
            poison = t.poisoned_unless(regular, poison)
        for group in self.layout.norms:
            poison = t.poisoned_unless(self._unit(t, [self._result(t, place) for place in group]), poison)
        return poison

    def _added(self, t: Vectors, four: Sequence[str]) -> str:
        """The sum of four vectors, without those that are 0 for all samples."""

        def sum_of(x: str, y: str) -> str:
            return y if x == ZERO else x if y == ZERO else t.binary("fadd", x, y)

        a, b, c, d = four
        return sum_of(sum_of(a, b), sum_of(c, d))


def compile_program(
    program: Program, layout: KernelLayout, dtype: Any = np.float64, stream: bool = False, one: bool = False
) -> tuple[bytes, int]:
    """Object code of the kernel, and the bytes of workspace that a call needs; programs of one structure share both.

    one     for tiles of one sample: LLVM turns vectors of one number into scalars
    stream  results bypass the CPU caches, for outputs larger than the caches: the contiguous rows of a tile are
            written in whole cache lines. The outputs must be aligned to a vector.
    """
    fma = host()[3]
    lanes = 1 if one else lanes_of(dtype)
    writer = Writer(program, layout, dtype, lanes, fma, stream)
    return object_code(writer.text()), writer.workspace

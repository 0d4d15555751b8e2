"""Programs on threads: a thread runs one recorded program on one sample, of a batch or through steps of a time loop.

The arithmetic is that of ``simd`` on one lane, so results have the same bits; only reading and writing of a sample
differ. An input is loaded where it is first read, and a result is stored where it is computed, since the values that a
thread holds at a time must fit in its registers. The checks reject every sample that lanes reject. Sums of squares have
another order here, so they reject a few more samples; rejected samples go to lanes, so no result depends on that.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..llvm.llvm_vectors import ZERO, Vectors
from ..llvm.simd import Writer
from ..record.kernel_layout import KernelLayout
from ..record.operations import CONST, INPUT, operands
from ..record.program import Program

MARGIN = {"double": 1e-9, "float": 1e-3}  # relative margin of sums of squares: rounding of 10 000 terms is below it
GLOBAL, CONSTANT = 1, 4  # address spaces of NVPTX; a host has only one


class Thread(Vectors):
    """A function body on one lane; its pointers may have other address spaces than 0.

    spaces  {pointer: its address space} of pointers whose space is not 0
    """

    def __init__(self, scalar: str) -> None:
        """A body on ``double`` or ``float``, with fused multiply-add, which every GPU has."""
        super().__init__(scalar, 1, True)
        self.spaces: dict[str, int] = {}

    def pointer(self, address: str) -> str:
        """A pointer with its type."""
        space = self.spaces.get(address, 0)
        return f"ptr addrspace({space}) {address}" if space else f"ptr {address}"

    def at(self, kind: str, base: str, count: int | str) -> str:
        made = self.put(f"getelementptr {kind}, {self.pointer(base)}, i64 {count}")
        if base in self.spaces:
            self.spaces[made] = self.spaces[base]
        return made

    def load(self, kind: str, address: str, align: int = 0) -> str:
        return self.put(f"load {kind}, {self.pointer(address)}" + (f", align {align}" if align else ""))

    def store(self, kind: str, value: str, address: str, align: int = 0, stream: bool = False) -> None:
        self.do(f"store {kind} {value}, {self.pointer(address)}" + (f", align {align}" if align else ""))


class ThreadWriter(Writer):
    """The body of a thread: a program on one sample, whose rows are %in0, %in1 ... and %out0, %out1 ...

    states  how many of the first inputs are states of a time loop; states have no rows, and results are not stored
    """

    def __init__(
        self, program: Program, layout: KernelLayout, dtype: Any, order: Sequence[int] | None = None, states: int = 0
    ) -> None:
        """``order`` of the program's lines, by default the program's own."""
        super().__init__(program, layout, dtype, 1, True, whole=True)
        lines = range(len(program.lines)) if order is None else order
        self.schedule.chunks = [[k for k in lines if program.lines[k].code not in (INPUT, CONST)]]
        self.afresh, self.together = False, 1
        self.states = states
        self.most_reach *= 1.0 - MARGIN[self.scalar]
        self.places = [(a, c) for a, width in enumerate(layout.inputs) for c in range(width)]  # array, column in it
        self.stores: dict[int, list[tuple[int, int, int]]] = {}  # {line: output, column and place} of results
        for a, places in enumerate(layout.outputs):
            for c, place in enumerate(places):
                self.stores.setdefault(program.outputs[place][0], []).append((a, c, place))
        self.pivots: dict[int, list[int]] = {}  # {line: indices of pivots}
        for k, (place, _) in enumerate(layout.pivots):
            self.pivots.setdefault(program.outputs[place][0], []).append(k)

    def body(self, t: Thread, carried: Sequence[str] = ()) -> tuple[str, list[list[str]]]:
        """Write the program; returns whether its checks hold (an i1), and the results of each output.

        carried  the columns of the states
        """
        self.values: dict[int, str] = {}
        self.columns: dict[int, str] = {}  # {column: its value} of columns that are loaded
        self.finite, self.norm, self.bits = [ZERO, ZERO], ZERO, ZERO
        wide, scalar = self.layout.range, self.scalar
        self.squares = [t.spread("%numbers", at) for at in self.numbers.squares] if wide else []
        self.index = {op.a: k for k, op in enumerate(self.program.lines) if op.code == INPUT and k not in self.common}
        self.done: set[tuple[int, int]] = set()  # results that are checked
        for column, x in enumerate(carried):
            self._read(t, column, x)
        for group in self.layout.units:
            whole = self._unit(t, [self._column(t, column) for column in group])
            self.finite[0] = t.poisoned_unless(whole, self.finite[0])
        if self.program.regions:  # values computed within a region are not defined behind it
            self._read_all(t)
        angles = self._operations(t, self.schedule.chunks[0], ZERO, inside=False)  # checks columns and pivots too
        self.finite[0] = t.binary("fadd", self.finite[0], angles)
        results = [[self._result(t, place) for place in places] for places in self.layout.outputs]
        for a, places in enumerate(self.layout.outputs):
            for c, place in enumerate(places):
                self._write(t, a, c, place, results[a][c])
        for group in self.layout.norms:
            whole = self._unit(t, [self._result(t, place) for place in group])
            self.finite[0] = t.poisoned_unless(whole, self.finite[0])
        for k in (k for those in self.pivots.values() for k in those):
            self._check_pivot(t, k)
        self._read_all(t)
        if wide:
            margin = MARGIN[scalar]
            most = t.binary("fmul", t.spread("%numbers", self.numbers.most), t.constant(1.0 - margin))
            self.finite[0] = t.poisoned_unless(t.compare("ole", self.norm, most), self.finite[0])
            least = t.binary("fmul", t.spread("%numbers", self.numbers.least), t.constant(1.0 + margin))
            if wide.driving is not None:
                size = t.put(f"shl {t.bits} {self.bits}, {t.integer(1)}")  # shifts the sign out
                moves = t.put(f"icmp ne {t.bits} {size}, zeroinitializer")
                least = t.select(moves, least, ZERO) if wide.driving else ZERO
            for a in range(len(self.layout.checked)):
                if any(self.program.lines[self.program.outputs[p][0]].code != CONST for p in self.layout.outputs[a]):
                    total = self.squares[a]
                    self.finite[1] = t.fused(total, t.constant(0.0), self.finite[1])
                    self.finite[0] = t.poisoned_unless(t.compare("oge", total, least), self.finite[0])
        good = t.compare("oeq", t.binary("fadd", *self.finite), ZERO)
        return t.put(f"extractelement {t.truth} {good}, i64 0"), results

    # -- inputs

    def _absent(self, t: Vectors, k: int) -> str:
        op = self.program.lines[k]
        return self._column(t, op.a) if op.code == INPUT else super()._absent(t, k)

    def _result(self, t: Vectors, place: int) -> str:
        line = self.program.outputs[place][0]
        if self.program.lines[line].code == INPUT and line not in self.common and line not in self.values:
            self.values[line] = self._column(t, self.program.lines[line].a)
        return super()._result(t, place)

    def _column(self, t: Vectors, column: int) -> str:
        """An input column, loaded and checked at its first use."""
        if column not in self.columns:
            a, c = self.places[column]
            self._read(t, column, t.load(t.vector, t.number(f"%in{a}", c), t.size))
        return self.columns[column]

    def _read(self, t: Vectors, column: int, x: str) -> None:
        """Note and check the value of an input column."""
        wide = self.layout.range
        self.columns[column] = x
        if column in self.index:
            self.values[self.index[column]] = x
        if wide is None:
            i = len(self.columns) % 2
            self.finite[i] = t.fused(x, t.constant(0.0), self.finite[i])
            return
        self.norm = t.fused(x, x, self.norm)
        if self.places[column][0] in (wide.driving or ()):
            self.bits = t.put(f"or {t.bits} {self.bits}, {t.put(f'bitcast {t.vector} {x} to {t.bits}')}")

    def _read_all(self, t: Vectors) -> None:
        """Load and check the columns that have not been read."""
        for column, (a, _) in enumerate(self.places):
            if a not in self.layout.common:
                self._column(t, column)

    # -- results

    def _computed(self, t: Vectors, k: int, inside: bool) -> None:
        if self.program.regions:  # a line in a region has a value in each run of it
            return
        for pivot in self.pivots.pop(k, ()):
            self._check_pivot(t, pivot)
        for a, c, place in self.stores.get(k, ()):
            self._write(t, a, c, place, self._result(t, place))

    def _check_pivot(self, t: Vectors, k: int) -> None:
        place, _ = self.layout.pivots[k]
        regular = t.compare("ogt", self._result(t, place), t.spread("%numbers", self.numbers.of_pivot[k]))
        self.finite[0] = t.poisoned_unless(regular, self.finite[0])

    def _write(self, t: Vectors, a: int, c: int, place: int, x: str) -> None:
        """Check a result once, and store it unless this is a time loop."""
        if (a, c) in self.done:
            return
        self.done.add((a, c))
        line = self.program.outputs[place][0]
        if a < len(self.layout.checked) and self.program.lines[line].code != CONST:
            first = self.stores[line][0]
            if self.layout.range is not None:
                before = [c for b, c, _ in self.stores[line] if b == a]
                if c == before[0]:  # each line counts once for an array, as on lanes
                    self.squares[a] = t.fused(x, x, self.squares[a])
            elif (a, c) == first[:2]:
                self.finite[1] = t.fused(x, t.constant(0.0), self.finite[1])
        if not self.states:
            t.store(t.vector, x, t.number(f"%out{a}", c), t.size)


def most_live(program: Program, order: Sequence[int]) -> int:
    """The most values that a thread holds at a time with the lines in this order, if inputs load at first use."""
    last: dict[int, int] = {}
    for at, k in enumerate(order):
        for operand in operands(program.lines[k]):
            last[operand] = at
    live, most, seen = 0, 0, set[int]()
    for at, k in enumerate(order):
        if program.lines[k].code in (CONST, INPUT):
            continue
        here = {x for x in operands(program.lines[k]) if program.lines[x].code != CONST}
        new = {x for x in here if program.lines[x].code == INPUT and x not in seen}
        seen |= new
        live += len(new) + (k in last)
        most = max(most, live)
        live -= sum(last[x] == at for x in here)
    return most

"""Programs on SIMD lanes: one traced program, as many samples side by side as a register holds.

A Program becomes one LLVM function over tiles of W samples, W the host's vector width. A tile's rows are read
with whole-vector loads and transposed in registers, the program runs on <W x double>, and the results are
transposed back; nothing is staged in memory beyond a small workspace. Programs of more than a few thousand
operations are cut into functions of their own, between which values wait in that workspace.

The code answers only the ordinary case. Beside the results it writes one bit a sample: whether every input is
finite, every quaternion of unit norm, every angle in the range of the short sine, every pivot sound and every
result finite; in float32, where asked for, also whether nothing can have underflowed that counts. A sample without
its bit is computed again by the caller, by the engine that can say what is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .host_cpu import assembled, host, lanes_of
from .llvm_entry import entry
from .llvm_vectors import Text
from .tracer import (
    ADD,
    ATAN2,
    CONST,
    COS,
    DIV,
    FMA,
    FMS,
    FNMA,
    INPUT,
    MUL,
    SELECT,
    SIN,
    SQRT,
    SUB,
    Operation,
    Program,
    operands,
)

FAR = 1e5  # angles whose squares sum to more than its square are left to the exact sine
CHUNK = 1500  # operations of one function, in programs of more than WHOLE
WHOLE = 12000  # above, LLVM takes too long over one: aba of talos, 9600, takes 1 s and gains 10 %
STORES = 128  # in one block of the kernel
UNIT_TOLERANCE = 2e-6


@dataclass(frozen=True)
class Range:
    """Sizes between which what a program loses to underflow is below its rounding: roots of sums of squares.

    most     that all inputs together may have
    least    that each output array has to have, unless everything that drives is 0
    driving  numbers of the input arrays whose products with each other may be as small as they like; None where a
             constant other than 0 drives always
    """

    most: float
    least: float
    driving: tuple[int, ...] | None


@dataclass(frozen=True)
class Layout:
    """What a kernel reads and writes, and what it has to hold for a sample to be in order.

    inputs   columns of each input array, in the program's order of inputs
    outputs  for each output array, the places in the program's outputs of its columns
    units    groups of inputs whose squares have to sum to 1
    pivots   (place in the program's outputs, least value) of what has to be larger
    norms    groups of places in the program's outputs whose squares have to sum to 1
    range    sizes that inputs and outputs have to be of, if any
    """

    inputs: tuple[int, ...]
    outputs: tuple[tuple[int, ...], ...]
    units: tuple[tuple[int, ...], ...] = ()
    pivots: tuple[tuple[int, float], ...] = ()
    norms: tuple[tuple[int, ...], ...] = ()
    range: Range | None = None


def _blocks(columns: int, lanes: int) -> Iterator[tuple[int, int]]:
    """(first column, width) of the blocks that cover so many columns: powers of two, the last one overlapping."""
    width = lanes
    while width > columns:
        width //= 2
    for first in range(0, columns - width + 1, width):
        yield first, width
    if columns % width:
        yield columns - width, width


def _depth_first(program: Program) -> list[int]:
    """The program's lines in the order in which its outputs ask for them: each late, near those that need it.

    With pivots there is a third sweep over the robot, and fewer values wait for it: 2 to 6 % of aba. Without, it
    gains nothing.
    """
    order: list[int] = []
    seen: set[int] = set()
    for line, _ in program.outputs:
        waiting = [(line, False)]
        while waiting:
            k, ready = waiting.pop()
            if ready:
                order.append(k)
            elif k not in seen:
                seen.add(k)
                waiting.append((k, True))
                waiting += [(operand, False) for operand in sorted(set(operands(program.lines[k])))]
    return order


class _Writer:
    """The LLVM module of one program."""

    def __init__(
        self, program: Program, layout: Layout, dtype: Any, lanes: int, fma: bool, stream: bool = False
    ) -> None:
        self.program, self.layout = program, layout
        self.scalar = "double" if np.dtype(dtype) == np.float64 else "float"
        self.size = 8 if self.scalar == "double" else 4
        self.lanes, self.fma, self.stream = lanes, fma, stream
        lines = program.lines
        self.whole = len(lines) <= WHOLE
        order = _depth_first(program) if layout.pivots else range(len(lines))
        work = [k for k in order if lines[k].code not in (INPUT, CONST)]
        step = max(len(work), 1) if self.whole else CHUNK
        self.chunks = [work[i : i + step] for i in range(0, len(work), step)] or [[]]
        self.chunk_of = {k: i for i, chunk in enumerate(self.chunks) for k in chunk}
        self.wanted = {line for line, _ in program.outputs}
        self.slots, self.slot_count = self._slots()
        self.stage = self.slot_count + (
            1 if layout.range is None else 2
        )  # where the rows of a tile wait to be streamed out
        staged = [len(places) for places in layout.outputs if stream and len(places) % lanes]
        self.workspace = (self.stage + max(staged, default=0)) * lanes * self.size

    def _slots(self) -> tuple[dict[int, int], int]:
        """Places in the workspace of what is read in another function than it is written in, used again when free."""
        end = len(self.chunks)  # the epilogue
        last: dict[int, int] = {}
        for k, i in self.chunk_of.items():
            for operand in operands(self.program.lines[k]):
                if self.program.lines[operand].code != CONST and self.chunk_of.get(operand, -1) != i:
                    last[operand] = max(last.get(operand, 0), i)
        for k, op in enumerate(self.program.lines):
            if op.code == INPUT or (k in self.wanted and op.code != CONST):
                last[k] = end
        if self.whole:
            return {}, 0
        slots: dict[int, int] = {}
        free: list[int] = []
        ends: dict[int, list[int]] = {}
        count, here = 0, -1
        for k in sorted(last, key=lambda k: (self.chunk_of.get(k, -1), k)):
            if self.chunk_of.get(k, -1) > here:
                here = self.chunk_of.get(k, -1)
                for done in [c for c in ends if c < here]:
                    free += ends.pop(done)
            if free:
                slots[k] = free.pop()
            else:
                slots[k], count = count, count + 1
            ends.setdefault(last[k], []).append(slots[k])
        return slots, count

    def text(self) -> str:
        """The module."""
        self.values: dict[int, str] = {}
        functions = []
        main = Text(self.scalar, self.lanes, self.fma)
        poison, floor = self._prologue(main)
        if self.whole:
            poison = self._operations(main, self.chunks[0], poison, None)
        else:
            self._store(main, poison, self.slot_count)
            if floor:
                self._store(main, floor, self.slot_count + 1)
            for i, chunk in enumerate(self.chunks):
                functions.append(self._chunk(i, chunk))
                main.out.append(f"  call void @chunk{i}(ptr %ws)")
            poison = self._load(main, self.slot_count)
            floor = self._load(main, self.slot_count + 1) if floor else floor
        self._epilogue(main, poison, floor)
        return self._module(main, functions)

    # -- the parts of a tile

    def _prologue(self, t: Text) -> tuple[str, str]:
        """Read the tile's rows and transpose them; returns the poison that the inputs bring, and what the squares of
        an output array have to sum to, empty if to nothing.
        """
        index = {op.a: k for k, op in enumerate(self.program.lines) if op.code == INPUT}
        zero = t.constant(0.0)
        poison = ["zeroinitializer"] * 4
        columns: list[str] = []
        wide = self.layout.range
        driving: list[str] = []
        for a, width in enumerate(self.layout.inputs):
            row = [t.put(f"add i64 %first, {r}") for r in range(self.lanes)]
            starts = [self._at(t, f"%in{a}", t.put(f"mul i64 {r}, %step{a}")) for r in row]
            found = [""] * width
            for first, size in _blocks(width, self.lanes):
                loaded = []
                for i in range(size):
                    parts = []
                    for g in range(self.lanes // size):
                        address = self._at(t, starts[g * size + i], first)
                        kind = f"<{size} x {self.scalar}>"
                        parts.append(t.put(f"load {kind}, ptr {address}, align {self.size}"))
                    loaded.append(self._joined(t, parts, size))
                found[first : first + size] = t.transposed(loaded)
            columns += found
            if wide and a in (wide.driving or ()):
                driving += found
        for i, x in enumerate(columns):
            poison[i % 4] = t.fused(x, x if wide else zero, poison[i % 4])
            if i in index:
                self.values[index[i]] = x
                if not self.whole:
                    self._store(t, x, self.slots[index[i]])
        base = self._added(t, poison)
        floor = ""
        if wide:
            small = t.put(f"fcmp ole {t.vector} {base}, {t.constant(wide.most**2)}")
            base = t.poisoned_unless(small, "zeroinitializer")
            floor = self._floor(t, wide, driving)
        for group in self.layout.units:
            base = t.poisoned_unless(self._unit(t, [columns[i] for i in group]), base)
        return base, floor

    def _floor(self, t: Text, wide: Range, driving: Sequence[str]) -> str:
        """The square of the least size of an output array, 0 where all that drives is 0, to the bit."""
        if wide.driving is None:
            return t.constant(wide.least**2)
        if not driving:
            return "zeroinitializer"
        bits = t.integer(0)
        for x in driving:
            bits = t.put(f"or {t.bits} {bits}, {t.put(f'bitcast {t.vector} {x} to {t.bits}')}")
        size = t.put(f"shl {t.bits} {bits}, {t.integer(1)}")  # without the signs
        moves = t.put(f"icmp ne {t.bits} {size}, zeroinitializer")
        least = t.constant(wide.least**2)
        return t.put(f"select <{self.lanes} x i1> {moves}, {t.vector} {least}, {t.vector} zeroinitializer")

    def _unit(self, t: Text, group: Sequence[str]) -> str:
        """Whether the squares of a group sum to 1."""
        total = t.constant(-1.0)
        for x in group:
            total = t.fused(x, x, total)
        return t.put(f"fcmp ole {t.vector} {t.unary('fabs', total)}, {t.constant(UNIT_TOLERANCE)}")

    def _joined(self, t: Text, parts: list[str], size: int) -> str:
        """Vectors of ``size`` side by side as one."""
        while len(parts) > 1:
            mask = ", ".join(f"i32 {m}" for m in range(2 * size))
            kind = f"<{size} x {self.scalar}>"
            parts = [
                t.put(f"shufflevector {kind} {a}, {kind} {b}, <{2 * size} x i32> <{mask}>")
                for a, b in zip(parts[::2], parts[1::2], strict=True)
            ]
            size *= 2
        return parts[0]

    def _at(self, t: Text, base: str, offset: int | str) -> str:
        """The address so many numbers on."""
        return t.put(f"getelementptr {self.scalar}, ptr {base}, i64 {offset}")

    def _store(self, t: Text, value: str, slot: int) -> None:
        address = t.put(f"getelementptr {t.vector}, ptr %ws, i64 {slot}")
        t.out.append(f"  store {t.vector} {value}, ptr {address}, align {self.size * self.lanes}")

    def _load(self, t: Text, slot: int) -> str:
        address = t.put(f"getelementptr {t.vector}, ptr %ws, i64 {slot}")
        return t.put(f"load {t.vector}, ptr {address}, align {self.size * self.lanes}")

    def _chunk(self, i: int, chunk: list[int]) -> str:
        """One function of a long program: reads what it needs from the workspace, leaves what others need there."""
        t = Text(self.scalar, self.lanes, self.fma)
        self.values = {}
        poison = self._load(t, self.slot_count)
        poison = self._operations(t, chunk, poison, i)
        self._store(t, poison, self.slot_count)
        body = "\n".join(t.out)
        return f"define internal void @chunk{i}(ptr %ws) noinline #0 {{\n{body}\n  ret void\n}}\n"

    def _operations(self, t: Text, chunk: Sequence[int], poison: str, at: int | None) -> str:
        lines, values = self.program.lines, self.values
        pairs: dict[int, tuple[str, str]] = {}
        reach = ""

        def value(k: int) -> str:
            if k < 0:
                return t.negative(value(-k - 1))
            if lines[k].code == CONST:
                return t.constant(lines[k].value)
            if k not in values:
                values[k] = self._load(t, self.slots[k])
            return values[k]

        for k in chunk:
            op = lines[k]
            if op.code in (SIN, COS):
                if op.a not in pairs:
                    x = value(op.a)
                    reach = t.fused(x, x, reach) if reach else t.binary("fmul", x, x)
                    pairs[op.a] = t.sincos(x)
                values[k] = pairs[op.a][op.code == COS]
            else:
                values[k] = self._operation(t, op, value)
            if at is not None and k in self.slots:
                self._store(t, values[k], self.slots[k])
        if reach:
            near = t.put(f"fcmp ole {t.vector} {reach}, {t.constant(FAR * FAR)}")
            poison = t.poisoned_unless(near, poison)
        return poison

    def _operation(self, t: Text, op: Operation, value: Any) -> str:
        words = {ADD: "fadd", SUB: "fsub", MUL: "fmul", DIV: "fdiv"}
        if op.code in words:
            return t.binary(words[op.code], value(op.a), value(op.b))
        if op.code == FMA:
            return t.fused(value(op.a), value(op.b), value(op.c))
        if op.code == FMS:
            return t.fused(value(op.a), value(op.b), t.negative(value(op.c)))
        if op.code == FNMA:
            return t.fused(t.negative(value(op.a)), value(op.b), value(op.c))
        if op.code == ATAN2:
            return t.atan2(value(op.a), value(op.b))
        if op.code == SQRT:
            return t.unary("sqrt", value(op.a))
        if op.code == SELECT:
            above = t.put(f"fcmp ogt {t.vector} {value(op.a)}, zeroinitializer")
            v = t.vector
            return t.put(f"select <{self.lanes} x i1> {above}, {v} {value(op.b)}, {v} {value(op.c)}")
        raise ValueError(f"no vector form of operation {op.code}")

    def _epilogue(self, t: Text, poison: str, floor: str) -> None:
        """Transpose the results into their rows and write the tile's bits."""
        lines, zero = self.program.lines, t.constant(0.0)

        def result(place: int) -> str:
            line, minus = self.program.outputs[place]
            if lines[line].code == CONST:
                return t.constant(-lines[line].value if minus else lines[line].value)
            if line not in self.values:
                self.values[line] = self._load(t, self.slots[line])
            return t.negative(self.values[line]) if minus else self.values[line]

        if not self.whole:
            self.values = {}
        sums = [poison, "zeroinitializer", "zeroinitializer", "zeroinitializer"]
        for place, least in self.layout.pivots:
            sound = t.put(f"fcmp ogt {t.vector} {result(place)}, {t.constant(least)}")
            sums[0] = t.poisoned_unless(sound, sums[0])
        for group in self.layout.norms:
            sums[0] = t.poisoned_unless(self._unit(t, [result(place) for place in group]), sums[0])
        seen: set[int] = set()
        squares = ["zeroinitializer"] * 4
        for a, places in enumerate(self.layout.outputs):
            columns = len(places)
            if floor:
                seen, squares = set(), [self._squares(t, places), *["zeroinitializer"] * 3]
            staged = self.stream and columns % self.lanes > 0
            if staged:
                to = t.put(f"getelementptr {t.vector}, ptr %ws, i64 {self.stage}")
                starts = [self._at(t, to, r * columns) for r in range(self.lanes)]
            else:
                row = [t.put(f"add i64 %first, {r}") for r in range(self.lanes)]
                starts = [self._at(t, f"%out{a}", t.put(f"mul i64 {r}, {columns}")) for r in row]
            how = f"align {self.size}"
            if self.stream and not staged:
                how = f"align {self.size * self.lanes}, !nontemporal !0"
            for first, size in _blocks(columns, self.lanes):
                vectors = []
                for c in range(first, first + size):
                    x = result(places[c])
                    line = self.program.outputs[places[c]][0]
                    if line not in seen and lines[line].code != CONST:
                        seen.add(line)
                        i = len(seen) % 4
                        if floor:
                            squares[i] = t.fused(x, x, squares[i])
                        else:
                            sums[i] = t.fused(x, zero, sums[i])
                    vectors.append(x)
                for i, x in enumerate(t.transposed(vectors)):
                    for g in range(self.lanes // size):
                        kind, part = f"<{size} x {self.scalar}>", x
                        if size < self.lanes:
                            mask = ", ".join(f"i32 {g * size + m}" for m in range(size))
                            part = t.put(f"shufflevector {t.vector} {x}, {t.vector} {x}, <{size} x i32> <{mask}>")
                        address = self._at(t, starts[g * size + i], first)
                        t.out.append(f"  store {kind} {part}, ptr {address}, {how}")
            if staged:
                t.out.append(f"  call void @stream(ptr %out{a}, i64 %tile, i64 {columns}, ptr {to})")
            if floor and seen:
                total = self._added(t, squares)
                sums[0] = t.poisoned_unless(t.put(f"fcmp oge {t.vector} {total}, {floor}"), sums[0])
                sums[1] = t.fused(total, zero, sums[1])
        total = self._added(t, sums)
        fine = t.put(f"fcmp oeq {t.vector} {total}, zeroinitializer")
        bits = t.put(f"bitcast <{self.lanes} x i1> {fine} to i{self.lanes}")
        if self.lanes < 16:
            bits = t.put(f"zext i{self.lanes} {bits} to i16")
        address = t.put("getelementptr i16, ptr %bits, i64 %tile")
        t.out.append(f"  store i16 {bits}, ptr {address}, align 2")

    def _added(self, t: Text, four: Sequence[str]) -> str:
        """The sum of four."""
        a, b, c, d = four
        return t.binary("fadd", t.binary("fadd", a, b), t.binary("fadd", c, d))

    def _squares(self, t: Text, places: Sequence[int]) -> str:
        """The sum of the squares of those results that are constants."""
        lines = [self.program.lines[self.program.outputs[place][0]] for place in places]
        return t.constant(sum(line.value**2 for line in lines if line.code == CONST))

    def _module(self, main: Text, functions: list[str]) -> str:
        v, suffix = main.vector, main.suffix()
        ins = "".join(f"ptr noalias %in{a}, i64 %step{a}, " for a in range(len(self.layout.inputs)))
        outs = "".join(f"ptr noalias %out{a}, " for a in range(len(self.layout.outputs)))
        body, last = _in_blocks(main.out)
        wide = 8 * self.size * self.lanes
        # alignstack: else vectors that wait on the stack may straddle cache lines, a fifth of panda's RNEA
        streaming = _STREAM.format(v=v, align=self.size * self.lanes) if self.stream else ""
        return f"""
declare {v} @llvm.fma.{suffix}({v}, {v}, {v})
declare {v} @llvm.fabs.{suffix}({v})
declare {v} @llvm.sqrt.{suffix}({v})
declare {v} @llvm.copysign.{suffix}({v}, {v})
{streaming}
{"".join(functions)}
define void @kernel(i64 %tiles, {ins}{outs}ptr noalias %bits, ptr noalias %ws) #0 {{
entry:
  %any = icmp sgt i64 %tiles, 0
  br i1 %any, label %loop, label %done
loop:
  %tile = phi i64 [ 0, %entry ], [ %next, %{last} ]
  %first = mul i64 %tile, {self.lanes}
{body}
  %next = add i64 %tile, 1
  %more = icmp slt i64 %next, %tiles
  br i1 %more, label %loop, label %done
done:
  ret void
}}
attributes #0 = {{ alignstack=64 "prefer-vector-width"="{wide}" "min-legal-vector-width"="{wide}" }}
{entry(self.layout.inputs, tuple(map(len, self.layout.outputs)), self.workspace, self.lanes, self.size)}
"""


def _in_blocks(lines: Sequence[str]) -> tuple[str, str]:
    """The loop's text with a way out that is never taken after every so many stores, and the last block's name.

    LLVM's time grows with the square of the stores in one block: 8 s for a mass matrix of 44 rows, cut up 0.4 s.
    """
    text, stores, last = [], 0, "loop"
    for line in lines:
        text.append(line)
        if line.startswith("  store"):
            stores += 1
            if stores % STORES == 0:
                last = f"block{stores // STORES}"
                text += [f"  br i1 %any, label %{last}, label %done", f"{last}:"]
    return "\n".join(text), last


_STREAM = """
!0 = !{{i32 1}}
define internal void @stream(ptr noalias %out, i64 %tile, i64 %columns, ptr noalias %from) noinline #0 {{
entry:
  %start = mul i64 %tile, %columns
  br label %loop
loop:
  %k = phi i64 [ 0, %entry ], [ %next, %loop ]
  %source = getelementptr {v}, ptr %from, i64 %k
  %x = load {v}, ptr %source, align {align}
  %at = add i64 %start, %k
  %target = getelementptr {v}, ptr %out, i64 %at
  store {v} %x, ptr %target, align {align}, !nontemporal !0
  %next = add i64 %k, 1
  %more = icmp slt i64 %next, %columns
  br i1 %more, label %loop, label %done
done:
  ret void
}}
"""


def compiled(
    program: Program, layout: Layout, dtype: Any = np.float64, stream: bool = False, one: bool = False
) -> tuple[bytes, int]:
    """Object code of the kernel, and the bytes of workspace that a call needs.

    one     for tiles of one sample: LLVM makes scalars of vectors of one
    stream  results go past the caches, for outputs larger than they are: a tile's rows, which lie side by side, are
            written in whole lines. The outputs then have to start on a vector's boundary.
    """
    fma = host()[3]
    lanes = 1 if one else lanes_of(dtype)
    writer = _Writer(program, layout, dtype, lanes, fma, stream)
    return assembled(writer.text()), writer.workspace

"""LLVM text of the machine code that runs the instructions of any program, on one sample or on tiles of samples.

Each operation of FORMS is a branch of one switch, written by its form for lanes, so an interpreted program has the bits
of the compiled program.
"""

from __future__ import annotations

from collections.abc import Callable

from ..record.operations import AGAIN, CARRIED, FORMS, REPEAT
from . import host_cpu
from .instructions import ABOVE, ARITHMETIC, CODE_BITS, END, FINITE, NEGATE, SIGN, TURN, WITHIN, opcodes
from .llvm_entry import DATA_OFFSET
from .llvm_vectors import ZERO, Vectors

# Words of a context, 8 bytes each. Addresses: instructions, slots of one sample, vectors of constants, and tables of
# (first slot, columns) for each input and (slots, columns) for each output. Numbers: of constants, inputs and outputs.
CODE, VALUES, CONSTANTS, INPUTS, OUTPUTS, CONSTANT_COUNT, INPUT_COUNT, OUTPUT_COUNT = range(8)
WORDS = 8
INSTRUCTION = 16  # bytes
BITS = 16  # samples whose bits are in one number
UNROLLED = 2  # vectors that a branch computes at a time

ANY = 0  # stands for all codes of ARITHMETIC; 0 is the code of inputs, which are no instructions

Values = list[str]


class _Text(Vectors):
    """The body of a function that runs instructions, on ``lanes`` samples at a time."""

    def __init__(self, lanes: int) -> None:
        super().__init__("double", lanes, host_cpu.host()[3])
        self.signs = ["", ""]  # signs of x and z of the present instruction, if it is one of ARITHMETIC
        self.forward = self.back = ""  # blocks of the jumps of REPEAT and AGAIN

    def word(self, index: int, kind: str = "i64") -> str:
        """A word of the context."""
        return self.load(kind, self.at("i64", "%context", index))

    def pair(self, table: str, index: str, kind: str = "i64") -> tuple[str, str]:
        """An entry of a table: an address or number, and a number."""
        at = self.byte(table, self.times(index, 16))
        return self.load(kind, at), self.load("i64", self.byte(at, 8))

    def loop(self, name: str, count: str | int, body: Callable[[str], None], step: int = 1) -> None:
        """Write a loop that runs ``body`` for the indices 0, step, ... below a count."""
        start, test, inside, again, done = (f"{name}.{x}" for x in ("start", "test", "inside", "again", "done"))
        self.jump(start, then=start)
        self.jump(test, then=test)
        self.do(f"%{name} = phi i64 [ 0, %{start} ], [ %{name}.next, %{again} ]")
        self.branch(self.put(f"icmp slt i64 %{name}, {count}"), inside, done, then=inside)
        body(f"%{name}")
        self.jump(again, then=again)
        self.do(f"%{name}.next = add i64 %{name}, {step}")
        self.jump(test, then=done)

    def least(self, a: str, b: str) -> str:
        """The smaller of two i64."""
        return self.put(f"select i1 {self.put(f'icmp slt i64 {a}, {b}')}, i64 {a}, i64 {b}")

    def fetch(self) -> tuple[str, str, Values]:
        """The opcode, the slot written and the slots read of the instruction at %pc."""
        first = self.load("i32", "%pc", 4)
        code = self.put(f"and i32 {first}, {(1 << CODE_BITS) - 1}")
        slots = [self.put(f"lshr i32 {first}, {CODE_BITS}")]
        slots += [self.load("i32", self.byte("%pc", 4 * k), 4) for k in (1, 2, 3)]
        to, *read = (self.put(f"zext i32 {slot} to i64") for slot in slots)
        return code, to, read

    def branches(self, opcode: str, end: str, write: Callable[[int, str], None]) -> None:
        """Write a switch by opcode; ``write(code, label)`` writes the branch of a code, and END jumps to ``end``.

        All of ARITHMETIC is one branch, ANY, before the switch: the processor predicts this branch, but not a jump by
        opcode in a long program. Without it long programs are far slower.
        """
        self.branch(self.put(f"icmp ult i32 {opcode}, {len(ARITHMETIC)}"), "fused", "other", then="fused")
        signs = self.at(f"[2 x {self.vector}]", "@signs", self.put(f"zext i32 {opcode} to i64"))
        self.signs[:] = (self.load_vector(signs, k) for k in range(2))
        write(ANY, "fused")
        self.label("other")
        branches = {code: number for code, number in opcodes().items() if code not in (*ARITHMETIC, END)}
        cases = " ".join(f"i32 {number}, label %op{number}" for number in branches.values())
        self.do(f"switch i32 {opcode}, label %{end} [ {cases} ]")
        for code, number in branches.items():
            self.label(f"op{number}")
            write(code, f"op{number}")

    def step(self, code: str) -> None:
        """Begin an instruction at %pc: at first ``code``, then the instructions that ``advance`` reaches."""
        self.jump("begin", then="begin")
        self.jump("step", then="step")
        self.do(f"%pc = phi ptr [ {code}, %begin ], [ %pc.next, %next ], [ %pc.far, %far ]")

    def repeat(self, some: str, slots: Values, block: str) -> None:
        """End REPEAT in ``block``: go to the next instruction if ``some`` holds, else jump forward."""
        self.do(f"%forward = mul i64 {slots[1]}, {INSTRUCTION}")
        self.do(f"br i1 {some}, label %next, label %far")
        self.forward = block

    def again(self, slots: Values, block: str) -> None:
        """End AGAIN in ``block``: jump back."""
        self.do(f"%back = mul i64 {slots[0]}, {-INSTRUCTION}")
        self.do("br label %far")
        self.back = block

    def advance(self) -> None:
        """Go to the next instruction, or to the one to which REPEAT or AGAIN jumps."""
        self.label("far")
        self.do(f"%distance = phi i64 [ %forward, %{self.forward} ], [ %back, %{self.back} ]")
        self.do("%pc.far = getelementptr i8, ptr %pc, i64 %distance")
        self.jump("step", then="next")
        self.do(f"%pc.next = getelementptr i8, ptr %pc, i64 {INSTRUCTION}")

    def flipped(self, value: str, sign: str) -> str:
        """A value with its sign flipped where ``sign`` is -0."""
        bits = [self.put(f"bitcast {self.vector} {x} to {self.bits}") for x in (value, sign)]
        return self.put(f"bitcast {self.bits} {self.put(f'xor {self.bits} {bits[0]}, {bits[1]}')} to {self.vector}")

    def results(self, code: int, given: Values) -> Values:
        """The values that an instruction writes; empty for a check."""
        if code == ANY:
            x, y, z = given
            return [self.fused(self.flipped(x, self.signs[0]), y, self.flipped(z, self.signs[1]))]
        if code in FORMS:
            return [FORMS[code].llvm(self, *given)]
        if code == CARRIED:
            return given
        if code == TURN:
            return list(self.sincos(given[0]))
        return [self.negative(given[0])] if code == NEGATE else []

    def holds(self, code: int, given: Values) -> str:
        """The mask of a check."""
        a, b, *_ = given
        if code == ABOVE:
            return self.compare("ogt", a, b)
        if code == WITHIN:
            return self.compare("ole", self.unary("fabs", a), b)
        total = ZERO
        for x in given:
            total = self.fused(x, ZERO, total)
        return self.compare("oeq", total, ZERO)

    def module(self, head: str) -> str:
        """The module of this function."""
        v, suffix, wide = self.vector, self.suffix(), 8 * self.size * self.lanes
        signs = [x for fused in ARITHMETIC.values() for x in (fused.minus_x, fused.minus_z)]
        table = ", ".join(f"{v} {self.constant(-0.0 if minus else 0.0)}" for minus in signs)
        vectors = f' alignstack=64 "prefer-vector-width"="{wide}" "min-legal-vector-width"="{wide}"'
        return f"""
@signs = internal constant [{len(signs)} x {v}] [{table}], align 64
declare {v} @llvm.fma.{suffix}({v}, {v}, {v})
declare {v} @llvm.fabs.{suffix}({v})
declare {v} @llvm.sqrt.{suffix}({v})
declare {v} @llvm.copysign.{suffix}({v}, {v})
attributes #0 = {{ nounwind{vectors if self.lanes > 1 else ""} }}
{self.function(head, " #0")}"""


def arity(code: int) -> int:
    """The number of slots that an instruction reads."""
    return (
        FORMS[code].arity
        if code in FORMS
        else {TURN: 1, NEGATE: 1, CARRIED: 1, REPEAT: 1, AGAIN: 0, ANY: 3, FINITE: 3}.get(code, 2)
    )


def one_text() -> str:
    """``interpret_one(context, inputs, outputs) -> 1``, or 0 if the sample is rejected; then no output is written.

    context  WORDS words, of which CONSTANTS is not read
    inputs   addresses of the input arrays
    outputs  addresses of the output arrays, written when all inputs have been read
    """
    t = _Text(1)
    t.label("entry")
    code, values, inputs, outputs = (t.word(index, "ptr") for index in (CODE, VALUES, INPUTS, OUTPUTS))

    def read(k: str) -> None:
        first, columns = t.pair(inputs, k)
        source, target = t.load("ptr", t.at("ptr", "%inputs", k)), t.number(values, first)
        t.loop("column", columns, lambda i: t.store("i64", t.load("i64", t.number(source, i)), t.number(target, i)))

    t.loop("input", t.word(INPUT_COUNT), read)
    t.step(code)
    opcode, to, slots = t.fetch()

    def write(code: int, label: str) -> None:
        given = [t.load(t.vector, t.number(values, slot), 8) for slot in slots[: arity(code)]]
        if code == REPEAT:
            t.repeat(t.put(f"extractelement {t.truth} {t.above_zero(given[0])}, i64 0"), slots, label)
            return
        if code == AGAIN:
            t.again(slots, label)
            return
        made = t.results(code, given)
        for value, place in zip(made, (to, slots[1]), strict=False):
            t.store(t.vector, value, t.number(values, place), 8)
        if made:
            t.do("br label %next")
        else:
            valid = t.put(f"extractelement {t.truth} {t.holds(code, given)}, i64 0")
            t.do(f"br i1 {valid}, label %next, label %rejected")

    t.branches(opcode, "results", write)
    t.advance()
    t.jump("step", then="rejected")
    t.do("ret i64 0")
    t.label("results")

    def give(k: str) -> None:
        entries, columns = t.pair(outputs, k, "ptr")
        target = t.load("ptr", t.at("ptr", "%outputs", k))

        def copy(i: str) -> None:
            entry = t.load("i64", t.at("i64", entries, i))
            sign, slot = t.put(f"and i64 {entry}, {-int(SIGN)}"), t.put(f"and i64 {entry}, {int(SIGN) - 1}")
            bits = t.put(f"xor i64 {t.load('i64', t.number(values, slot))}, {sign}")
            t.store("i64", bits, t.number(target, i))

        t.loop("result", columns, copy)

    t.loop("output", t.word(OUTPUT_COUNT), give)
    t.do("ret i64 1")
    return t.module("define i64 @interpret_one(ptr %context, ptr %inputs, ptr %outputs)")


def _samples(t: _Text, last: str, data: str, step: str, group: str) -> Values:
    """The addresses of ``lanes`` samples from sample ``group`` of the tile on; ``last`` is the last sample of all."""
    base = t.add("%first", group)
    return [t.byte(data, t.times(t.least(t.add(base, r), last), step)) for r in range(t.lanes)]


def _blocks(t: _Text, name: str, columns: str, whole: Callable[[str], None], single: Callable[[str], None]) -> None:
    """Run ``whole`` at the first column of each block of ``lanes`` columns, of which the last may overlap the others.

    If there are fewer columns than lanes, run ``single`` for each column.
    """
    few = t.put(f"icmp slt i64 {columns}, {t.lanes}")
    end = t.put(f"sub i64 {columns}, {t.lanes}")
    t.branch(few, f"{name}.few", f"{name}.many", then=f"{name}.few")
    t.loop(f"{name}.one", columns, single)
    t.jump(f"{name}.end", then=f"{name}.many")
    t.loop(f"{name}.block", columns, lambda c: whole(t.least(c, end)), t.lanes)
    t.jump(f"{name}.end", then=f"{name}.end")


def _repeat_text(t: _Text, slots: list[str], source: str, label: str) -> None:
    """Write the instruction that runs a region again if ``source`` is above 0 in a sample of the tile."""
    t.jump(f"{label}.loop", then=f"{label}.loop")
    t.do(f"%{label}.i = phi i64 [ 0, %{label} ], [ %{label}.i.next, %{label}.loop ]")
    t.do(f"%{label}.some = phi {t.truth} [ {ZERO}, %{label} ], [ %{label}.more, %{label}.loop ]")
    here = t.load(t.vector, t.number(source, f"%{label}.i"), 8 * t.lanes)
    t.do(f"%{label}.more = or {t.truth} %{label}.some, {t.above_zero(here)}")
    t.do(f"%{label}.i.next = add i64 %{label}.i, {t.lanes}")
    more = t.put(f"icmp slt i64 %{label}.i.next, %wide")
    t.branch(more, f"{label}.loop", f"{label}.end", then=f"{label}.end")
    runs = t.put(f"bitcast {t.truth} %{label}.more to i{t.lanes}")
    t.repeat(t.put(f"icmp ne i{t.lanes} {runs}, 0"), slots, f"{label}.end")


class _Tiles(_Text):
    """The body of ``interpret_tiles``: see ``tiles_text``."""

    def __init__(self, lanes: int) -> None:
        """The begin of the function: what all tiles share."""
        super().__init__(lanes)
        self.wide_bytes = 8 * lanes
        self.label("entry")
        self.code, self.constants, self.inputs, self.outputs = (
            self.word(index, "ptr") for index in (CODE, CONSTANTS, INPUTS, OUTPUTS)
        )
        self.constant_count, self.input_count, self.output_count = (
            self.word(index) for index in (CONSTANT_COUNT, INPUT_COUNT, OUTPUT_COUNT)
        )
        self.row = self.times("%wide", 8)
        self.poison, self.first_row = "%rows", self.byte("%rows", self.row)
        self.last = self.put("sub i64 %n, 1")

    def place(self, slot: str) -> tuple[str, str]:
        """The address of a slot's first vector, and the bytes to its next vector: 0 for a constant."""
        constant = self.put(f"icmp slt i64 {slot}, {self.constant_count}")
        here = self.byte(self.constants, self.times(slot, self.wide_bytes))
        behind = self.put(f"sub i64 {slot}, {self.constant_count}")
        there = self.byte(self.first_row, self.times(behind, self.row))
        step = self.put(f"select i1 {constant}, i64 0, i64 {self.wide_bytes}")
        return self.put(f"select i1 {constant}, ptr {here}, ptr {there}"), step

    def clear(self, i: str) -> None:
        """Begin with samples that no check rejects."""
        self.store(self.vector, self.constant(0.0), self.number(self.poison, i), self.wide_bytes)

    def read(self, k: str) -> None:
        """Copy an input to its slots."""
        first, columns = self.pair(self.inputs, k)
        data = self.load("ptr", self.byte(self.load("ptr", self.at("ptr", "%inputs", k)), DATA_OFFSET))
        step = self.load("i64", self.at("i64", "%steps", k))
        behind = self.put(f"sub i64 {first}, {self.constant_count}")
        target = self.byte(self.first_row, self.times(behind, self.row))

        def group(g: str) -> None:
            starts = _samples(self, self.last, data, step, g)

            def whole(c: str) -> None:
                loaded = [self.load(self.vector, self.number(x, c), 8) for x in starts]
                to = self.number(self.byte(target, self.times(c, self.row)), g)
                for i, x in enumerate(self.transposed(loaded)):
                    self.store(self.vector, x, self.byte(to, self.times(self.row, i)), self.wide_bytes)

            def single(c: str) -> None:
                to = self.number(self.byte(target, self.times(c, self.row)), g)
                for r, x in enumerate(starts):
                    self.store("double", self.load("double", self.number(x, c), 8), self.number(to, r), 8)

            _blocks(self, "read", columns, whole, single)

        self.loop("read.group", "%wide", group, self.lanes)

    def compute(self, code: int, label: str, sources: list[tuple[str, str]], targets: Values) -> None:
        """Write the branch of an instruction that computes slots, or checks one."""
        vector = self.wide_bytes
        used = sources[: arity(code)]
        self.jump(f"{label}.loop", then=f"{label}.loop")
        self.do(f"%{label}.i = phi i64 [ 0, %{label} ], [ %{label}.i.next, %{label}.loop ]")
        at = []
        for k, (start, _) in enumerate(used):
            self.do(f"%{label}.{k} = phi ptr [ {start}, %{label} ], [ %{label}.{k}.{UNROLLED}, %{label}.loop ]")
            at.append(f"%{label}.{k}")
        for u in range(UNROLLED):
            given = [self.load(self.vector, x, vector) for x in at]
            at = [f"%{label}.{k}.{u + 1}" for k in range(len(used))]
            here = self.add(f"%{label}.i", u * self.lanes)
            made = self.results(code, given)
            for value, target in zip(made, targets, strict=False):
                self.store(self.vector, value, self.number(target, here), vector)
            if not made:
                so_far = self.number(self.poison, here)
                kept = self.poisoned_unless(self.holds(code, given), self.load(self.vector, so_far, vector))
                self.store(self.vector, kept, so_far, vector)
            for k, (_, step) in enumerate(used):
                before = f"%{label}.{k}" + (f".{u}" if u else "")
                self.do(f"{at[k]} = getelementptr i8, ptr {before}, i64 {step}")
        self.do(f"%{label}.i.next = add i64 %{label}.i, {UNROLLED * self.lanes}")
        more = self.put(f"icmp slt i64 %{label}.i.next, %wide")
        self.do(f"br i1 {more}, label %{label}.loop, label %next")

    def result(self, entries: str, c: str, group: str) -> str:
        """Column ``c`` of a result, with its sign, in samples from ``group`` on."""
        entry = self.load("i64", self.at("i64", entries, c))
        start, step = self.place(self.put(f"and i64 {entry}, {int(SIGN) - 1}"))
        behind = self.times(group, self.put(f"udiv i64 {step}, {self.lanes}"))
        value = self.load(self.vector, self.byte(start, behind), self.wide_bytes)
        sign = self.put(f"and i64 {entry}, {-int(SIGN)}")
        one = self.put(f"insertelement {self.bits} zeroinitializer, i64 {sign}, i64 0")
        signs = self.put(f"shufflevector {self.bits} {one}, {self.bits} {one}, <{self.lanes} x i32> zeroinitializer")
        flipped = self.put(f"xor {self.bits} {self.put(f'bitcast {self.vector} {value} to {self.bits}')}, {signs}")
        return self.put(f"bitcast {self.bits} {flipped} to {self.vector}")

    def give(self, k: str) -> None:
        """Copy slots to an output."""
        entries, columns = self.pair(self.outputs, k, "ptr")
        data = self.load("ptr", self.byte(self.load("ptr", self.at("ptr", "%outputs", k)), DATA_OFFSET))
        width = self.times(columns, 8)

        def group(g: str) -> None:
            starts = _samples(self, self.last, data, width, g)

            def whole(c: str) -> None:
                made = self.transposed([self.result(entries, self.add(c, i), g) for i in range(self.lanes)])
                for x, start in zip(made, starts, strict=True):
                    self.store(self.vector, x, self.number(start, c), 8)

            def single(c: str) -> None:
                made = self.result(entries, c, g)
                for r, start in enumerate(starts):
                    value = self.put(f"extractelement {self.vector} {made}, i64 {r}")
                    self.store("double", value, self.number(start, c), 8)

            _blocks(self, "give", columns, whole, single)

        self.loop("give.group", "%wide", group, self.lanes)

    def write_bits(self, i: str) -> None:
        """Write the bits of BITS samples: whether all checks of a sample hold."""
        number = "0"
        for part in range(0, BITS, self.lanes):
            value = self.load(self.vector, self.number(self.poison, self.add(i, part)), self.wide_bytes)
            valid = self.put(f"bitcast {self.truth} {self.compare('oeq', value, ZERO)} to i{self.lanes}")
            valid = self.put(f"zext i{self.lanes} {valid} to i{BITS}") if self.lanes < BITS else valid
            number = self.put(f"or i{BITS} {number}, {self.put(f'shl i{BITS} {valid}, {part}')}")
        at = self.put(f"udiv i64 {self.add('%first', i)}, {BITS}")
        self.store(f"i{BITS}", number, self.at(f"i{BITS}", "%bits", at), 2)


def tiles_text(lanes: int) -> str:
    """``interpret_tiles(context, inputs, steps, outputs, bits, rows, wide, n)``, for tiles of ``wide`` samples.

    context  WORDS words, of which VALUES is not read
    inputs   array objects, in C order
    steps    for each input the bytes from a sample to the next: 0 for an input that all samples share
    outputs  array objects, in C order
    bits     a bit for each sample, BITS in a number; bits of the last tile are repeated to its end
    rows     workspace, aligned to a vector: a tile of each slot other than constants, and one more
    wide     multiple of BITS
    n        samples; the last tile is filled with the last of them
    """
    t = _Tiles(lanes)
    t.jump("tiles", then="tiles")
    t.do("%first = phi i64 [ 0, %entry ], [ %first.next, %tile.end ]")
    t.branch(t.put("icmp slt i64 %first, %n"), "tile", "done", then="tile")
    t.loop("clear", "%wide", t.clear, lanes)
    t.loop("input", t.input_count, t.read)
    t.step(t.code)
    opcode, to, slots = t.fetch()
    targets = [t.place(to)[0], t.place(slots[1])[0]]
    sources = [t.place(slot) for slot in slots]

    def write(code: int, label: str) -> None:
        if code == AGAIN:
            t.again(slots, label)
        elif code == REPEAT:
            _repeat_text(t, slots, sources[0][0], label)
        else:
            t.compute(code, label, sources, targets)

    t.branches(opcode, "results", write)
    t.advance()
    t.jump("step", then="results")
    t.loop("output", t.output_count, t.give)
    t.loop("bit", "%wide", t.write_bits, BITS)
    t.jump("tile.end", then="tile.end")
    t.do("%first.next = add i64 %first, %wide")
    t.jump("tiles", then="done")
    t.do("ret void")
    given = "ptr %context, ptr %inputs, ptr %steps, ptr %outputs, ptr %bits, ptr %rows, i64 %wide, i64 %n"
    return t.module(f"define void @interpret_tiles({given})")

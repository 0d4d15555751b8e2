"""The builtin's results: new arrays, numbers and objects, and how they are returned."""

from __future__ import annotations

from collections.abc import Callable

from ... import object_layout as layout
from .call_arguments import ArgumentText
from .call_words import ARRAY_WORDS, AXES, FLOAT, ONE, PARTS, PLACED, SEVERAL, TRUTH, VALUE


class ResultText(ArgumentText):
    """Makes results; ``answers`` are those of the phi of what is returned."""

    def take_out(self) -> None:
        """Take the array that is given for the result, if there is one; it may overlap no input."""
        self.amount, self.several = self.plan("outputs"), self.plan("several")
        self.branch(self.equal(self.bits("%given", self.form("out")), 0), "new", "given_out", then="given_out")
        self.need(self.equal(self.several, ONE))
        last = self.put(f"sub i64 {self.count}, 1")  # out is the last parameter
        target = self.load("ptr", self.at("ptr", "%values", last))
        rank = self.word(self.shapes, 0)
        self.need(self.put(f"icmp ult i64 {rank}, {FLOAT}"))
        self.is_array(target, rank, layout.CONTIGUOUS | layout.ALIGNED | layout.WRITEABLE)
        self.same_shape(target, self.shapes, rank, "out")
        begin = self.pointer(target, layout.DATA)
        end, before = self.byte(begin, self.word(self.shapes, 1)), self.block
        self.jump("overlaps", then="overlaps")
        self.do(f"%o = phi i64 [ 0, {before} ], [ %o.next, %apart ]")
        self.branch(self.equal("%o", "%m"), "apart.end", "overlap", then="overlap")
        input_begin, input_end = (self.load("ptr", self.at("ptr", x, "%o")) for x in (self.inputs, self.sizes))
        ends_before = self.put(f"icmp ule ptr {input_end}, {begin}")
        apart = self.either(ends_before, self.put(f"icmp ule ptr {end}, {input_begin}"))
        self.branch(apart, "apart", "python", then="apart")
        self.do("%o.next = add i64 %o, 1")
        self.jump("overlaps", then="apart.end")
        self.store("ptr", begin, self.outputs)
        self.store("ptr", target, self.results)
        self.do(f"call void {self.process('up')}(ptr {target})")
        self.jump("run", then="new")

    def allocate_results(self) -> None:
        """Make a new array for each result that is one, or True for numbers at an address."""
        self.do("%r = phi i64 [ 0, %results ], [ %r.next, %made ]")
        self.branch(self.equal("%r", self.amount), "run", "make", then="make")
        shape = self.at("i64", self.shapes, self.times("%r", ARRAY_WORDS))
        kind = self.word(shape, 0)
        is_array = self.equal(self.bits(kind, FLOAT | PLACED | TRUTH), 0)
        self.branch(is_array, "make_array", "make_other", then="make_other")
        cell = self.at("double", self.number, "%r")
        self.branch(self.equal(self.bits(kind, PLACED), 0), "made", "make_place", then="make_place")
        fixed, true = self.pointer(shape, ARRAY_WORDS - 1), self.process("true")
        self.do(f"call void {self.process('up')}(ptr {true})")
        self.jump("made", then="make_array")
        # if there is no memory, arrays made before are lost
        array = self.new_array(self.put(f"trunc i64 {self.bits(kind, AXES)} to i32"), self.at("i64", shape, 2))
        fresh = self.pointer(array, layout.DATA)
        self.jump("make_array.end", then="make_array.end")
        self.jump("made", then="made")
        self.do(f"%to = phi ptr [ {cell}, %make_other ], [ {fixed}, %make_place ], [ {fresh}, %make_array.end ]")
        self.do(f"%result = phi ptr [ null, %make_other ], [ {true}, %make_place ], [ {array}, %make_array.end ]")
        self.store("ptr", "%to", self.at("ptr", self.outputs, "%r"))
        self.store("ptr", "%result", self.at("ptr", self.results, "%r"))
        self.do("%r.next = add i64 %r, 1")
        self.jump("new", then="run")

    def new_array(self, rank: str, extents: str) -> str:
        """A new array of float64."""
        passed = f"ptr {self.ndarray}, i32 {rank}, ptr {extents}, i32 {layout.DOUBLE}"
        array = self.put(f"call ptr {self.process('new_array')}({passed}, ptr null, ptr null, i32 0, i32 0, ptr null)")
        self.need(self.put(f"icmp ne ptr {array}, null"), "failed")
        return array

    def box_results(self) -> None:
        """Make the object of each result that is not the array itself."""
        self.do("%b = phi i64 [ 0, %valid ], [ 0, %stamped ], [ %b.next, %boxed ]")
        self.branch(self.equal("%b", self.amount), "answered", "box", then="box")
        at, shape = self.at("ptr", self.results, "%b"), self.at("i64", self.shapes, self.times("%b", ARRAY_WORDS))
        inner = self.load("ptr", at)
        self.branch(self.equal(inner, "null", "ptr"), "boxing", "wrap", then="wrap")
        self._box_array(inner, shape, at)
        found = self.load("double", self.at("double", self.number, "%b"))
        self.branch(self.equal(self.word(shape, 0), TRUTH), "judging", "real", then="judging")
        true, false = self.process("true"), self.process("false")
        judged = self.put(f"select i1 {self.put(f'fcmp une double {found}, 0.0')}, ptr {true}, ptr {false}")
        self.do(f"call void {self.process('up')}(ptr {judged})")
        self.store("ptr", judged, at)
        self.jump("boxed", then="real")
        boxed = self.put(f"call ptr {self.process('new_float')}(double {found})")
        self.store("ptr", boxed, at)
        self.branch(self.put(f"icmp ne ptr {boxed}, null"), "boxed", "failed", then="boxed")
        self.do("%b.next = add i64 %b, 1")
        self.jump("answers", then="answered")

    def _box_array(self, inner: str, shape: str, at: str) -> None:
        """Make the object that owns an array, if the result is one."""
        self.branch(self.equal(self.bits(self.word(shape, 0), VALUE), 0), "boxed", "wrapping", then="wrapping")
        owner = self.put(f"call ptr {self.process('allocate')}(ptr {self.pointer(shape, 4)}, i64 0)")
        self.need(self.put(f"icmp ne ptr {owner}, null"), "failed")
        self.store("ptr", inner, self.byte(owner, self.word(shape, 5)))
        self.store("ptr", owner, at)
        self.jump("boxed", then="boxing")

    def return_results(self) -> None:
        """Return one result, a tuple of them, or a tuple of the parts of the first."""
        cases = f"i64 {SEVERAL}, label %tuple i64 {PARTS}, label %parts"
        self.do(f"switch i64 {self.several}, label %one [ {cases} ]")
        self.label("one")
        self._answer(self.load("ptr", self.results))
        self.label("tuple")
        self.return_tuple(self.amount, "t", lambda k: self.load("ptr", self.at("ptr", self.results, k)))
        self.label("parts")
        self.do(f"call void {self.process('down')}(ptr {self.load('ptr', self.results)})")  # True
        size, parts = self.word(self.shapes, 1), self.word(self.shapes, 2)
        share = self.put(f"udiv i64 {size}, {parts}")

        def part(k: str) -> str:
            new = self.new_array("2", self.at("i64", self.shapes, 3))
            begin = self.byte(self.load("ptr", self.outputs), self.times(share, k))
            self.move(self.pointer(new, layout.DATA), begin, share)
            return new

        self.return_tuple(parts, "s", part)
        self.label("failed")
        self.release()
        self.do("ret ptr null")

    def return_tuple(self, amount: str, k: str, item: Callable[[str], str]) -> None:
        """Return a new tuple of so many items."""
        made = self.put(f"call ptr {self.process('new_tuple')}(i64 {amount})")
        self.need(self.put(f"icmp ne ptr {made}, null"), "failed")
        items, before = self.at("i64", made, layout.ITEMS), self.block
        self.jump(f"filling.{k}", then=f"filling.{k}")
        self.do(f"%{k} = phi i64 [ 0, {before} ], [ %{k}.next, %fill.{k}.end ]")
        self.branch(self.equal(f"%{k}", amount), f"filled.{k}", f"fill.{k}", then=f"fill.{k}")
        self.store("ptr", item(f"%{k}"), self.at("ptr", items, f"%{k}"))
        self.jump(f"fill.{k}.end", then=f"fill.{k}.end")
        self.do(f"%{k}.next = add i64 %{k}, 1")
        self.jump(f"filling.{k}", then=f"filled.{k}")
        self._answer(made)

    def _answer(self, result: str) -> None:
        """Go to the end with a result."""
        self.answers.append(f"[ {result}, {self.block} ]")
        self.jump("answer", then=f"unused{len(self.answers)}")
        self.do("unreachable")

"""The builtin's arguments: which parameter has which, and where the numbers of each input are."""

from __future__ import annotations

from ... import object_layout as layout
from .call_words import (
    ARRAY_WORDS,
    AXES,
    CHOICE,
    EITHER,
    FLOAT,
    INDEX,
    MOST_OUTPUTS,
    NOTHING,
    PAIRS,
    PLACED,
    CallWriter,
)  # fmt: skip

MOST_GATHERED = 1 << 14  # bytes of an array whose numbers are apart


class ArgumentText(CallWriter):
    """Reads arguments. If the first result is written in place, ``in_place`` is its bytes, from ``written`` on."""

    written: str
    written_end: str
    in_place: str

    def collect_arguments(self) -> None:
        """Find the argument of each parameter: ``%values`` and ``%given``."""
        model_type = self.put(f"inttoptr i64 {self.form('model_type')} to ptr")
        self.no_model, self.model_type = self.equal(model_type, "null", "ptr"), model_type
        skip = self.form("before")
        positional = self.put(f"sub i64 %n, {skip}")
        self.need(self.put(f"icmp ule i64 {positional}, {self.count}"))  # unsigned: not negative either
        first, required = self.at("ptr", "%args", skip), self.form("required")
        every = self.add(self.one_bit(self.count), -1)
        all_given = self.both(self.equal("%names", "null", "ptr"), self.equal(positional, self.count))
        direct = self.both(all_given, self.equal(required, every))
        begin = self.block
        self.branch(direct, "collected", "by_position", then="by_position")  # no copy; a None is refused by its kind
        self._by_position(first, positional, begin)
        self._by_keyword(first, positional)
        self.do(f"%values = phi ptr [ {first}, {begin} ], [ {self.stack}, %keywords ], [ {self.stack}, %by_keyword ]")
        self.do(f"%every = phi i64 [ {every}, {begin} ], [ %given.i, %keywords ], [ %given.j, %by_keyword ]")
        self.need(self.equal(self.bits("%every", required), required))
        self._switch()

    def _switch(self) -> None:
        """``%given``: the bits of the arguments, without that of a switch that is off."""
        switch, before = self.switch, self.block
        self.branch(self.put(f"icmp slt i64 {switch}, 0"), "switched", "switch", then="switch")
        bit = self.one_bit(switch)
        self.branch(self.equal(self.bits("%every", bit), 0), "switched", "switching", then="switching")
        value = self.put(f"ptrtoint ptr {self.load('ptr', self.at('ptr', '%values', switch))} to i64")
        off, on = (self.equal(value, self.form(x)) for x in ("off", "on"))
        self.need(self.either(off, on))
        cleared, last = self.put(f"xor i64 %every, {self.put(f'select i1 {off}, i64 {bit}, i64 0')}"), self.block
        self.jump("switched", then="switched")
        self.do(f"%given = phi i64 [ %every, {before} ], [ %every, %switch ], [ {cleared}, {last} ]")

    def _given_bit(self, value: str, k: str) -> str:
        """Bit k if a value is given: not None, or any in a form with ``nones``."""
        nones = self.put(f"icmp ne i64 {self.form('nones')}, 0")
        there = self.either(self.put(f"icmp ne ptr {value}, {self.none}"), nones)
        return self.put(f"shl i64 {self.put(f'zext i1 {there} to i64')}, {k}")

    def _by_position(self, first: str, positional: str, before: str) -> None:
        self.do(f"%i = phi i64 [ 0, {before} ], [ %i.next, %take ]")
        self.do(f"%given.i = phi i64 [ 0, {before} ], [ %given.next, %take ]")
        self.branch(self.equal("%i", positional), "keywords", "take", then="take")
        value = self.load("ptr", self.at("ptr", first, "%i"))
        self.store("ptr", value, self.at("ptr", self.stack, "%i"))
        self.do(f"%given.next = or i64 %given.i, {self._given_bit(value, '%i')}")
        self.do("%i.next = add i64 %i, 1")
        self.jump("by_position", then="keywords")

    def _by_keyword(self, first: str, positional: str) -> None:
        passed = self.put(f"sub i64 {self.one_bit(positional)}, 1")
        self.branch(self.equal("%names", "null", "ptr"), "collected", "named", then="named")
        keywords, behind = self.word("%names", layout.LENGTH), self.at("ptr", first, positional)
        self.jump("by_keyword", then="by_keyword")
        self.do("%j = phi i64 [ 0, %named ], [ %j.next, %found ]")
        self.do(f"%passed.j = phi i64 [ {passed}, %named ], [ %passed.next, %found ]")
        self.do("%given.j = phi i64 [ %given.i, %named ], [ %given.more, %found ]")
        self.branch(self.equal("%j", keywords), "collected", "search", then="search")
        name = self.pointer("%names", self.add("%j", layout.ITEMS))
        self.jump("compare", then="compare")
        self.do("%k = phi i64 [ 0, %search ], [ %k.next, %other ]")
        self.branch(self.equal("%k", self.count), "python", "same", then="same")
        wanted = self.pointer("%form", self.add(self.times("%k", 2), PAIRS))
        self.branch(self.equal(name, wanted, "ptr"), "match", "other", then="other")
        self.do("%k.next = add i64 %k, 1")
        self.jump("compare", then="match")
        self.branch(self.equal(self.bits("%passed.j", self.one_bit("%k")), 0), "found", "python", then="found")
        value = self.load("ptr", self.at("ptr", behind, "%j"))
        self.store("ptr", value, self.at("ptr", self.stack, "%k"))
        self.do(f"%given.more = or i64 %given.j, {self._given_bit(value, '%k')}")
        self.do(f"%passed.next = or i64 %passed.j, {self.one_bit('%k')}")
        self.do("%j.next = add i64 %j, 1")
        self.jump("by_keyword", then="collected")

    def unbox_arguments(self) -> None:
        """Find the numbers of each input, by its kind."""
        size = self.word(self.shapes, 1)
        placed = self.equal(self.bits(self.word(self.shapes, 0), PLACED), 0)
        self.in_place = self.put(f"select i1 {placed}, i64 0, i64 {size}")
        self.written = self.pointer(self.shapes, ARRAY_WORDS - 1)
        self.written_end = self.byte(self.written, self.in_place)
        before = self.block
        self.jump("arguments", then="arguments")
        self.do(f"%p = phi i64 [ 0, {before} ], [ %p.next, %next ]")
        self.do(f"%m = phi i64 [ 0, {before} ], [ %m.next, %next ]")
        self.branch(self.equal("%p", self.count), "results", "argument", then="argument")
        shape = self.at("i64", self.shapes, self.times(self.add("%p", MOST_OUTPUTS), ARRAY_WORDS))
        kind, extent = self.word(shape, 0), self.at("i64", shape, 2)
        fixed = self.pointer(shape, ARRAY_WORDS - 1)
        there = self.put(f"icmp ne i64 {self.bits('%given', self.one_bit('%p'))}, 0")
        is_array = self.put(f"icmp ult i64 {kind}, {FLOAT}")
        self.branch(self.both(there, is_array), "passed", "special", then="special")
        self.branch(self.equal(self.bits(kind, PLACED), 0), "unplaced", "input.end", then="unplaced")
        self.branch(self.both(there, self.equal(self.bits(kind, NOTHING), 0)), "input", "next", then="input")
        value, cell = self.load("ptr", self.at("ptr", "%values", "%p")), self.at("ptr", self.cells, "%p")
        value_type = self.pointer(value, layout.TYPE)
        cases = ((FLOAT, "number"), (INDEX, "index"), (CHOICE, "choice"))
        listed = " ".join(f"i64 {k}, label %{to}" for k, to in cases)
        self.do(f"switch i64 {kind}, label %object [ {listed} ]")
        number = self._unbox_float(value, value_type)
        self._unbox_index(value, value_type, extent, cell)
        self._unbox_choice(value, extent, cell)
        self._unbox_object(value, value_type, kind, extent)
        data = self._unbox_array(kind, shape)
        sources = ((fixed, "special"), (number, "number.end"), (cell, "index.end"), (cell, "choice.end"),
                   (data, "array.whole"), ("%gathered", "gathered.end"))  # fmt: skip
        self.do("%data = phi ptr " + ", ".join(f"[ {x}, %{block} ]" for x, block in sources))
        self.store("ptr", "%data", self.at("ptr", self.inputs, "%m"))
        self.store("ptr", self.byte("%data", self.word(shape, 1)), self.at("ptr", self.sizes, "%m"))
        more = self.add("%m", 1)
        self.jump("next", then="next")
        self.do(f"%m.next = phi i64 [ %m, %unplaced ], [ {more}, %input.end ]")
        self.do("%p.next = add i64 %p, 1")
        self.jump("arguments", then="results")

    def _unbox_float(self, value: str, value_type: str) -> str:
        """The address of the number of a float."""
        self.label("number")
        real, real64 = (self.equal(value_type, self.process(x), "ptr") for x in ("real", "real64"))
        self.need(self.either(real, real64))
        data = self.at("i64", value, layout.REAL)
        self.jump("number.end", then="number.end")
        self.jump("input.end", then="index")
        return data

    def _unbox_index(self, value: str, value_type: str, extent: str, cell: str) -> None:
        """Write an int in range to a cell."""
        self.need(self.equal(value_type, self.process("integer"), "ptr"))
        place = self.put(f"call i64 {self.process('as_size')}(ptr {value})")
        wrong = self.equal(place, -1)  # -1, or an overflow with its error
        self.branch(wrong, "index.wrong", "index.known", then="index.wrong")
        self.do(f"call void {self.process('forget')}()")
        self.jump("python", then="index.known")
        self.need(self.put(f"icmp ult i64 {place}, {self.word(extent, 0)}"))
        self.store("i64", place, cell)
        self.jump("index.end", then="index.end")
        self.jump("input.end", then="choice")

    def _unbox_choice(self, value: str, extent: str, cell: str) -> None:
        """Write the place of an object among four to a cell."""
        chosen = "-1"
        for k in reversed(range(ARRAY_WORDS - 2)):
            chosen = self.put(f"select i1 {self.equal(value, self.pointer(extent, k), 'ptr')}, i64 {k}, i64 {chosen}")
        self.need(self.put(f"icmp sge i64 {chosen}, 0"))
        self.store("i64", chosen, cell)
        self.jump("choice.end", then="choice.end")
        self.jump("input.end", then="object")

    def _unbox_object(self, value: str, value_type: str, kind: str, extent: str) -> None:
        """Go to ``array`` with the array that an object owns, or with the argument itself: ``%value``."""
        self.branch(self.equal(value_type, self.pointer(extent, 2), "ptr"), "opened", "unopened", then="unopened")
        self.branch(self.equal(self.bits(kind, EITHER), 0), "python", "object.end", then="opened")
        inner = self.load("ptr", self.byte(value, self.word(extent, 3)))
        self.branch(self.put(f"icmp ne ptr {inner}, null"), "object.end", "python", then="object.end")
        self.do(f"%inner = phi ptr [ {value}, %unopened ], [ {inner}, %opened ]")
        self.jump("array", then="passed")
        outer = self.load("ptr", self.at("ptr", "%values", "%p"))
        self.jump("array", then="array")
        self.do(f"%value = phi ptr [ %inner, %object.end ], [ {outer}, %passed ]")

    def _unbox_array(self, kind: str, shape: str) -> str:
        """The address of the numbers of ``%value``, gathered if apart, or if the result is written over them."""
        rank = self.bits(kind, AXES)
        self.is_array("%value", rank, layout.ALIGNED)
        data = self.pointer("%value", layout.DATA)
        self.same_shape("%value", shape, rank, "in")
        flags = self.bits(self.word("%value", layout.FLAGS), layout.CONTIGUOUS)
        before = self.put(f"icmp ule ptr {self.byte(data, self.word(shape, 1))}, {self.written}")
        behind = self.either(self.put(f"icmp ule ptr {self.written_end}, {data}"), self.equal(self.in_place, 0))
        whole = self.both(self.put(f"icmp ne i64 {flags}, 0"), self.either(before, behind))
        self.jump("array.whole", then="array.whole")
        self.branch(whole, "input.end", "scattered", then="scattered")
        self._gather("%value", rank, self.word(shape, 1))
        self.jump("input.end", then="input.end")
        return data

    def is_array(self, value: str, rank: str, flags: int) -> None:
        """Go on if an object is an array of float64 of this rank with these flags."""
        self.need(self.equal(self.pointer(value, layout.TYPE), self.ndarray, "ptr"))
        kind = self.word(self.pointer(value, layout.DTYPE), layout.KIND)
        self.need(self.equal(self.bits(kind, layout.SAME), self.float64))
        right = self.equal(self.bits(self.word(value, layout.RANK), 0xFFFFFFFF), rank)
        self.need(self.both(right, self.equal(self.bits(self.word(value, layout.FLAGS), flags), flags)))

    def same_shape(self, value: str, shape: str, rank: str, label: str) -> None:
        """Go on if an array of that rank has that shape."""
        sizes, before = self.pointer(value, layout.SHAPE), self.block
        self.jump(f"{label}.axis", then=f"{label}.axis")
        self.do(f"%{label}.a = phi i64 [ 0, {before} ], [ %{label}.a.next, %{label}.fits ]")
        self.branch(self.equal(f"%{label}.a", rank), f"{label}.end", f"{label}.size", then=f"{label}.size")
        fits = self.equal(self.word(sizes, f"%{label}.a"), self.word(shape, self.add(f"%{label}.a", 2)))
        self.branch(fits, f"{label}.fits", "python", then=f"{label}.fits")
        self.do(f"%{label}.a.next = add i64 %{label}.a, 1")
        self.jump(f"{label}.axis", then=f"{label}.end")

    def _gather(self, value: str, rank: str, amount: str) -> None:
        """Copy the numbers of an array of one or two axes to the stack, at ``%gathered``."""
        small = self.put(f"icmp ule i64 {amount}, {MOST_GATHERED}")
        self.need(self.both(small, self.put(f"icmp ule i64 {self.add(rank, -1)}, 1")))
        room = self.put(f"alloca i8, i64 {amount}, align 8")
        data, shape, strides = (self.pointer(value, k) for k in (layout.DATA, layout.SHAPE, layout.STRIDES))
        before = self.block
        self.branch(self.equal(rank, 1), "of_vector", "of_matrix", then="of_matrix")
        rows, row_stride = self.word(shape, 0), self.word(strides, 0)
        self.jump("of_vector", then="of_vector")
        self.do(f"%rows = phi i64 [ 1, {before} ], [ {rows}, %of_matrix ]")
        self.do(f"%row.stride = phi i64 [ 0, {before} ], [ {row_stride}, %of_matrix ]")
        last = self.add(rank, -1)
        columns, stride = self.word(shape, last), self.word(strides, last)
        before = self.block
        self.jump("gather.row", then="gather.row")
        self.do(f"%x = phi i64 [ 0, {before} ], [ %x.next, %gather.next ]")
        self.do(f"%to.row = phi ptr [ {room}, {before} ], [ %to.x, %gather.next ]")
        self.branch(self.equal("%x", "%rows"), "gathered.all", "gather.begin", then="gather.begin")
        start = self.byte(data, self.times("%x", "%row.stride"))
        self.jump("gather.column", then="gather.column")
        self.do("%y = phi i64 [ 0, %gather.begin ], [ %y.next, %gather.one ]")
        self.do("%to.x = phi ptr [ %to.row, %gather.begin ], [ %to.next, %gather.one ]")
        self.branch(self.equal("%y", columns), "gather.next", "gather.one", then="gather.one")
        self.store("double", self.load("double", self.byte(start, self.times("%y", stride))), "%to.x")
        self.do("%to.next = getelementptr double, ptr %to.x, i64 1")
        self.do("%y.next = add i64 %y, 1")
        self.jump("gather.column", then="gather.next")
        self.do("%x.next = add i64 %x, 1")
        self.jump("gather.row", then="gathered.all")
        self.jump("gathered.end", then="gathered.end")
        self.do(f"%gathered = phi ptr [ {room}, %gathered.all ]")

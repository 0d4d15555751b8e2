"""LLVM text of the builtin of public calls: how it reads arguments, finds the plan, makes results and runs the program.

The builtin reads a *form* for a call's parameters and a *plan* for a model: arrays of words that ``single_call`` makes.
A model keeps its plans in a dict, under a string for each choice of optional inputs. If the call has words as
parameters, such as a frame's name, the dict holds there a dict of plans, whose key is the name alone, or a tuple of
three words with None for each word left out.
"""

from __future__ import annotations

from collections.abc import Callable

from ... import object_layout as layout
from .llvm_text import Body

# kinds of parameters: an array or another input that the plan describes; a float; a str, True or False; the result; an
# input that the plan holds, which no caller passes
ARRAY, NUMBER, WORD, OUT, FIXED = range(5)
MOST, MOST_OUTPUTS, MOST_WORDS = 16, 16, 3
PROCESS = (
    "none", "true", "false", "ndarray", "float64", "string", "real", "real64", "new_array", "up", "down", "lookup",
    "pack", "call", "new_float", "new_tuple", "integer", "as_size", "forget", "allocate",
    "attribute", "call_objects",
)  # fmt: skip  # words of this process, which every form begins with
FOLLOWED = (
    "data_type", "runs", "attribute_name", "library", "run_plan", "noted", "after", "recompute", "held", "made",
    "edited", "switch", "off", "on",
)  # fmt: skip
FORM = (
    "python", "model_type", "plans", "plan", "count", "required", "optional", "choices", "named", "rest", "out",
    "before", *FOLLOWED,
)  # fmt: skip
#   python       the Python function
#   model_type   class of the first argument, whose dict is ``plans`` bytes from its start; 0 without a model
#   plan         address of the plan if there is no model
#   count        number of parameters after the model
#   required     bits of the parameters that must be given
#   optional     position of the first optional input; ``choices`` has the bits of all of them, shifted to it
#   named        position of the first word, -1 if there is none; ``rest`` has the bits of the others, shifted behind it
#   out          bit of the parameter out
#   before       number of arguments before the parameters: the model, if any, and the data, if any
# of a call with a second argument, its data, which has a dict of runs by the keys below; offsets are bytes to slots:
#   data_type       class of the data, whose dict is at ``runs``; 0 without
#   attribute_name  that of the model's attribute that has to be what a run has at ``library``
#   run_plan        offset in a run of its plan, or None
#   noted, after    offsets, in the data of a run, and in a run of None or a function ``after(data, run)``, which is
#                   called after the call unless the run is the noted one
#   recompute       offset in a run of None, or of a function that is then called; if that returns None, ``held(data,
#                   run)`` is called
#   made            0, None, which is then returned, or a function ``made(run, result)``, whose result is
#   edited          a function ``edited(run)``, called where the numbers that a record compares are other ones; if it
#                   returns True, the plan is looked up again
#   switch          position of an input that is ``off``, as good as left out, or ``on``; -1 if there is none
# then MOST pairs (name, kind) of parameters, then the dict's key for each choice of optional inputs
PLAN = ("entry", "context", "left", "program", "outputs", "several", "record")
#   entry    the compiled program, entry(context, inputs, outputs) -> 1, or 0 if it rejects the sample, and its context
#   left     address of the number of calls still to answer; at 0 the Python function is called and may change the plan
#   program  address of these three words: in this plan, or where plans share them
#   several  ONE: the result is returned; SEVERAL: a tuple of them; PARTS: a tuple of the first result's parts
#   record   address of a record; 0 if there is none
# then MOST_OUTPUTS results, then the parameters, ARRAY_WORDS each: kind, bytes, four words, which begin with a shape
ARRAY_WORDS = 6
ONE, SEVERAL, PARTS = range(3)
# kinds: the number of axes of a new or given array, perhaps with PLACED: the last word is the address of the numbers,
# True is returned; or with VALUE: an object of the class in the third word whose slot, at the offset in the last word,
# holds the array, or with EITHER that object or the array. Or a FLOAT, a new or given one; an INDEX, an int from 0 to
# below the first word; a CHOICE, the place of the object among four words; a TRUTH, a result: True or False for a
# number other than 0 or 0; NOTHING, no input
FLOAT, NOTHING, PLACED, INDEX, CHOICE, VALUE, EITHER, TRUTH = (16 << k for k in range(8))
AXES = 15
RECORD = ("clock", "time", "memory", "count", "result", "now", "then", "bytes")
#   clock    address of a counter, which a call advances, and the address where it writes the count
#   memory   address to which the first ``count`` inputs are copied, one after the other
#   result   address to which the first result is copied; 0 if it is not
#   now      addresses of two blocks of so many bytes: where they differ, the Python function is called
MOST_GATHERED = 1 << 14  # bytes of an array whose numbers are apart
_PAIRS = len(PROCESS) + len(FORM)
_KEYS = _PAIRS + 2 * MOST


class _Writer(Body):
    """The text of ``call``; ``block`` is the block that is being written, whose name a phi needs."""

    block = ""

    def label(self, name: str) -> None:
        super().label(name)
        self.block = f"%{name}"

    def word(self, base: str, k: int | str) -> str:
        return self.load("i64", self.at("i64", base, k))

    def pointer(self, base: str, k: int | str) -> str:
        return self.load("ptr", self.at("i64", base, k))

    def process(self, name: str) -> str:
        return self.pointer("%form", PROCESS.index(name))

    def form(self, name: str) -> str:
        return self.word("%form", len(PROCESS) + FORM.index(name))

    def plan(self, name: str) -> str:
        return self.word("%plan", PLAN.index(name))

    def equal(self, a: str, b: str | int, kind: str = "i64") -> str:
        return self.put(f"icmp eq {kind} {a}, {b}")

    def both(self, a: str, b: str) -> str:
        return self.put(f"and i1 {a}, {b}")

    def either(self, a: str, b: str) -> str:
        return self.put(f"or i1 {a}, {b}")

    def bits(self, a: str, b: str | int) -> str:
        return self.put(f"and i64 {a}, {b}")

    def shifted(self, a: str, b: str) -> str:
        return self.put(f"lshr i64 {a}, {b}")

    def one_bit(self, k: str) -> str:
        return self.put(f"shl i64 1, {k}")

    def need(self, condition: str, otherwise: str = "python") -> None:
        """Go on if the condition holds, else jump to a block."""
        self.branch(condition, f"on{len(self.lines)}", otherwise, then=f"on{len(self.lines)}")


class _Call(_Writer):
    """The text of ``call``, part by part; the parts name each other's blocks.

    values   addresses of the argument objects, by parameter; ``%given`` has a bit for each that is not None
    inputs   addresses of the numbers of the inputs, ``sizes`` of their ends; ``%m`` counts them
    cells    words of inputs that are an index or a choice
    outputs  addresses of the numbers of the results; ``results`` their objects: null for a number, in ``number``
    kept     references to the run of the data and to its plan, which other threads may replace while a program in plain
             Python runs; null without
    """

    def __init__(self) -> None:
        super().__init__()
        self.label("start")
        self.stack, self.inputs, self.sizes, self.cells = (self.put(f"alloca [{MOST} x ptr]") for _ in range(4))
        self.outputs, self.results = (self.put(f"alloca [{MOST_OUTPUTS} x ptr]") for _ in range(2))
        self.number = self.put(f"alloca [{MOST_OUTPUTS} x double]")
        self.kept = [self.put("alloca ptr") for _ in range(2)]
        for cell in self.kept:
            self.store("ptr", "null", cell)
        self.none, self.ndarray = self.process("none"), self.process("ndarray")
        self.float64 = self.word("%form", PROCESS.index("float64"))
        self.count, self.switch = self.form("count"), self.form("switch")
        self.answers: list[str] = []  # of the phi of what is returned
        self.with_data = self.put(f"icmp ne i64 {self.form('data_type')}, 0")

    def text(self) -> str:
        """The function."""
        self.collect_arguments()
        self.find_plan()
        self.count_call()
        self.unbox_arguments()
        self.take_out()
        self.allocate_results()
        self.run_program()
        self.record_call()
        self.box_results()
        self.return_results()
        self.follow_call()
        self.call_python()
        return self.function("define internal ptr @call(ptr %form, ptr %args, i64 %n, ptr %names)")

    # --- arguments -----------------------------------------------------------------------------------------

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
        """Bit k if a value is not None; a switch that is None is given too."""
        there = self.either(self.put(f"icmp ne ptr {value}, {self.none}"), self.equal(k, self.switch))
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
        wanted = self.pointer("%form", self.add(self.times("%k", 2), _PAIRS))
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

    # --- the plan ------------------------------------------------------------------------------------------

    def find_plan(self) -> None:
        """Find ``%plan``, that of the form, the model's or that of a run of the data."""
        self.branch(self.with_data, "of_data", "of_no_data", then="of_data")
        run, of_run, last = self._plan_of_run()
        self.label("of_no_data")
        self.branch(self.no_model, "without", "of_model", then="without")
        fixed = self.put(f"inttoptr i64 {self.form('plan')} to ptr")
        self.jump("planned", then="of_model")
        model = self.load("ptr", "%args")
        self.need(self.equal(self.pointer(model, layout.TYPE), self.model_type, "ptr"))
        plans = self.load("ptr", self.byte(model, self.form("plans")))
        lookup = self.process("lookup")
        entry = self._look_up(plans)
        named, before = self.form("named"), self.block
        self.branch(self.put(f"icmp slt i64 {named}, 0"), "of_call", "of_words", then="of_words")
        alone, by_words = self._plan_of_words(named, entry, lookup)
        self.do(f"%entry = phi ptr [ {entry}, {before} ], [ {alone}, %of_name ], [ {by_words}, %of_three.end ]")
        of_model = self.pointer("%entry", layout.DATA)
        self.jump("planned", then="planned")
        self.do(f"%plan = phi ptr [ {fixed}, %without ], [ {of_model}, %of_call ], [ {of_run}, {last} ]")
        self.do(f"%run.of = phi ptr [ null, %without ], [ null, %of_call ], [ {run}, {last} ]")
        self.code = self.pointer("%plan", PLAN.index("program"))
        self.record = self.pointer("%plan", PLAN.index("record"))
        self.shapes = self.at("i64", "%plan", len(PLAN))

    def _look_up(self, plans: str) -> str:
        """What a dict has under the key of the optional inputs that are given."""
        choice = self.bits(self.shifted("%given", self.form("optional")), self.form("choices"))
        key = self.pointer("%form", self.add(choice, _KEYS))
        entry = self.put(f"call ptr {self.process('lookup')}(ptr {plans}, ptr {key})")
        self.need(self.put(f"icmp ne ptr {entry}, null"))
        return entry

    def _slot(self, owner: str, name: str) -> str:
        """The object in a slot, at an offset in the form."""
        return self.load("ptr", self.byte(owner, self.form(name)))

    def _plan_of_run(self) -> tuple[str, str, str]:
        """A run of the data, its plan, and the block; the model has to be that of the run."""
        model, data = (self.load("ptr", self.at("ptr", "%args", k)) for k in range(2))
        data_type = self.put(f"inttoptr i64 {self.form('data_type')} to ptr")
        self.need(self.equal(self.pointer(data, layout.TYPE), data_type, "ptr"))
        runs = self._slot(data, "runs")
        self.need(self.put(f"icmp ne ptr {runs}, null"))
        run = self._look_up(runs)
        name = self.put(f"inttoptr i64 {self.form('attribute_name')} to ptr")
        library = self.put(f"call ptr {self.process('attribute')}(ptr {model}, ptr {name})")
        self.branch(self.equal(library, "null", "ptr"), "no_attribute", "attribute", then="no_attribute")
        self.do(f"call void {self.process('forget')}()")
        self.jump("python", then="attribute")
        self.do(f"call void {self.process('down')}(ptr {library})")
        self.need(self.equal(library, self._slot(run, "library"), "ptr"))
        words = self._slot(run, "run_plan")
        self.need(self.put(f"icmp ne ptr {words}, {self.none}"))
        for x in (run, words):
            self.do(f"call void {self.process('up')}(ptr {x})")
        self._release()  # of an earlier look-up
        for x, cell in zip((run, words), self.kept, strict=True):
            self.store("ptr", x, cell)
        plan, last = self.pointer(words, layout.DATA), self.block
        self.jump("planned", then="planning")
        self.do("unreachable")
        return run, plan, last

    def _release(self) -> None:
        """Drop the references to the run and its plan, if any."""
        for cell in self.kept:
            self.do(f"call void {self.process('down')}(ptr {self.load('ptr', cell)})")  # null is allowed

    def _plan_of_words(self, named: str, entry: str, lookup: str) -> tuple[str, str]:
        """Look up the plan of a name alone, or of three words."""
        words = [self.load("ptr", self.at("ptr", "%values", named))]
        string = self.process("string")
        self.need(self.equal(self.pointer(words[0], layout.TYPE), string, "ptr"))
        others = self.bits(self.shifted("%given", self.add(named, 1)), self.form("rest"))
        self.branch(self.equal(others, 0), "of_name", "of_three", then="of_name")
        alone = self.put(f"call ptr {lookup}(ptr {entry}, ptr {words[0]})")
        self.branch(self.put(f"icmp ne ptr {alone}, null"), "of_call", "python", then="of_three")
        for k in range(1, MOST_WORDS):
            there = self.put(f"icmp ne i64 {self.bits(others, 1 << (k - 1))}, 0")
            given, none = self.at("ptr", "%values", self.add(named, k)), self.at("i64", "%form", 0)
            word = self.load("ptr", self.put(f"select i1 {there}, ptr {given}, ptr {none}"))
            known = self.equal(self.pointer(word, layout.TYPE), string, "ptr")
            for constant in ("none", "true", "false"):
                known = self.either(known, self.equal(word, self.process(constant), "ptr"))
            self.need(known)
            words.append(word)
        three = "".join(f", ptr {word}" for word in words)
        key = self.put(f"call ptr (i64, ...) {self.process('pack')}(i64 {MOST_WORDS}{three})")
        self.need(self.put(f"icmp ne ptr {key}, null"), "failed")
        by_words = self.put(f"call ptr {lookup}(ptr {entry}, ptr {key})")
        self.do(f"call void {self.process('down')}(ptr {key})")
        self.branch(self.put(f"icmp ne ptr {by_words}, null"), "of_three.end", "python", then="of_three.end")
        self.jump("of_call", then="of_call")
        return alone, by_words

    def count_call(self) -> None:
        """Go on if the program answers more calls, and the blocks of numbers that a record compares are equal."""
        self.recorded = self.put(f"icmp ne ptr {self.record}, null")
        self.branch(self.recorded, "compared", "counted", then="compared")
        now, then = (self.pointer(self.record, RECORD.index(x)) for x in ("now", "then"))
        amount = self.word(self.record, RECORD.index("bytes"))
        unequal = self.put(f"call i32 @memcmp(ptr {now}, ptr {then}, i64 {amount})")
        self.branch(self.equal(unequal, 0, "i32"), "counted", "unequal", then="unequal")
        self.branch(self.with_data, "edited", "python", then="edited")
        done = self._called(self.put(f"inttoptr i64 {self.form('edited')} to ptr"), "%run.of")
        self.need(self.put(f"icmp ne ptr {done}, null"), "failed")
        self.do(f"call void {self.process('down')}(ptr {done})")
        self.branch(self.equal(done, self.process("true"), "ptr"), "of_data", "python", then="counted")
        counter = self.pointer(self.code, PLAN.index("left"))
        left = self.load("i64", counter)
        self.need(self.put(f"icmp ne i64 {left}, 0"))
        self.store("i64", self.put(f"sub i64 {left}, 1"), counter)

    # --- inputs --------------------------------------------------------------------------------------------

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

    # --- results -------------------------------------------------------------------------------------------

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

    def run_program(self) -> None:
        """Run the program; if it rejects the sample, drop the results and call Python."""
        program, context = (self.pointer(self.code, PLAN.index(x)) for x in ("entry", "context"))
        valid = self.put(f"call i64 {program}(ptr {context}, ptr {self.inputs}, ptr {self.outputs})")
        self.branch(self.equal(valid, 0), "release", "valid", then="release")
        self.do("%f = phi i64 [ 0, %run ], [ %f.next, %released ]")
        self.branch(self.equal("%f", self.amount), "python", "releasing", then="releasing")
        wrong = self.load("ptr", self.at("ptr", self.results, "%f"))
        self.branch(self.equal(wrong, "null", "ptr"), "released", "dropping", then="dropping")
        self.do(f"call void {self.process('down')}(ptr {wrong})")
        self.jump("released", then="released")
        self.do("%f.next = add i64 %f, 1")
        self.jump("release", then="valid")

    def record_call(self) -> None:
        """Copy inputs and result to the memory of the record, and stamp it."""
        self.branch(self.recorded, "recording", "answers", then="recording")
        count, memory = self.word(self.record, RECORD.index("count")), self.pointer(self.record, RECORD.index("memory"))
        before = self.block
        self.jump("noting", then="noting")
        self.do(f"%w = phi i64 [ 0, {before} ], [ %w.next, %note ]")
        self.do(f"%memory = phi ptr [ {memory}, {before} ], [ %memory.next, %note ]")
        self.branch(self.equal("%w", count), "noted", "note", then="note")
        begin, end = (self.load("ptr", self.at("ptr", x, "%w")) for x in (self.inputs, self.sizes))
        first, last = (self.put(f"ptrtoint ptr {x} to i64") for x in (begin, end))
        size = self.put(f"sub i64 {last}, {first}")
        self.move("%memory", begin, size)
        self.do(f"%memory.next = getelementptr i8, ptr %memory, i64 {size}")
        self.do("%w.next = add i64 %w, 1")
        self.jump("noting", then="noted")
        kept, result = self.pointer(self.record, RECORD.index("result")), self.load("ptr", self.outputs)
        there = self.either(self.equal(kept, "null", "ptr"), self.equal(kept, result, "ptr"))
        self.branch(there, "stamped", "keep", then="keep")
        self.move(kept, result, self.word(self.shapes, 1))
        self.jump("stamped", then="stamped")
        clock = self.pointer(self.record, RECORD.index("clock"))
        time = self.add(self.load("i64", clock), 1)
        self.store("i64", time, clock)
        self.store("i64", time, self.pointer(self.record, RECORD.index("time")))
        self.jump("answers", then="answers")

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
        self._release()
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

    def _called(self, function: str, *given: str) -> str:
        """What a function returns; null for an error."""
        listed = ", ".join(f"ptr {x}" for x in (function, *given, "null"))
        return self.put(f"call ptr (ptr, ...) {self.process('call_objects')}({listed})")

    def follow_call(self) -> None:
        """Return the result; of a call with data what is made of it, after what follows the call."""
        run = "%run.of"

        def drop(x: str) -> None:
            self.do(f"call void {self.process('down')}(ptr {x})")

        def keep(x: str) -> None:
            self.do(f"call void {self.process('up')}(ptr {x})")

        def function(name: str) -> str:
            return self.put(f"inttoptr i64 {self.form(name)} to ptr")

        self.label("answer")
        self.do(f"%answer.first = phi ptr {', '.join(self.answers)}")
        self.branch(self.with_data, "following", "answer.end", then="answer.end")
        self.do("ret ptr %answer.first")
        self.label("following")
        data, made = self.load("ptr", self.at("ptr", "%args", 1)), function("made")
        self.branch(self.equal(made, "null", "ptr"), "follow", "making", then="making")
        self.branch(self.equal(made, self.none, "ptr"), "silent", "call_made", then="silent")
        keep(self.none)
        drop("%answer.first")
        self.jump("follow", then="call_made")
        other = self._called(made, run, "%answer.first")
        drop("%answer.first")
        self.branch(self.equal(other, "null", "ptr"), "failed", "follow", then="follow")
        ways = "[ %answer.first, %following ]", f"[ {self.none}, %silent ]", f"[ {other}, %call_made ]"
        self.do(f"%answer.last = phi ptr {', '.join(ways)}")
        after = self._slot(run, "after")
        self.branch(self.equal(after, self.none, "ptr"), "recompute", "after", then="after")
        self.branch(self.equal(self._slot(data, "noted"), run, "ptr"), "recompute", "call_after", then="call_after")
        done = self._called(after, data, run)
        self.need(self.put(f"icmp ne ptr {done}, null"), "drop_answer")
        drop(done)
        self.jump("recompute", then="recompute")
        recompute = self._slot(run, "recompute")
        self.branch(self.equal(recompute, self.none, "ptr"), "followed", "recomputing", then="recomputing")
        done = self._called(recompute)
        self.need(self.put(f"icmp ne ptr {done}, null"), "drop_answer")
        drop(done)
        self.branch(self.equal(done, self.none, "ptr"), "holding", "followed", then="holding")
        done = self._called(function("held"), data, run)
        self.need(self.put(f"icmp ne ptr {done}, null"), "drop_answer")
        drop(done)
        self.jump("followed", then="followed")
        self._release()
        self.do("ret ptr %answer.last")
        self.label("drop_answer")
        drop("%answer.last")
        self.jump("failed", then="unfollowed")
        self.do("unreachable")

    def call_python(self) -> None:
        """Call the Python function, for anything else."""
        self.label("python")
        self._release()
        python = self.put(f"inttoptr i64 {self.form('python')} to ptr")
        answer = self.put(f"call ptr {self.process('call')}(ptr {python}, ptr %args, i64 %n, ptr %names)")
        self.do(f"ret ptr {answer}")


def module(calls: int) -> str:
    """The module with ``call_k`` for each call k, ``bound_call`` and ``copy_entry``.

    The form of ``call_k`` is at ``forms[k]``; the form of ``bound_call`` is the data of the array to which it is bound.
    ``copy_entry`` is an entry that copies its input, of as many bytes as its context says, to its output.
    """
    given, passed = "(ptr %bound, ptr %args, i64 %n, ptr %names)", "ptr %args, i64 %n, ptr %names"
    forms = Body()
    forms.do("ret ptr @forms")
    entries = [f"@forms = global [{calls} x ptr] zeroinitializer", forms.function("define ptr @forms_address()")]
    for k in range(calls):
        c = Body()
        form = c.load("ptr", c.at("ptr", "@forms", k))
        c.do(f"ret ptr {c.put(f'tail call ptr @call(ptr {form}, {passed})')}")
        entries.append(c.function(f"define ptr @call_{k}{given}"))
    c = Body()
    form = c.load("ptr", c.at("i64", "%bound", layout.DATA))
    c.do(f"ret ptr {c.put(f'tail call ptr @call(ptr {form}, {passed})')}")
    entries.append(c.function(f"define ptr @bound_call{given}"))
    c = Body()
    c.move(c.load("ptr", "%outputs"), c.load("ptr", "%inputs"), "%bytes")
    c.do("ret i64 1")
    entries.append(c.function("define i64 @copy_entry(i64 %bytes, ptr %inputs, ptr %outputs)"))
    outside = "declare i32 @memcmp(ptr, ptr, i64)\ndeclare void @llvm.memmove.p0.p0.i64(ptr, ptr, i64, i1)\n"
    return "\n".join([outside, _Call().text(), *entries])

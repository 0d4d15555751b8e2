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
)  # fmt: skip  # words of this process, which every form begins with
FORM = ("python", "model_type", "plans", "plan", "count", "required", "optional", "choices", "named", "rest", "out")
#   python       the Python function
#   model_type   class of the first argument, whose dict is ``plans`` bytes from its start; 0 without a model
#   plan         address of the plan if there is no model
#   count        number of parameters after the model
#   required     bits of the parameters that must be given
#   optional     position of the first optional input; ``choices`` has the bits of all of them, shifted to it
#   named        position of the first word, -1 if there is none; ``rest`` has the bits of the others, shifted behind it
#   out          bit of the parameter out
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

    def given_bit(self, value: str, none: str, k: str) -> str:
        """Bit k if a value is not None."""
        there = self.put(f"zext i1 {self.put(f'icmp ne ptr {value}, {none}')} to i64")
        return self.put(f"shl i64 {there}, {k}")

    def need(self, condition: str, otherwise: str = "python") -> None:
        """Go on if the condition holds, else jump to a block."""
        self.branch(condition, f"on{len(self.lines)}", otherwise, then=f"on{len(self.lines)}")


def _call() -> str:
    c = _Writer()
    put, do, form, plan = c.put, c.do, c.form, c.plan
    c.label("start")
    values, inputs, sizes, cells = (put(f"alloca [{MOST} x ptr]") for _ in range(4))
    outputs, results = (put(f"alloca [{MOST_OUTPUTS} x ptr]") for _ in range(2))
    number = put(f"alloca [{MOST_OUTPUTS} x double]")
    none, ndarray, float64 = c.process("none"), c.process("ndarray"), c.word("%form", PROCESS.index("float64"))
    count, model_type = form("count"), put(f"inttoptr i64 {form('model_type')} to ptr")
    no_model = c.equal(model_type, "null", "ptr")
    skip = put(f"select i1 {no_model}, i64 0, i64 1")
    positional = put(f"sub i64 %n, {skip}")
    c.need(put(f"icmp ule i64 {positional}, {count}"))  # unsigned: not negative either
    first = c.at("ptr", "%args", skip)
    before = c.block
    c.jump("by_position", then="by_position")

    # arguments by position, then by keyword; %given has a bit for each that is not None
    do(f"%i = phi i64 [ 0, {before} ], [ %i.next, %take ]")
    do(f"%given.i = phi i64 [ 0, {before} ], [ %given.next, %take ]")
    c.branch(c.equal("%i", positional), "keywords", "take", then="take")
    value = c.load("ptr", c.at("ptr", first, "%i"))
    c.store("ptr", value, c.at("ptr", values, "%i"))
    do(f"%given.next = or i64 %given.i, {c.given_bit(value, none, '%i')}")
    do("%i.next = add i64 %i, 1")
    c.jump("by_position", then="keywords")
    passed = put(f"sub i64 {c.one_bit(positional)}, 1")
    c.branch(c.equal("%names", "null", "ptr"), "collected", "named", then="named")
    keywords, behind = c.word("%names", layout.LENGTH), c.at("ptr", first, positional)
    c.jump("by_keyword", then="by_keyword")
    do("%j = phi i64 [ 0, %named ], [ %j.next, %found ]")
    do(f"%passed.j = phi i64 [ {passed}, %named ], [ %passed.next, %found ]")
    do("%given.j = phi i64 [ %given.i, %named ], [ %given.more, %found ]")
    c.branch(c.equal("%j", keywords), "collected", "search", then="search")
    name = c.pointer("%names", c.add("%j", layout.ITEMS))
    c.jump("compare", then="compare")
    do("%k = phi i64 [ 0, %search ], [ %k.next, %other ]")
    c.branch(c.equal("%k", count), "python", "same", then="same")
    wanted = c.pointer("%form", c.add(c.times("%k", 2), _PAIRS))
    c.branch(c.equal(name, wanted, "ptr"), "match", "other", then="other")
    do("%k.next = add i64 %k, 1")
    c.jump("compare", then="match")
    c.branch(c.equal(c.bits("%passed.j", c.one_bit("%k")), 0), "found", "python", then="found")
    value = c.load("ptr", c.at("ptr", behind, "%j"))
    c.store("ptr", value, c.at("ptr", values, "%k"))
    do(f"%given.more = or i64 %given.j, {c.given_bit(value, none, '%k')}")
    do(f"%passed.next = or i64 %passed.j, {c.one_bit('%k')}")
    do("%j.next = add i64 %j, 1")
    c.jump("by_keyword", then="collected")
    do("%given = phi i64 [ %given.i, %keywords ], [ %given.j, %by_keyword ]")
    required = form("required")
    c.need(c.equal(c.bits("%given", required), required))

    # the plan of the model
    c.branch(no_model, "without", "of_model", then="without")
    fixed = put(f"inttoptr i64 {form('plan')} to ptr")
    c.jump("planned", then="of_model")
    model = c.load("ptr", "%args")
    c.need(c.equal(c.pointer(model, layout.TYPE), model_type, "ptr"))
    plans = c.load("ptr", c.byte(model, form("plans")))
    choice = c.bits(c.shifted("%given", form("optional")), form("choices"))
    lookup = c.process("lookup")
    entry = put(f"call ptr {lookup}(ptr {plans}, ptr {c.pointer('%form', c.add(choice, _KEYS))})")
    c.need(put(f"icmp ne ptr {entry}, null"))
    named = form("named")
    before = c.block
    c.branch(put(f"icmp slt i64 {named}, 0"), "of_call", "of_words", then="of_words")
    words = [c.load("ptr", c.at("ptr", values, named))]
    string = c.process("string")
    c.need(c.equal(c.pointer(words[0], layout.TYPE), string, "ptr"))
    others = c.bits(c.shifted("%given", c.add(named, 1)), form("rest"))
    c.branch(c.equal(others, 0), "of_name", "of_three", then="of_name")
    alone = put(f"call ptr {lookup}(ptr {entry}, ptr {words[0]})")
    c.branch(put(f"icmp ne ptr {alone}, null"), "of_call", "python", then="of_three")
    for k in range(1, MOST_WORDS):
        there = put(f"icmp ne i64 {c.bits(others, 1 << (k - 1))}, 0")
        at = put(f"select i1 {there}, ptr {c.at('ptr', values, c.add(named, k))}, ptr {c.at('i64', '%form', 0)}")
        word = c.load("ptr", at)  # else none, the form's first word
        known = c.equal(c.pointer(word, layout.TYPE), string, "ptr")
        for constant in ("none", "true", "false"):
            known = c.either(known, c.equal(word, c.process(constant), "ptr"))
        c.need(known)
        words.append(word)
    three = "".join(f", ptr {word}" for word in words)
    key = put(f"call ptr (i64, ...) {c.process('pack')}(i64 {MOST_WORDS}{three})")
    c.need(put(f"icmp ne ptr {key}, null"), "failed")
    by_words = put(f"call ptr {lookup}(ptr {entry}, ptr {key})")
    do(f"call void {c.process('down')}(ptr {key})")
    c.branch(put(f"icmp ne ptr {by_words}, null"), "of_three.end", "python", then="of_three.end")
    c.jump("of_call", then="of_call")
    do(f"%entry = phi ptr [ {entry}, {before} ], [ {alone}, %of_name ], [ {by_words}, %of_three.end ]")
    of_model = c.pointer("%entry", layout.DATA)
    c.jump("planned", then="planned")
    do(f"%plan = phi ptr [ {fixed}, %without ], [ {of_model}, %of_call ]")
    code, record = c.pointer("%plan", PLAN.index("program")), c.pointer("%plan", PLAN.index("record"))
    recorded = put(f"icmp ne ptr {record}, null")
    c.branch(recorded, "compared", "counted", then="compared")
    now, then = c.pointer(record, RECORD.index("now")), c.pointer(record, RECORD.index("then"))
    amount = c.word(record, RECORD.index("bytes"))
    c.branch(c.equal(put(f"call i32 @memcmp(ptr {now}, ptr {then}, i64 {amount})"), 0, "i32"), "counted", "python",
             then="counted")  # fmt: skip
    counter = c.pointer(code, PLAN.index("left"))
    left = c.load("i64", counter)
    c.need(put(f"icmp ne i64 {left}, 0"))
    c.store("i64", put(f"sub i64 {left}, 1"), counter)
    shapes = c.at("i64", "%plan", len(PLAN))
    in_place = put(f"select i1 {c.equal(c.bits(c.word(shapes, 0), PLACED), 0)}, i64 0, i64 {c.word(shapes, 1)}")
    written = c.pointer(shapes, ARRAY_WORDS - 1)
    written_end = c.byte(written, in_place)
    before = c.block
    c.jump("arguments", then="arguments")

    # the inputs
    do(f"%p = phi i64 [ 0, {before} ], [ %p.next, %next ]")
    do(f"%m = phi i64 [ 0, {before} ], [ %m.next, %next ]")
    c.branch(c.equal("%p", count), "results", "argument", then="argument")
    shape = c.at("i64", shapes, c.times(c.add("%p", MOST_OUTPUTS), ARRAY_WORDS))
    kind, extent = c.word(shape, 0), c.at("i64", shape, 2)
    held = c.pointer(shape, ARRAY_WORDS - 1)
    there = put(f"icmp ne i64 {c.bits('%given', c.one_bit('%p'))}, 0")
    c.branch(c.both(there, put(f"icmp ult i64 {kind}, {FLOAT}")), "passed", "special", then="special")
    c.branch(c.equal(c.bits(kind, PLACED), 0), "unplaced", "input.end", then="unplaced")
    c.branch(c.both(there, c.equal(c.bits(kind, NOTHING), 0)), "input", "next", then="input")
    special, cell = c.load("ptr", c.at("ptr", values, "%p")), c.at("ptr", cells, "%p")
    special_type = c.pointer(special, layout.TYPE)
    cases = ((FLOAT, "number"), (INDEX, "index"), (CHOICE, "choice"))
    listed = " ".join(f"i64 {k}, label %{to}" for k, to in cases)
    do(f"switch i64 {kind}, label %object [ {listed} ]")
    c.label("number")
    c.need(c.either(c.equal(special_type, c.process("real"), "ptr"), c.equal(special_type, c.process("real64"), "ptr")))
    number_data = c.at("i64", special, layout.REAL)
    c.jump("number.end", then="number.end")
    c.jump("input.end", then="index")
    c.need(c.equal(special_type, c.process("integer"), "ptr"))
    place = put(f"call i64 {c.process('as_size')}(ptr {special})")
    c.branch(c.equal(place, -1), "index.wrong", "index.known", then="index.wrong")  # -1, or an overflow with its error
    do(f"call void {c.process('forget')}()")
    c.jump("python", then="index.known")
    c.need(put(f"icmp ult i64 {place}, {c.word(extent, 0)}"))
    c.store("i64", place, cell)
    c.jump("index.end", then="index.end")
    c.jump("input.end", then="choice")
    chosen = "-1"
    for k in reversed(range(ARRAY_WORDS - 2)):
        chosen = put(f"select i1 {c.equal(special, c.pointer(extent, k), 'ptr')}, i64 {k}, i64 {chosen}")
    c.need(put(f"icmp sge i64 {chosen}, 0"))
    c.store("i64", chosen, cell)
    c.jump("choice.end", then="choice.end")
    c.jump("input.end", then="object")
    c.branch(c.equal(special_type, c.pointer(extent, 2), "ptr"), "opened", "unopened", then="unopened")
    c.branch(c.equal(c.bits(kind, EITHER), 0), "python", "object.end", then="opened")
    inner = c.load("ptr", c.byte(special, c.word(extent, 3)))
    c.branch(put(f"icmp ne ptr {inner}, null"), "object.end", "python", then="object.end")
    do(f"%inner = phi ptr [ {special}, %unopened ], [ {inner}, %opened ]")
    c.jump("array", then="passed")
    outer = c.load("ptr", c.at("ptr", values, "%p"))
    c.jump("array", then="array")
    do(f"%value = phi ptr [ %inner, %object.end ], [ {outer}, %passed ]")
    rank = c.bits(kind, AXES)
    _is_array(c, "%value", c.pointer("%value", layout.TYPE), ndarray, float64, rank, layout.ALIGNED)
    data = c.pointer("%value", layout.DATA)
    _same_shape(c, "%value", shape, rank, "in")
    flags = c.bits(c.word("%value", layout.FLAGS), layout.CONTIGUOUS)
    before = put(f"icmp ule ptr {c.byte(data, c.word(shape, 1))}, {written}")
    behind = c.either(put(f"icmp ule ptr {written_end}, {data}"), c.equal(in_place, 0))
    whole = c.both(put(f"icmp ne i64 {flags}, 0"), c.either(before, behind))
    c.jump("array.whole", then="array.whole")
    c.branch(whole, "input.end", "scattered", then="scattered")  # gathered also if the result is written over it
    _gather(c, "%value", rank, c.word(shape, 1))
    c.jump("input.end", then="input.end")
    sources = ((held, "special"), (number_data, "number.end"), (cell, "index.end"), (cell, "choice.end"),
               (data, "array.whole"), ("%gathered", "gathered.end"))  # fmt: skip
    do("%data = phi ptr " + ", ".join(f"[ {x}, %{block} ]" for x, block in sources))
    c.store("ptr", "%data", c.at("ptr", inputs, "%m"))
    c.store("ptr", c.byte("%data", c.word(shape, 1)), c.at("ptr", sizes, "%m"))
    more = c.add("%m", 1)
    c.jump("next", then="next")
    do(f"%m.next = phi i64 [ %m, %unplaced ], [ {more}, %input.end ]")
    do("%p.next = add i64 %p, 1")
    c.jump("arguments", then="results")

    # the results: new arrays, or the array that is given
    amount, several = plan("outputs"), plan("several")
    c.branch(c.equal(c.bits("%given", form("out")), 0), "new", "given_out", then="given_out")
    c.need(c.equal(several, ONE))
    place = put(f"sub i64 {count}, 1")  # out is the last parameter
    target = c.load("ptr", c.at("ptr", values, place))
    rank = c.word(shapes, 0)
    c.need(put(f"icmp ult i64 {rank}, {FLOAT}"))
    writeable = layout.CONTIGUOUS | layout.ALIGNED | layout.WRITEABLE
    _is_array(c, target, c.pointer(target, layout.TYPE), ndarray, float64, rank, writeable)
    _same_shape(c, target, shapes, rank, "out")
    begin = c.pointer(target, layout.DATA)
    end = c.byte(begin, c.word(shapes, 1))
    before = c.block
    c.jump("overlaps", then="overlaps")
    do(f"%o = phi i64 [ 0, {before} ], [ %o.next, %apart ]")
    c.branch(c.equal("%o", "%m"), "apart.end", "overlap", then="overlap")
    before = put(f"icmp ule ptr {c.load('ptr', c.at('ptr', sizes, '%o'))}, {begin}")
    after = put(f"icmp ule ptr {end}, {c.load('ptr', c.at('ptr', inputs, '%o'))}")
    c.branch(c.either(before, after), "apart", "python", then="apart")
    do("%o.next = add i64 %o, 1")
    c.jump("overlaps", then="apart.end")
    c.store("ptr", begin, outputs)
    c.store("ptr", target, results)
    do(f"call void {c.process('up')}(ptr {target})")
    c.jump("run", then="new")
    do("%r = phi i64 [ 0, %results ], [ %r.next, %made ]")
    c.branch(c.equal("%r", amount), "run", "make", then="make")
    shape = c.at("i64", shapes, c.times("%r", ARRAY_WORDS))
    kind = c.word(shape, 0)
    c.branch(c.equal(c.bits(kind, FLOAT | PLACED | TRUTH), 0), "make_array", "make_other", then="make_other")
    cell = c.at("double", number, "%r")
    c.branch(c.equal(c.bits(kind, PLACED), 0), "made", "make_place", then="make_place")
    held, true = c.pointer(shape, ARRAY_WORDS - 1), c.process("true")
    do(f"call void {c.process('up')}(ptr {true})")
    c.jump("made", then="make_array")
    rank = put(f"trunc i64 {c.bits(kind, AXES)} to i32")
    passed = f"ptr {ndarray}, i32 {rank}, ptr {c.at('i64', shape, 2)}, i32 {layout.DOUBLE}"
    array = put(f"call ptr {c.process('new_array')}({passed}, ptr null, ptr null, i32 0, i32 0, ptr null)")
    c.need(put(f"icmp ne ptr {array}, null"), "failed")  # no memory; arrays made before are lost
    fresh = c.pointer(array, layout.DATA)
    c.jump("make_array.end", then="make_array.end")
    c.jump("made", then="made")
    do(f"%to = phi ptr [ {cell}, %make_other ], [ {held}, %make_place ], [ {fresh}, %make_array.end ]")
    do(f"%result = phi ptr [ null, %make_other ], [ {true}, %make_place ], [ {array}, %make_array.end ]")
    c.store("ptr", "%to", c.at("ptr", outputs, "%r"))
    c.store("ptr", "%result", c.at("ptr", results, "%r"))
    do("%r.next = add i64 %r, 1")
    c.jump("new", then="run")

    # the program
    program, context = (c.pointer(code, PLAN.index(x)) for x in ("entry", "context"))
    valid = put(f"call i64 {program}(ptr {context}, ptr {inputs}, ptr {outputs})")
    c.branch(c.equal(valid, 0), "release", "valid", then="release")
    do("%f = phi i64 [ 0, %run ], [ %f.next, %released ]")
    c.branch(c.equal("%f", amount), "python", "releasing", then="releasing")
    wrong = c.load("ptr", c.at("ptr", results, "%f"))
    c.branch(c.equal(wrong, "null", "ptr"), "released", "dropping", then="dropping")
    do(f"call void {c.process('down')}(ptr {wrong})")
    c.jump("released", then="released")
    do("%f.next = add i64 %f, 1")
    c.jump("release", then="valid")
    c.branch(recorded, "recording", "answers", then="recording")
    recorded_inputs = c.word(record, RECORD.index("count"))
    first, before = c.pointer(record, RECORD.index("memory")), c.block
    c.jump("noting", then="noting")
    do(f"%w = phi i64 [ 0, {before} ], [ %w.next, %note ]")
    do(f"%memory = phi ptr [ {first}, {before} ], [ %memory.next, %note ]")
    c.branch(c.equal("%w", recorded_inputs), "noted", "note", then="note")
    begin, end = (put(f"ptrtoint ptr {c.load('ptr', c.at('ptr', x, '%w'))} to i64") for x in (inputs, sizes))
    amount_noted = put(f"sub i64 {end}, {begin}")
    c.move("%memory", c.load("ptr", c.at("ptr", inputs, "%w")), amount_noted)
    do(f"%memory.next = getelementptr i8, ptr %memory, i64 {amount_noted}")
    do("%w.next = add i64 %w, 1")
    c.jump("noting", then="noted")
    kept, result = c.pointer(record, RECORD.index("result")), c.load("ptr", outputs)
    c.branch(c.either(c.equal(kept, "null", "ptr"), c.equal(kept, result, "ptr")), "stamped", "keep", then="keep")
    c.move(kept, result, c.word(shapes, 1))
    c.jump("stamped", then="stamped")
    clock = c.pointer(record, RECORD.index("clock"))
    time = c.add(c.load("i64", clock), 1)
    c.store("i64", time, clock)
    c.store("i64", time, c.pointer(record, RECORD.index("time")))
    c.jump("answers", then="answers")
    do("%b = phi i64 [ 0, %valid ], [ 0, %stamped ], [ %b.next, %boxed ]")
    c.branch(c.equal("%b", amount), "answered", "box", then="box")
    at, shape = c.at("ptr", results, "%b"), c.at("i64", shapes, c.times("%b", ARRAY_WORDS))
    inner = c.load("ptr", at)
    c.branch(c.equal(inner, "null", "ptr"), "boxing", "wrap", then="wrap")
    c.branch(c.equal(c.bits(c.word(shape, 0), VALUE), 0), "boxed", "wrapping", then="wrapping")
    wrapped = put(f"call ptr {c.process('allocate')}(ptr {c.pointer(shape, 4)}, i64 0)")
    c.need(put(f"icmp ne ptr {wrapped}, null"), "failed")
    c.store("ptr", inner, c.byte(wrapped, c.word(shape, 5)))
    c.store("ptr", wrapped, at)
    c.jump("boxed", then="boxing")
    found = c.load("double", c.at("double", number, "%b"))
    c.branch(c.equal(c.word(shape, 0), TRUTH), "judging", "real", then="judging")
    judged = put(f"select i1 {put(f'fcmp une double {found}, 0.0')}, ptr {c.process('true')}, ptr {c.process('false')}")
    do(f"call void {c.process('up')}(ptr {judged})")
    c.store("ptr", judged, at)
    c.jump("boxed", then="real")
    boxed = put(f"call ptr {c.process('new_float')}(double {found})")
    c.store("ptr", boxed, at)
    c.branch(put(f"icmp ne ptr {boxed}, null"), "boxed", "failed", then="boxed")
    do("%b.next = add i64 %b, 1")
    c.jump("answers", then="answered")
    do(f"switch i64 {several}, label %one [ i64 {SEVERAL}, label %tuple i64 {PARTS}, label %parts ]")
    c.label("one")
    do(f"ret ptr {c.load('ptr', results)}")
    c.label("tuple")
    _tuple(c, amount, "t", lambda k: c.load("ptr", c.at("ptr", results, k)))
    c.label("parts")
    do(f"call void {c.process('down')}(ptr {c.load('ptr', results)})")  # True
    share = put(f"udiv i64 {c.word(shapes, 1)}, {c.word(shapes, 2)}")

    def part(k: str) -> str:
        shape = f"ptr {ndarray}, i32 2, ptr {c.at('i64', shapes, 3)}, i32 {layout.DOUBLE}"
        new = put(f"call ptr {c.process('new_array')}({shape}, ptr null, ptr null, i32 0, i32 0, ptr null)")
        c.need(put(f"icmp ne ptr {new}, null"), "failed")
        c.move(c.pointer(new, layout.DATA), c.byte(c.load("ptr", outputs), c.times(share, k)), share)
        return new

    _tuple(c, c.word(shapes, 2), "s", part)
    c.label("failed")
    do("ret ptr null")

    # anything else
    c.label("python")
    python = put(f"inttoptr i64 {form('python')} to ptr")
    answer = put(f"call ptr {c.process('call')}(ptr {python}, ptr %args, i64 %n, ptr %names)")
    do(f"ret ptr {answer}")
    return c.function("define internal ptr @call(ptr %form, ptr %args, i64 %n, ptr %names)")


def _is_array(c: _Writer, value: str, kind: str, ndarray: str, float64: str, rank: str, flags: int) -> None:
    """Go on if an object is an array of float64 of this rank with these flags."""
    c.need(c.equal(kind, ndarray, "ptr"))
    c.need(c.equal(c.bits(c.word(c.pointer(value, layout.DTYPE), layout.KIND), layout.SAME), float64))
    right = c.equal(c.bits(c.word(value, layout.RANK), 0xFFFFFFFF), rank)
    c.need(c.both(right, c.equal(c.bits(c.word(value, layout.FLAGS), flags), flags)))


def _same_shape(c: _Writer, value: str, shape: str, rank: str, label: str) -> None:
    """Go on if an array of that rank has that shape."""
    sizes, before = c.pointer(value, layout.SHAPE), c.block
    c.jump(f"{label}.axis", then=f"{label}.axis")
    c.do(f"%{label}.a = phi i64 [ 0, {before} ], [ %{label}.a.next, %{label}.fits ]")
    c.branch(c.equal(f"%{label}.a", rank), f"{label}.end", f"{label}.size", then=f"{label}.size")
    wanted = c.word(shape, c.add(f"%{label}.a", 2))
    c.branch(c.equal(c.word(sizes, f"%{label}.a"), wanted), f"{label}.fits", "python", then=f"{label}.fits")
    c.do(f"%{label}.a.next = add i64 %{label}.a, 1")
    c.jump(f"{label}.axis", then=f"{label}.end")


def _gather(c: _Writer, value: str, rank: str, amount: str) -> None:
    """Copy the numbers of an array of one or two axes to the stack, at ``%gathered``."""
    c.need(c.both(c.put(f"icmp ule i64 {amount}, {MOST_GATHERED}"), c.put(f"icmp ule i64 {c.add(rank, -1)}, 1")))
    room = c.put(f"alloca i8, i64 {amount}, align 8")
    data, shape, strides = (c.pointer(value, k) for k in (layout.DATA, layout.SHAPE, layout.STRIDES))
    before = c.block
    c.branch(c.equal(rank, 1), "of_vector", "of_matrix", then="of_matrix")
    rows, row_stride = c.word(shape, 0), c.word(strides, 0)
    c.jump("of_vector", then="of_vector")
    c.do(f"%rows = phi i64 [ 1, {before} ], [ {rows}, %of_matrix ]")
    c.do(f"%row.stride = phi i64 [ 0, {before} ], [ {row_stride}, %of_matrix ]")
    last = c.add(rank, -1)
    columns, stride = c.word(shape, last), c.word(strides, last)
    before = c.block
    c.jump("gather.row", then="gather.row")
    c.do(f"%x = phi i64 [ 0, {before} ], [ %x.next, %gather.next ]")
    c.do(f"%to.row = phi ptr [ {room}, {before} ], [ %to.x, %gather.next ]")
    c.branch(c.equal("%x", "%rows"), "gathered.all", "gather.begin", then="gather.begin")
    start = c.byte(data, c.times("%x", "%row.stride"))
    c.jump("gather.column", then="gather.column")
    c.do("%y = phi i64 [ 0, %gather.begin ], [ %y.next, %gather.one ]")
    c.do("%to.x = phi ptr [ %to.row, %gather.begin ], [ %to.next, %gather.one ]")
    c.branch(c.equal("%y", columns), "gather.next", "gather.one", then="gather.one")
    c.store("double", c.load("double", c.byte(start, c.times("%y", stride))), "%to.x")
    c.do("%to.next = getelementptr double, ptr %to.x, i64 1")
    c.do("%y.next = add i64 %y, 1")
    c.jump("gather.column", then="gather.next")
    c.do("%x.next = add i64 %x, 1")
    c.jump("gather.row", then="gathered.all")
    c.jump("gathered.end", then="gathered.end")
    c.do(f"%gathered = phi ptr [ {room}, %gathered.all ]")


def _tuple(c: _Writer, amount: str, k: str, item: Callable[[str], str]) -> None:
    """Return a new tuple of so many items."""
    made = c.put(f"call ptr {c.process('new_tuple')}(i64 {amount})")
    c.need(c.put(f"icmp ne ptr {made}, null"), "failed")
    items, before = c.at("i64", made, layout.ITEMS), c.block
    c.jump(f"filling.{k}", then=f"filling.{k}")
    c.do(f"%{k} = phi i64 [ 0, {before} ], [ %{k}.next, %fill.{k}.end ]")
    c.branch(c.equal(f"%{k}", amount), f"filled.{k}", f"fill.{k}", then=f"fill.{k}")
    c.store("ptr", item(f"%{k}"), c.at("ptr", items, f"%{k}"))
    c.jump(f"fill.{k}.end", then=f"fill.{k}.end")
    c.do(f"%{k}.next = add i64 %{k}, 1")
    c.jump(f"filling.{k}", then=f"filled.{k}")
    c.do(f"ret ptr {made}")


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
    return "\n".join([outside, _call(), *entries])

"""The words of forms and plans, which the builtin of public calls reads, and how its text reads them.

``single_call`` makes a *form* for a call's parameters and a *plan* for a model. A model keeps its plans in a dict,
under a string for each choice of optional inputs. If the call has words as parameters, such as a frame's name, the dict
holds there a dict of plans, whose key is the name alone, or a tuple of three words with None for each word left out.
"""

from __future__ import annotations

from .llvm_text import Body

# kinds of parameters: an array or another input that the plan describes; a float; a str, True or False; the result; an
# input that the plan holds, which no caller passes
ARRAY, NUMBER, WORD, OUT, FIXED = range(5)
MOST, MOST_OUTPUTS, MOST_WORDS = 16, 16, 3
PROCESS = (
    "none", "true", "false", "ndarray", "float64", "string", "real", "real64", "new_array", "up", "down", "lookup",
    "pack", "call", "new_float", "new_tuple", "integer", "as_size", "forget", "allocate",
    "attribute", "call_objects", "raise_interrupt",
)  # fmt: skip  # words of this process, which every form begins with
FOLLOWED = (
    "data_type", "runs", "attribute_name", "library", "run_plan", "noted", "after", "recompute", "held", "made",
    "edited", "switch", "off", "on",
)  # fmt: skip
FORM = (
    "python", "model_type", "plans", "plan", "count", "required", "optional", "choices", "named", "rest", "out",
    "before", "nones", *FOLLOWED,
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
#   nones        1 if None is a value like others; 0 if it stands for what is left out
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
#   entry    the compiled program, entry(context, inputs, outputs) -> 1, or 0 if it rejects the sample, or -1 if an
#            interrupt stopped it, which ``raise_interrupt`` then raises; and its context
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
PAIRS = len(PROCESS) + len(FORM)  # position in a form of the parameters
KEYS = PAIRS + 2 * MOST  # that of the dict's keys


class CallWriter(Body):
    """The text of ``call``; its parts name each other's blocks.

    block    the block that is being written, whose name a phi needs
    values   addresses of the argument objects, by parameter; ``%given`` has a bit for each that is not None
    inputs   addresses of the numbers of the inputs, ``sizes`` of their ends; ``%m`` counts them
    cells    words of inputs that are an index or a choice
    outputs  addresses of the numbers of the results; ``results`` their objects: null for a number, in ``number``
    kept     references to the plan of a model, or to the run of the data and to its plan, which other threads may
             replace while a program in plain Python runs; null without
    code     three words of the plan's program; ``record`` that of the plan; ``shapes`` of its results and inputs
    amount   number of results; ``several`` how they are returned
    """

    block = ""
    code: str
    record: str
    shapes: str
    amount: str
    several: str

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

    def either(self, a: str, b: str) -> str:
        return self.put(f"or i1 {a}, {b}")

    def bits(self, a: str, b: str | int) -> str:
        return self.put(f"and i64 {a}, {b}")

    def shifted(self, a: str, b: str) -> str:
        return self.put(f"lshr i64 {a}, {b}")

    def one_bit(self, k: str) -> str:
        return self.put(f"shl i64 1, {k}")

    def release(self) -> None:
        """Drop the references to a plan and a run, if any."""
        for cell in self.kept:
            self.do(f"call void {self.process('down')}(ptr {self.load('ptr', cell)})")  # null is allowed

    def need(self, condition: str, otherwise: str = "python") -> None:
        """Go on if the condition holds, else jump to a block."""
        self.branch(condition, f"on{len(self.lines)}", otherwise, then=f"on{len(self.lines)}")

"""LLVM text of the builtin of public calls: how it finds the plan, runs the program and follows the call.

``call_words`` says what it reads, ``call_arguments`` how it reads arguments, ``call_results`` how it makes results.
"""

from __future__ import annotations

from ... import object_layout as layout
from .call_results import ResultText
from .call_words import KEYS, MOST_WORDS, PLAN, RECORD
from .llvm_text import Body


class _Call(ResultText):
    """The text of ``call``, part by part."""

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
        self.do(f"call void {self.process('up')}(ptr %entry)")
        self.store("ptr", "%entry", self.kept[0])
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
        key = self.pointer("%form", self.add(choice, KEYS))
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
        self.release()  # of an earlier look-up
        for x, cell in zip((run, words), self.kept, strict=True):
            self.store("ptr", x, cell)
        plan, last = self.pointer(words, layout.DATA), self.block
        self.jump("planned", then="planning")
        self.do("unreachable")
        return run, plan, last

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

    # --- the call ------------------------------------------------------------------------------------------

    def run_program(self) -> None:
        """Run the program; if it does not answer, drop the results and call Python, or raise what stopped it."""
        program, context = (self.pointer(self.code, PLAN.index(x)) for x in ("entry", "context"))
        valid = self.put(f"call i64 {program}(ptr {context}, ptr {self.inputs}, ptr {self.outputs})")
        self.branch(self.put(f"icmp sle i64 {valid}, 0"), "release", "valid", then="release")
        self.do("%f = phi i64 [ 0, %run ], [ %f.next, %released ]")
        self.branch(self.equal("%f", self.amount), "dropped", "releasing", then="dropped")
        self.branch(self.equal(valid, 0), "python", "interrupted", then="interrupted")
        self._called(self.process("raise_interrupt"))
        self.jump("failed", then="releasing")
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
        self.release()
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
        self.release()
        self.do("ret ptr %answer.last")
        self.label("drop_answer")
        drop("%answer.last")
        self.jump("failed", then="unfollowed")
        self.do("unreachable")

    def call_python(self) -> None:
        """Call the Python function, for anything else."""
        self.label("python")
        self.release()
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

"""LLVM text of the function through which XLA runs a compiled program: a handler of its foreign function interface.

XLA passes a call frame, a C struct that holds the buffers and the functions of its interface. Every struct begins with
its size and a list of extensions. The version of the structs is 0.3 here; fields keep their places in all of version 0.

Source: OpenXLA, xla/ffi/api/c_api.h, which jaxlib has in ``jax.ffi.include_dir()``.
"""

from __future__ import annotations

from typing import NamedTuple

from .llvm_entry import ALIGNMENT, DATA_OFFSET, round_up
from .llvm_text import Body

VERSION = 0, 3
METADATA, EXECUTE, BUFFER = 1, 3, 1  # an extension's type, a stage, a type of arguments and results
FLOATS = {4: ("float", 11), 8: ("double", 12)}  # {bytes: LLVM's type, XLA's type}
INVALID_ARGUMENT, OUT_OF_MEMORY = 3, 8
# offsets of fields in bytes, of the struct that the name begins with, and the sizes of structs up to the last one used
FIELDS = {
    "frame.extension": 8, "frame.api": 16, "frame.ctx": 24, "frame.stage": 32, "frame.args": 40, "frame.rets": 80,
    "args.count": 16, "args.types": 24, "args.items": 32,
    "buffer.dtype": 16, "buffer.data": 24, "buffer.rank": 32, "buffer.dims": 40,
    "extension.type": 8, "extension.metadata": 24, "metadata.version": 8, "version.major": 16, "version.minor": 20,
    "api.version": 16, "api.error_create": 48, "api.error_destroy": 64, "api.schedule": 136,
}  # fmt: skip
SIZES = {"frame": 168, "args": 40, "buffer": 48, "metadata": 36, "api": 144, "version": 24, "error": 28, "task": 40}
WORDS = ("count", "bits", "rank", "dims")  # the callback's first words; inputs, rows and outputs follow
_CLOSED = 1 << 32  # in a call's word ``entered``: no work is left for threads that come later
_STATE = (
    "refs",
    "entered",
    "finished",
    "piece",
    "failed",
)  # words of a call that threads share; they follow an array's head


class Handler(NamedTuple):
    """The specification of a handler.

    inputs, outputs  (columns, axes of one sample) of each array
    size, buffers    bytes of a number of the program, and of one in XLA's buffers
    lanes, share     samples of a tile, and least tiles that a thread runs
    buffer           bytes of ``buffer_size``
    run, numbers     addresses of ``batch_entry``, and of an array object of the program's numbers
    callback         address of ``i64 callback(words)``, which recomputes rejected samples: 0, or a message's address
    allocate, free, give_way  addresses of functions like malloc, free and sched_yield
    threads          address of a word, the most threads
    recomputing      address of two words: whether callbacks are refused, and how many are running
    """

    inputs: tuple[tuple[int, int], ...]
    outputs: tuple[tuple[int, int], ...]
    size: int
    buffers: int
    lanes: int
    share: int
    buffer: int
    run: int
    numbers: int
    callback: int
    allocate: int
    free: int
    give_way: int
    threads: int
    recomputing: int


class _Writer(Body):
    def field(self, base: str, name: str, kind: str) -> str:
        return self.load(kind, self.byte(base, FIELDS[name]))

    def address(self, at: int) -> str:
        return self.put(f"inttoptr i64 {at} to ptr")

    def compare(self, how: str, a: str, b: str | int, kind: str = "i64") -> str:
        return self.put(f"icmp {how} {kind} {a}, {b}")

    def least(self, a: str, b: str) -> str:
        return self.put(f"select i1 {self.compare('slt', a, b)}, i64 {a}, i64 {b}")

    def atomic(self, how: str, at: str, by: int) -> str:
        return self.put(f"atomicrmw {how} ptr {at}, i64 {by} seq_cst")


def handler(made: Handler) -> str:
    """A module with ``ptr handler(ptr frame)``, which returns null or an error of XLA.

    A batch that is long enough is shared with tasks of XLA's thread pool, through a state on the heap. A task that
    begins when all work is done finds the state closed; the last task to leave frees the state. The callback, which
    takes the GIL, recomputes the samples that the program rejects.
    """
    return "\n".join((_COPY, _worker(made), _task(made), _metadata(), _failure(), _entry(made)))


def _places(made: Handler) -> dict[str, int]:
    """The offset in the state of the address of each array's data, and of each word; "end" is the end of the state."""
    names = [f"in{k}" for k in range(len(made.inputs))] + [f"out{k}" for k in range(len(made.outputs))]
    words = [*_STATE, "n", *(f"rows{k}" for k in range(len(made.inputs))), *names, "shared"]
    found = {name: 8 * k for k, name in enumerate(words)}
    found["end"] = round_up(8 * len(words))
    return found


def _worker(made: Handler) -> str:
    """``void @work(state, buffer)``: run tiles until none is left."""
    code, places = _Writer(), _places(made)
    code.label("start")
    own = code.put("alloca ptr")
    code.store("ptr", "%buffer", own)

    def array(name: str) -> str:
        """A pointer that ``batch_entry`` takes for an array object: the data's address is DATA_OFFSET behind it."""
        return code.byte("%state", places[name] - DATA_OFFSET)

    passed = ""
    for k in range(len(made.inputs)):
        rows = code.load("i64", code.byte("%state", places[f"rows{k}"]))
        passed += f"ptr {array(f'in{k}')}, i64 {rows}, "
    passed += "".join(f"ptr {array(f'out{k}')}, " for k in range(len(made.outputs)))
    passed += f"ptr {code.address(made.numbers)}, ptr {array('shared')}, ptr {code.byte(own, -DATA_OFFSET)}, "
    n, piece = (code.load("i64", code.byte("%state", places[x])) for x in ("n", "piece"))
    done = code.put(f"call i64 {code.address(made.run)}({passed}i64 {n}, i64 {piece})")
    code.branch(code.compare("eq", done, 0), "overlap", "end", then="overlap")
    code.atomic("add", code.byte("%state", places["failed"]), 1)
    code.jump("end", then="end")
    code.do("ret void")
    return code.function("define internal void @work(ptr %state, ptr %buffer)")


def _task(made: Handler) -> str:
    """``void @task(state)``: the task that XLA's thread pool runs."""
    code, places = _Writer(), _places(made)
    code.label("start")
    entered = code.atomic("add", code.byte("%state", places["entered"]), 1)
    code.branch(code.compare("ult", entered, _CLOSED), "share", "leave", then="share")
    buffers = code.byte("%state", places["end"])
    code.do(f"call void @work(ptr %state, ptr {code.byte(buffers, code.times(code.add(entered, 1), made.buffer))})")
    code.atomic("add", code.byte("%state", places["finished"]), 1)
    code.jump("leave", then="leave")
    code.do("call void @release(ptr %state)")
    code.do("ret void")
    text = code.function("define internal void @task(ptr %state)")
    code = _Writer()
    code.label("start")
    left = code.atomic("sub", code.byte("%state", places["refs"]), 1)
    code.branch(code.compare("eq", left, 1), "free", "end", then="free")
    code.do(f"call void {code.address(made.free)}(ptr %state)")
    code.jump("end", then="end")
    code.do("ret void")
    return text + code.function("define internal void @release(ptr %state)")


def _metadata() -> str:
    """``ptr @metadata(frame, extension)``: writes the handler's version; an error if XLA's structs are smaller."""
    code = _Writer()
    code.label("start")
    api = code.field("%frame", "frame.api", "ptr")
    version = code.byte(api, FIELDS["api.version"])
    metadata = code.field("%extension", "extension.metadata", "ptr")
    big = "true"
    for base, name in (("%frame", "frame"), (api, "api"), (metadata, "metadata"), (version, "version")):
        big = code.both(big, code.compare("uge", code.load("i64", base), SIZES[name]))
    major = code.field(version, "version.major", "i32")
    known = code.both(big, code.compare("eq", major, VERSION[0], "i32"))
    code.branch(known, "tell", "refuse", then="refuse")
    refused = code.put(f"call ptr @failure(ptr {api}, ptr @version.text, i32 {INVALID_ARGUMENT})")
    code.do(f"ret ptr {refused}")
    code.label("tell")
    minor = code.field(version, "version.minor", "i32")
    older = code.compare("slt", minor, VERSION[1], "i32")
    own = code.byte(metadata, FIELDS["metadata.version"])
    code.store("i32", str(VERSION[0]), code.byte(own, FIELDS["version.major"]))
    lower = code.put(f"select i1 {older}, i32 {minor}, i32 {VERSION[1]}")
    code.store("i32", lower, code.byte(own, FIELDS["version.minor"]))
    code.do("ret ptr null")
    return code.function("define internal ptr @metadata(ptr %frame, ptr %extension)")


def _failure() -> str:
    """``ptr @failure(api, message, code)``: an error of XLA, which copies the message."""
    code = _Writer()
    code.label("start")
    given = code.put("alloca [32 x i8], align 8")
    for kind, value, at in (
        ("i64", str(SIZES["error"]), 0), ("ptr", "null", 8), ("ptr", "%message", 16), ("i32", "%code", 24),
    ):  # fmt: skip
        code.store(kind, value, code.byte(given, at))
    create = code.field("%api", "api.error_create", "ptr")
    code.do(f"ret ptr {code.put(f'call ptr {create}(ptr {given})')}")
    return code.function("define internal ptr @failure(ptr %api, ptr %message, i32 %code)")


def _entry(made: Handler) -> str:
    """``ptr @handler(frame)``."""
    c, converts = _Writer(), made.size != made.buffers
    ins, outs = [f"in{k}" for k in range(len(made.inputs))], [f"out{k}" for k in range(len(made.outputs))]
    arrays = dict(zip([*ins, *outs], [*made.inputs, *made.outputs], strict=True))
    c.label("start")
    words = c.put(f"alloca [{len(WORDS) + 2 * len(ins) + len(outs)} x i64]")
    given = c.put(f"alloca [{SIZES['task']} x i8], align 8")
    api = c.field("%frame", "frame.api", "ptr")
    _answer_query(c)
    buffer, data, rows = _read_buffers(c, made.buffers, ins, outs, arrays)
    n = rows[outs[0]]
    tiles = c.put(f"sdiv i64 {c.add(n, made.lanes - 1)}, {made.lanes}")
    threads = _thread_count(c, made, tiles)
    state, shared, own = _allocate(c, made, arrays if converts else {}, rows, tiles, threads)
    for k, x in enumerate(ins):
        if converts:
            numbers = c.times(rows[x], arrays[x][0])
            _converted(c, f"read.{x}", data[x], made.buffers, own[x], made.size, numbers)
        c.store("i64", rows[x], c.byte(state, _places(made)[f"rows{k}"]))
    data_of = data | own
    _write_state(c, made, state, data_of, shared, n, tiles, threads)
    _share_work(c, made, api, given, state, threads)
    message, running = _recompute(c, made, words, buffer[outs[0]], data_of, rows, shared, tiles)
    beyond = "0"
    for x in outs if converts else ():
        numbers = c.times(rows[x], arrays[x][0])
        wide = _converted(c, f"write.{x}", own[x], made.size, data[x], made.buffers, numbers)
        beyond = c.put(f"or i8 {beyond}, {wide}")
    c.branch(c.compare("eq", beyond, 0, "i8"), "free", "beyond", then="free")
    c.do(f"call void @release(ptr {state})")
    c.jump("none", then="none")
    c.do("ret ptr null")
    _write_failures(c, api, state, message, running)
    return c.function("define ptr @handler(ptr %frame)")


def _answer_query(c: _Writer) -> None:
    """Return the handler's version if the frame is a query of metadata."""
    extension = c.field("%frame", "frame.extension", "ptr")
    c.branch(c.compare("eq", extension, "null", "ptr"), "plain", "extended", then="extended")
    is_query = c.compare("eq", c.field(extension, "extension.type", "i32"), METADATA, "i32")
    c.branch(is_query, "query", "plain", then="query")
    c.do(f"ret ptr {c.put(f'call ptr @metadata(ptr %frame, ptr {extension})')}")
    c.label("plain")


def _read_buffers(
    c: _Writer, size: int, ins: list[str], outs: list[str], arrays: dict[str, tuple[int, int]]
) -> tuple[dict[str, str], dict[str, str], dict[str, str]]:
    """XLA's buffer, the address of its data, and the rows of each array.

    Goes to "unknown" if buffers are not as many, or not of the type, axes and rows that the program takes; to "none"
    without samples. Axes are read within the structs.
    """
    args, rets = (c.byte("%frame", FIELDS[f"frame.{x}"]) for x in ("args", "rets"))
    right = c.compare("uge", c.load("i64", "%frame"), SIZES["frame"])
    for base, count in ((args, len(ins)), (rets, len(outs))):
        right = c.both(right, c.compare("eq", c.field(base, "args.count", "i64"), count))
    c.branch(right, "counted", "unknown", then="counted")
    buffer = {}
    right = "true"
    for base, names in ((args, ins), (rets, outs)):
        items, types = (c.field(base, f"args.{x}", "ptr") for x in ("items", "types"))
        for k, x in enumerate(names):
            right = c.both(right, c.compare("eq", c.load("i32", c.at("i32", types, k)), BUFFER, "i32"))
            buffer[x] = c.load("ptr", c.at("ptr", items, k))
    c.branch(right, "typed", "unknown", then="typed")
    right, data = "true", {}
    for x, (_, axes) in arrays.items():
        dtype, rank = c.field(buffer[x], "buffer.dtype", "i32"), c.field(buffer[x], "buffer.rank", "i64")
        right = c.both(right, c.compare("eq", dtype, FLOATS[size][1], "i32"))
        right = c.both(right, c.compare("sge", rank, axes))
        data[x] = c.field(buffer[x], "buffer.data", "ptr")
    c.branch(right, "ranked", "unknown", then="ranked")
    rows = {x: _rows(c, x, buffer[x], axes) for x, (_, axes) in arrays.items()}
    n = rows[outs[0]]
    c.branch(c.compare("sgt", n, 0), "some", "none", then="some")
    right = "true"
    for x in ins:
        full, shared = c.compare("eq", rows[x], n), c.compare("eq", rows[x], 1)
        right = c.both(right, c.put(f"or i1 {full}, {shared}"))
    c.branch(right, "shaped", "unknown", then="shaped")
    return buffer, data, rows


def _thread_count(c: _Writer, made: Handler, tiles: str) -> str:
    """The number of threads that share the tiles."""
    shares = c.put(f"sdiv i64 {tiles}, {made.share}")
    limit = c.load("i64", c.address(made.threads))
    some = c.least(c.put(f"select i1 {c.compare('sgt', shares, 1)}, i64 {shares}, i64 1"), limit)
    return c.put(f"select i1 {c.compare('sgt', some, 1)}, i64 {some}, i64 1")


def _allocate(
    c: _Writer, made: Handler, converted: dict[str, tuple[int, int]], rows: dict[str, str], tiles: str, threads: str
) -> tuple[str, str, dict[str, str]]:
    """The state on the heap: its address, that of the words that threads share, and those of converted numbers.

    It holds a buffer for each thread, the bits of all tiles, and the numbers that are converted. Goes to "full" if
    there is no memory.
    """
    behind = c.add(c.times(threads, made.buffer), _places(made)["end"] + ALIGNMENT)
    total = c.add(c.add(behind, c.times(tiles, 2)), 8 + ALIGNMENT)
    total = c.put(f"and i64 {total}, {-ALIGNMENT}")
    own_at = {}
    for x, (columns, _) in converted.items():
        own_at[x] = total
        total = c.add(total, c.put(f"and i64 {c.add(c.times(rows[x], columns * made.size), ALIGNMENT)}, {-ALIGNMENT}"))
    state = c.put(f"call ptr {c.address(made.allocate)}(i64 {total})")
    c.branch(c.compare("eq", state, "null", "ptr"), "full", "held", then="held")
    shared = c.byte(state, behind)
    c.store("i64", "0", shared, 1)
    return state, shared, {x: c.byte(state, at) for x, at in own_at.items()}


def _write_state(
    c: _Writer, made: Handler, state: str, data: dict[str, str], shared: str, n: str, tiles: str, threads: str
) -> None:
    """Write the addresses of the numbers and the words of the call to the state."""

    def at(name: str) -> str:
        return c.byte(state, _places(made)[name])

    for x in data:
        c.store("ptr", data[x], at(x))
    c.store("ptr", shared, at("shared"))
    for name, value in (("entered", "0"), ("finished", "0"), ("failed", "0"), ("n", n), ("refs", threads)):
        c.store("i64", value, at(name))
    several = c.compare("sgt", threads, 1)
    part = c.put(f"sdiv i64 {tiles}, {c.times(threads, 4)}")
    c.store("i64", c.put(f"select i1 {several}, i64 {part}, i64 {tiles}"), at("piece"))


def _share_work(c: _Writer, made: Handler, api: str, given: str, state: str, threads: str) -> None:
    """Run the tiles, on as many other threads as XLA provides too; goes to "overlap" if arrays overlap."""

    def at(name: str) -> str:
        return c.byte(state, _places(made)[name])

    before = _block(c)
    c.jump("more", then="more")
    c.do(f"%other = phi i64 [ 1, %{before} ], [ %other.next, %scheduled ]")
    c.branch(c.compare("slt", "%other", threads), "schedule", "run", then="schedule")
    context = c.field("%frame", "frame.ctx", "ptr")
    for kind, value, place in (
        ("i64", str(SIZES["task"]), 0), ("ptr", "null", 8), ("ptr", context, 16), ("ptr", "@task", 24),
        ("ptr", state, 32),
    ):  # fmt: skip
        c.store(kind, value, c.byte(given, place))
    refused = c.put(f"call ptr {c.field(api, 'api.schedule', 'ptr')}(ptr {given})")
    c.branch(c.compare("eq", refused, "null", "ptr"), "scheduled", "alone", then="alone")
    for kind, value, place in (("i64", "24", 0), ("ptr", "null", 8), ("ptr", refused, 16)):
        c.store(kind, value, c.byte(given, place))
    c.do(f"call void {c.field(api, 'api.error_destroy', 'ptr')}(ptr {given})")
    c.atomic("sub", at("refs"), 1)
    c.jump("scheduled", then="scheduled")
    c.do("%other.next = add i64 %other, 1")
    c.jump("more", then="run")
    c.do(f"call void @work(ptr {state}, ptr {at('end')})")
    entered = c.atomic("or", at("entered"), _CLOSED)
    c.jump("wait", then="wait")
    finished = c.put(f"load atomic i64, ptr {at('finished')} seq_cst, align 8")
    c.branch(c.compare("eq", finished, entered), "done", "sleep", then="sleep")
    c.do(f"call i32 {c.address(made.give_way)}()")
    c.jump("wait", then="done")
    c.branch(c.compare("eq", c.load("i64", at("failed")), 0), "check", "overlap", then="check")


def _recompute(
    c: _Writer, made: Handler, words: str, out: str, data: dict[str, str], rows: dict[str, str], shared: str, tiles: str
) -> tuple[str, str]:
    """Call back for the samples that the program rejects; goes to "late" if Python ends, to "wrong" with a message.

    out  XLA's buffer of the first result

    Returns the address of the message, and that of the number of callbacks that are running.
    """
    whole, flags = (1 << made.lanes) - 1, c.byte(shared, 8)
    c.jump("bits", then="bits")
    c.do("%tile = phi i64 [ 0, %check ], [ %tile.next, %bits.more ]")
    c.branch(c.compare("slt", "%tile", tiles), "bits.more", "fine", then="bits.more")
    found = c.load("i16", c.at("i16", flags, "%tile"), 1)
    c.do("%tile.next = add i64 %tile, 1")
    c.branch(c.compare("eq", found, _signed16(whole), "i16"), "bits", "rejected", then="rejected")
    rank, dims = c.field(out, "buffer.rank", "i64"), c.field(out, "buffer.dims", "ptr")
    rank = c.add(rank, -made.outputs[0][1])
    ins, outs = [f"in{k}" for k in range(len(made.inputs))], [f"out{k}" for k in range(len(made.outputs))]
    told = [rows[outs[0]], flags, rank, dims, *(data[x] for x in ins), *(rows[x] for x in ins)]
    told += [data[x] for x in outs]
    pointers = {flags, dims, *data.values()}
    for k, word in enumerate(told):
        c.store("ptr" if word in pointers else "i64", word, c.at("i64", words, k))
    ending, running = c.address(made.recomputing), c.address(made.recomputing + 8)
    c.atomic("add", running, 1)  # before the other word is read, which ``end`` writes first
    ended = c.put(f"load atomic i64, ptr {ending} seq_cst, align 8")
    c.branch(c.compare("eq", ended, 0), "recompute", "late", then="recompute")
    message = c.put(f"call i64 {c.address(made.callback)}(ptr {words})")
    c.atomic("sub", running, 1)
    c.branch(c.compare("eq", message, 0), "fine", "wrong", then="fine")
    return message, running


def _write_failures(c: _Writer, api: str, state: str, message: str, running: str) -> None:
    """Write the blocks that return an error."""
    c.label("wrong")
    text = c.put(f"inttoptr i64 {message} to ptr")
    c.do(f"call void @release(ptr {state})")
    c.do(f"ret ptr {c.put(f'call ptr @failure(ptr {api}, ptr {text}, i32 {INVALID_ARGUMENT})')}")
    c.label("late")
    c.atomic("sub", running, 1)
    c.jump("ending", then="ending")
    for label in ("ending", "overlap", "beyond"):
        if label != "ending":
            c.label(label)
        c.do(f"call void @release(ptr {state})")
        c.do(f"ret ptr {c.put(f'call ptr @failure(ptr {api}, ptr @{label}.text, i32 {INVALID_ARGUMENT})')}")
    for label, name, errc in (("unknown", "frame", INVALID_ARGUMENT), ("full", "memory", OUT_OF_MEMORY)):
        c.label(label)
        c.do(f"ret ptr {c.put(f'call ptr @failure(ptr {api}, ptr @{name}.text, i32 {errc})')}")


def _block(code: Body) -> str:
    """The block that is being written."""
    return next(line for line in reversed(code.lines) if line.endswith(":"))[:-1]


def _signed16(bits: int) -> int:
    return bits - (1 << 16) if bits >> 15 else bits


def _rows(c: _Writer, name: str, buffer: str, axes: int) -> str:
    """The product of a buffer's axes before those of one sample."""
    rank, dims = c.field(buffer, "buffer.rank", "i64"), c.field(buffer, "buffer.dims", "ptr")
    lead = c.add(rank, -axes)
    before = _block(c)
    c.jump(f"{name}.axes", then=f"{name}.axes")
    c.do(f"%{name}.k = phi i64 [ 0, %{before} ], [ %{name}.next, %{name}.axis ]")
    c.do(f"%{name}.rows = phi i64 [ 1, %{before} ], [ %{name}.more, %{name}.axis ]")
    c.branch(c.compare("slt", f"%{name}.k", lead), f"{name}.axis", f"{name}.counted", then=f"{name}.axis")
    c.do(f"%{name}.next = add i64 %{name}.k, 1")
    c.do(f"%{name}.more = mul i64 %{name}.rows, {c.load('i64', c.at('i64', dims, f'%{name}.k'))}")
    c.jump(f"{name}.axes", then=f"{name}.counted")
    return f"%{name}.rows"


def _converted(c: _Writer, name: str, source: str, size: int, to: str, into: int, count: str) -> str:
    """Convert so many numbers, eight at a time and the rest one by one; an i8 above 0 if a finite one gets infinite."""
    one, other = FLOATS[size][0], FLOATS[into][0]
    narrows = into < size
    eights = c.put(f"and i64 {count}, -8")
    before, beyond = _block(c), "0"
    for step, end in ((8, eights), (1, count)):
        start = "0" if step == 8 else f"%{name}.8"
        a, b = (one, other) if step == 1 else (f"<8 x {one}>", f"<8 x {other}>")
        found = f"%{name}.{step}.beyond"
        c.jump(f"{name}.{step}.loop", then=f"{name}.{step}.loop")
        c.do(f"%{name}.{step} = phi i64 [ {start}, %{before} ], [ %{name}.{step}.next, %{name}.{step}.one ]")
        c.do(f"{found} = phi i8 [ {beyond}, %{before} ], [ {found}.next, %{name}.{step}.one ]")
        more = c.compare("slt", f"%{name}.{step}", end)
        c.branch(more, f"{name}.{step}.one", f"{name}.{step}.end", then=f"{name}.{step}.one")
        x = c.load(a, c.at(one, source, f"%{name}.{step}"), size)
        y = c.put(f"{'fptrunc' if narrows else 'fpext'} {a} {x} to {b}")
        c.store(b, y, c.at(other, to, f"%{name}.{step}"), into)
        here = "0"
        if narrows:  # x - x is 0 for finite numbers, else NaN
            finite = c.put(f"fcmp ord {a} {c.put(f'fsub {a} {x}, {x}')}, zeroinitializer")
            other_is_not = c.put(f"fcmp uno {b} {c.put(f'fsub {b} {y}, {y}')}, zeroinitializer")
            flags = "i1" if step == 1 else "<8 x i1>"
            lost = c.put(f"and {flags} {finite}, {other_is_not}")
            here = c.put(f"zext i1 {lost} to i8" if step == 1 else f"bitcast <8 x i1> {lost} to i8")
        c.do(f"{found}.next = or i8 {found}, {here}")
        c.do(f"%{name}.{step}.next = add i64 %{name}.{step}, {step}")
        c.jump(f"{name}.{step}.loop", then=f"{name}.{step}.end")
        before, beyond = f"{name}.{step}.end", found
    return beyond


def _text(name: str, text: str) -> str:
    data = text.encode() + b"\0"
    shown = "".join(chr(b) if 32 <= b < 127 and b not in b'"\\' else f"\\{b:02X}" for b in data)
    return f'@{name}.text = internal constant [{len(data)} x i8] c"{shown}"\n'


_COPY = (
    _text("version", "XLA's foreign function interface has another layout than its version 0.3")
    + _text("frame", "a call of a program has other buffers than the program's")
    + _text("memory", "no memory is left for a program's workspace")
    + _text("overlap", "a result overlaps another array in memory")
    + _text("beyond", "a result is beyond the range of float32, expected inputs of float64")
    + _text("ending", "samples beyond a program's range are not recomputed while Python ends")
)

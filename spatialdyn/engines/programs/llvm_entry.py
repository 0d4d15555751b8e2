"""LLVM text of the functions through which Python runs a compiled program: over a batch, and step after step.

ctypes hands them the arrays as they are, as objects: asking NumPy for an address takes 1 µs, reading it here takes
nothing. What NumPy keeps first in an array object is the address of its data (the fields of a PyArrayObject, part
of NumPy's C interface).
"""

from __future__ import annotations

from collections.abc import Sequence

DATA = object.__basicsize__  # where in an array object the address of its data is
BOUNDARY = 64


def padded(size: int) -> int:
    """Bytes up to the next boundary."""
    return size + -size % BOUNDARY


def room(inputs: Sequence[int], outputs: Sequence[int], workspace: int, lanes: int, size: int) -> int:
    """Bytes that ``entry`` and ``loop`` need beside the bits of the tiles: a workspace, and a tile of each array."""
    return 2 * BOUNDARY + padded(workspace) + sum(padded(lanes * k * size) for k in (*inputs, *outputs))


class _Code:
    """Lines of a function body, names made up as they come."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def put(self, text: str) -> str:
        self.lines.append(f"  %t{len(self.lines)} = {text}")
        return f"%t{len(self.lines) - 1}"

    def do(self, text: str) -> None:
        self.lines.append(f"  {text}")

    def block(self, jump: str, name: str) -> None:
        self.lines += [f"  br {jump}", f"{name}:"]

    def byte(self, base: str, offset: str | int) -> str:
        """The address so many bytes on."""
        return self.put(f"getelementptr i8, ptr {base}, i64 {offset}")

    def data(self, array: str) -> str:
        """The address of an array's data."""
        return self.put(f"load ptr, ptr {self.byte(array, DATA)}")

    def times(self, a: str | int, b: str | int) -> str:
        return self.put(f"mul i64 {a}, {b}")

    def copy(self, to: str, start: str, count: str | int) -> None:
        self.do(f"call void @llvm.memcpy.p0.p0.i64(ptr {to}, ptr {start}, i64 {count}, i1 false)")

    def boundary(self, address: str) -> str:
        """The next boundary behind an address."""
        behind = self.put(f"add i64 {self.put(f'ptrtoint ptr {address} to i64')}, {BOUNDARY + 1}")
        return self.put(f"inttoptr i64 {self.put(f'and i64 {behind}, {-BOUNDARY}')} to ptr")


def entry(inputs: Sequence[int], outputs: Sequence[int], workspace: int, lanes: int, size: int) -> str:
    """``entry(*(input, rows), *outputs, room, n) -> 1``, or 0 if an output overlaps anything, doing nothing.

    inputs, outputs  columns of the arrays, which are in C order
    rows             n, or 1 for an input that serves all samples
    room             takes a bit a sample, 16 bits a tile, and behind them what ``room`` counts

    Samples that do not fill the last tile run on copies, filled up with the last of them.
    """
    ins = {f"in{a}": columns * size for a, columns in enumerate(inputs)}
    outs = {f"out{a}": columns * size for a, columns in enumerate(outputs)}
    rows = {**ins, **outs}
    code = _Code()
    put, byte, times = code.put, code.byte, code.times

    def call(tiles: str | int, at: dict[str, str], steps: dict[str, str], bits: str) -> None:
        passed = "".join(f"ptr {at[x]}, i64 {steps[x]}, " for x in ins) + "".join(f"ptr {at[y]}, " for y in outs)
        code.do(f"call void @kernel(i64 {tiles}, {passed}ptr {bits}, ptr {work})")

    data = {x: code.data(f"%{x}") for x in [*rows, "room"]}
    count = {x: f"%{x}.rows" if x in ins else "%n" for x in rows}
    end = {x: byte(data[x], times(count[x], rows[x])) for x in rows}
    apart = "true"
    for k, y in enumerate(outs):
        for x in [*ins, *list(outs)[:k]]:
            before, behind = (put(f"icmp ule ptr {a}, {b}") for a, b in ((end[x], data[y]), (end[y], data[x])))
            apart = put(f"and i1 {apart}, {put(f'or i1 {before}, {behind}')}")
    code.block(f"i1 {apart}, label %run, label %refuse", "refuse")
    code.lines += ["  ret i64 0", "run:"]
    tiles = put(f"sdiv i64 %n, {lanes}")
    first = times(tiles, lanes)
    rest = put(f"sub i64 %n, {first}")
    last = byte(data["room"], times(tiles, 2))
    work = code.boundary(last)
    several = {x: put(f"icmp sgt i64 {count[x]}, 1") for x in ins}
    call(tiles, data, {x: put(f"select i1 {several[x]}, i64 {ins[x] // size}, i64 0") for x in ins}, data["room"])
    code.block(f"i1 {put(f'icmp eq i64 {rest}, 0')}, label %done, label %tail", "tail")
    offset, tile = padded(workspace), {}
    for x, row in rows.items():
        tile[x] = byte(work, offset)
        offset += padded(lanes * row)
    for x, row in ins.items():
        step = put(f"select i1 {several[x]}, i64 {row}, i64 0")
        for r in range(lanes):
            there = put(f"icmp slt i64 {r}, {rest}")
            sample = put(f"select i1 {there}, i64 {put(f'add i64 {first}, {r}')}, i64 {put('sub i64 %n, 1')}")
            code.copy(byte(tile[x], r * row), byte(data[x], times(sample, step)), row)
    call(1, tile, {x: str(row // size) for x, row in ins.items()}, last)
    for y, row in outs.items():
        code.copy(byte(data[y], times(first, row)), tile[y], times(rest, row))
    code.block("label %done", "done")
    given = "".join(f"ptr %{x}, i64 %{x}.rows, " for x in ins) + "".join(f"ptr %{y}, " for y in outs)
    return _function("entry", f"{given}ptr %room, i64 %n", code, "ret i64 1")


def loop(states: Sequence[int], inputs: int, workspace: int, lanes: int, size: int) -> str:
    """``loop(kernel, *states, *(input, sample, time), *records, *ends, room, first, end, n, steps, every, kept)``:
    tiles, each through all steps before the next, by a program whose outputs are its first inputs anew.

    states        columns of the states, arrays (n, columns) in C order
    kernel        the program's address; its inputs are the states, then the others
    sample, time  how many numbers on the row of an input for the next sample and the next step is
    records       arrays (n, kept, columns), or from a row on: the states after each so many steps
    ends          arrays (n, columns): the states after all steps
    room          takes a bit a sample, 16 bits a tile, and behind them what ``room`` counts
    first, end    tiles to run; the last tile of all ends with sample n >= lanes, and so overlaps the one before it
    """
    wide = [columns * size for columns in states]
    xs = [f"%x{k}" for k in range(inputs)]
    code = _Code()
    put, byte, times = code.put, code.byte, code.times
    start = [code.data(f"%s{k}") for k in range(len(states))]
    data = [code.data(x) for x in xs]
    records = [code.data(f"%r{k}") for k in range(len(states))]
    ends = [code.data(f"%e{k}") for k in range(len(states))]
    bits = code.data("%room")
    flag = byte(bits, times(put("sub i64 %end, %first"), 2))
    work = code.boundary(byte(flag, 2))
    offset, buffers = padded(workspace), []
    for row in [*wide, *wide]:
        buffers.append(byte(work, offset))
        offset += padded(lanes * row)
    here, there = buffers[: len(wide)], buffers[len(wide) :]
    code.block("label %tiles", "tiles")
    code.do("%tile = phi i64 [ %first, %start ], [ %tile.next, %tile.done ]")
    code.block(f"i1 {put('icmp slt i64 %tile, %end')}, label %tile.run, label %done", "tile.run")
    at, most = times("%tile", lanes), put(f"sub i64 %n, {lanes}")
    sample = put(f"select i1 {put(f'icmp slt i64 {at}, {most}')}, i64 {at}, i64 {most}")
    for buffer, source, row in zip(here, start, wide, strict=True):
        code.copy(buffer, byte(source, times(sample, row)), lanes * row)
    base = [byte(d, times(times(sample, f"{x}.sample"), size)) for d, x in zip(data, xs, strict=True)]
    code.block("label %step", "step")
    code.do("%t = phi i64 [ 0, %tile.run ], [ %t.next, %stepped ]")
    code.do("%fine = phi i16 [ -1, %tile.run ], [ %fine.next, %stepped ]")
    code.do("%record = phi i64 [ 0, %tile.run ], [ %record.next, %stepped ]")
    for k, (a, b) in enumerate(zip(here, there, strict=True)):
        code.do(f"%a{k} = phi ptr [ {a}, %tile.run ], [ %b{k}, %stepped ]")
        code.do(f"%b{k} = phi ptr [ {b}, %tile.run ], [ %a{k}, %stepped ]")
    passed = "".join(f"ptr %a{k}, i64 {columns}, " for k, columns in enumerate(states))
    for x, b in zip(xs, base, strict=True):
        passed += f"ptr {byte(b, times(times('%t', f'{x}.time'), size))}, i64 {x}.sample, "
    passed += "".join(f"ptr %b{k}, " for k in range(len(states)))
    code.do(f"call void %kernel(i64 1, {passed}ptr {flag}, ptr {work})")
    code.do(f"%fine.next = and i16 %fine, {put(f'load i16, ptr {flag}')}")
    code.do("%t.next = add i64 %t, 1")
    code.do("%record.next = sdiv i64 %t.next, %every")
    due = put("icmp sgt i64 %record.next, %record")
    code.block(f"i1 {due}, label %keep, label %stepped", "keep")
    for k, row in enumerate(wide):
        for r in range(lanes):
            place = put(f"add i64 {times(put(f'add i64 {sample}, {r}'), '%kept')}, %record")
            code.copy(byte(records[k], times(place, row)), byte(f"%b{k}", r * row), row)
    code.block("label %stepped", "stepped")
    code.block(f"i1 {put('icmp slt i64 %t.next, %steps')}, label %step, label %tile.done", "tile.done")
    for k, (done, row) in enumerate(zip(ends, wide, strict=True)):
        code.copy(byte(done, times(sample, row)), f"%b{k}", lanes * row)
    code.do(f"store i16 %fine.next, ptr {byte(bits, times(put('sub i64 %tile, %first'), 2))}")
    code.do("%tile.next = add i64 %tile, 1")
    code.block("label %tiles", "done")
    given = "".join(f"ptr %s{k}, " for k in range(len(states)))
    given += "".join(f"ptr {x}, i64 {x}.sample, i64 {x}.time, " for x in xs)
    given += "".join(f"ptr %{x}{k}, " for x in "re" for k in range(len(states)))
    numbers = ", ".join(f"i64 %{x}" for x in ("first", "end", "n", "steps", "every", "kept"))
    return _function("loop", f"ptr %kernel, {given}ptr %room, {numbers}", code, "ret void", "void")


def _function(name: str, parameters: str, code: _Code, end: str, kind: str = "i64") -> str:
    body = "\n".join([*code.lines, f"  {end}"])
    return f"""
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
define {kind} @{name}({parameters}) {{
start:
{body}
}}
"""

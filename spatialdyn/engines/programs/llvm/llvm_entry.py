"""LLVM text of the functions through which Python runs a compiled program: over a batch, and in a time loop.

ctypes passes the array objects themselves: reading the address of the data here costs nothing, while NumPy takes long
to return it. The address is the first field of a PyArrayObject, which is part of NumPy's C interface.
"""

from __future__ import annotations

from collections.abc import Sequence

from .llvm_text import Body

DATA_OFFSET = object.__basicsize__  # offset of the data's address in an array object
ALIGNMENT = 64


def round_up(size: int) -> int:
    """A size rounded up to a multiple of ALIGNMENT."""
    return size + -size % ALIGNMENT


def buffer_size(inputs: Sequence[int], outputs: Sequence[int], workspace: int, lanes: int, size: int) -> int:
    """Bytes that ``batch_entry`` and ``time_loop_entry`` need in addition to the bits of the tiles.

    They hold a workspace, and a tile of each array.
    """
    tiles = sum(round_up(lanes * k * size) for k in (*inputs, *outputs))
    return 2 * ALIGNMENT + round_up(workspace) + tiles


def _data(code: Body, array: str) -> str:
    """The address of an array's data."""
    return code.load("ptr", code.byte(array, DATA_OFFSET))


def batch_entry(inputs: Sequence[int], outputs: Sequence[int], workspace: int, lanes: int, size: int) -> str:
    """``batch_entry(*(input, rows), *outputs, numbers, shared, buffer, n, piece) -> 1``, or 0 if an output overlaps.

    The function does nothing if an output overlaps another array. Several threads may call it at once with the same
    arrays: each thread takes pieces until none is left.

    inputs, outputs  columns of the arrays, which are in C order
    rows             n, or 1 for an input that all samples share
    numbers          the numbers of the program
    shared           8 bytes: the next tile that no thread has taken, at first 0; then a bit per sample, 16 bits a tile
    buffer           ``buffer_size`` bytes of the thread's own
    piece            tiles that a thread takes at once

    Samples that do not fill the last tile run on copies, padded with the last sample.
    """
    ins = {f"in{a}": columns * size for a, columns in enumerate(inputs)}
    outs = {f"out{a}": columns * size for a, columns in enumerate(outputs)}
    rows = {**ins, **outs}
    code = Body()
    code.label("start")
    put, byte, times = code.put, code.byte, code.times

    def call(tiles: str | int, at: dict[str, str], steps: dict[str, str], bits: str) -> None:
        passed = "".join(f"ptr {at[x]}, i64 {steps[x]}, " for x in ins) + "".join(f"ptr {at[y]}, " for y in outs)
        code.do(f"call void @kernel(i64 {tiles}, {passed}ptr {bits}, ptr {work}, ptr {data['numbers']})")

    data = {x: _data(code, f"%{x}") for x in [*rows, "numbers", "shared", "buffer"]}
    count = {x: f"%{x}.rows" if x in ins else "%n" for x in rows}
    end = {x: byte(data[x], times(count[x], rows[x])) for x in rows}
    disjoint = "true"
    for k, y in enumerate(outs):
        for x in [*ins, *list(outs)[:k]]:
            before, behind = (put(f"icmp ule ptr {a}, {b}") for a, b in ((end[x], data[y]), (end[y], data[x])))
            disjoint = put(f"and i1 {disjoint}, {put(f'or i1 {before}, {behind}')}")
    code.branch(disjoint, "begin", "overlap", then="overlap")
    code.do("ret i64 0")
    code.label("begin")
    bits, work = byte(data["shared"], 8), code.boundary(data["buffer"], ALIGNMENT)
    full = put(f"sdiv i64 %n, {lanes}")
    first = times(full, lanes)
    rest = put(f"sub i64 %n, {first}")
    partial = put(f"icmp ne i64 {rest}, 0")
    tiles = code.add(full, put(f"zext i1 {partial} to i64"))
    several = {x: put(f"icmp sgt i64 {count[x]}, 1") for x in ins}
    step = {x: put(f"select i1 {several[x]}, i64 {ins[x] // size}, i64 0") for x in ins}
    wide = {x: times(step[x], size) if x in ins else str(outs[x]) for x in rows}
    code.jump("next", then="next")
    tile = put(f"atomicrmw add ptr {data['shared']}, i64 %piece monotonic")
    code.branch(put(f"icmp slt i64 {tile}, {tiles}"), "run", "done", then="run")
    behind = code.add(tile, "%piece")
    whole = put(f"select i1 {put(f'icmp slt i64 {behind}, {full}')}, i64 {behind}, i64 {full}")
    sample = times(tile, lanes)
    here = {x: byte(data[x], times(sample, wide[x])) for x in rows}
    call(put(f"sub i64 {whole}, {tile}"), here, step, byte(bits, times(tile, 2)))
    past = put(f"icmp sgt i64 {behind}, {full}")
    code.branch(put(f"and i1 {past}, {partial}"), "tail", "next", then="tail")
    offset, copies = round_up(workspace), {}
    for x, row in rows.items():
        copies[x] = byte(work, offset)
        offset += round_up(lanes * row)
    for x, row in ins.items():
        for r in range(lanes):
            there = put(f"icmp slt i64 {r}, {rest}")
            at = put(f"select i1 {there}, i64 {code.add(first, r)}, i64 {put('sub i64 %n, 1')}")
            code.copy(byte(copies[x], r * row), byte(data[x], times(at, wide[x])), row)
    call(1, copies, {x: str(row // size) for x, row in ins.items()}, byte(bits, times(full, 2)))
    for y, row in outs.items():
        code.copy(byte(data[y], times(first, row)), copies[y], times(rest, row))
    code.jump("next", then="done")
    code.do("ret i64 1")
    given = "".join(f"ptr %{x}, i64 %{x}.rows, " for x in ins) + "".join(f"ptr %{y}, " for y in outs)
    return _COPY + code.function(
        f"define i64 @batch_entry({given}ptr %numbers, ptr %shared, ptr %buffer, i64 %n, i64 %piece)"
    )


def one_entry(inputs: Sequence[int], outputs: Sequence[int], workspace: int) -> str:
    """``one_entry(numbers, inputs, outputs) -> 1``, or 0 if the sample is rejected: a program on one lane.

    numbers          address of the numbers of the program
    inputs, outputs  addresses of the arrays of one sample
    """
    code = Body()
    code.label("start")
    bits = code.put("alloca i16")
    work = code.put(f"alloca [{round_up(max(workspace, 1))} x i8], align {ALIGNMENT}")
    ins = [code.load("ptr", code.at("ptr", "%inputs", k)) for k in range(len(inputs))]
    outs = [code.load("ptr", code.at("ptr", "%outputs", k)) for k in range(len(outputs))]
    passed = "".join(f"ptr {x}, i64 0, " for x in ins) + "".join(f"ptr {y}, " for y in outs)
    code.do(f"call void @kernel(i64 1, {passed}ptr {bits}, ptr {work}, ptr %numbers)")
    valid = code.put(f"zext i16 {code.load('i16', bits)} to i64")
    code.do(f"ret i64 {valid}")
    return code.function("define i64 @one_entry(ptr %numbers, ptr %inputs, ptr %outputs)")


def time_loop_entry(
    states: Sequence[int], kept: int, inputs: int, workspace: int, lanes: int, size: int
) -> str:  # fmt: skip
    """``time_loop_entry(kernel, numbers, *states, *(input, sample, time), *records, *ends, buffer, *counts)``.

    The function runs, tile by tile, all steps of a program whose outputs are the first inputs of the next step. The
    counts are first, end, n, steps, every, recorded.

    states        columns of the states, arrays (n, columns) in C order
    kept          number of states, the first ones, that are recorded
    kernel        the program's address; its inputs are the states, then the others
    numbers       array of the numbers of the program
    sample, time  strides of an input to the next sample and the next step, in numbers
    records       arrays (n, recorded, columns), or views from a row on: the states after every ``every`` steps
    ends          arrays (n, columns): the states after all steps
    buffer        a bit per sample, 16 bits per tile, then ``buffer_size`` bytes
    first, end    tiles to run; the last tile of all ends with sample n >= lanes, and so overlaps the one before it
    """
    wide = [columns * size for columns in states]
    xs = [f"%x{k}" for k in range(inputs)]
    code = Body()
    code.label("start")
    put, byte, times = code.put, code.byte, code.times
    constants = _data(code, "%numbers")
    start = [_data(code, f"%s{k}") for k in range(len(states))]
    data = [_data(code, x) for x in xs]
    records = [_data(code, f"%r{k}") for k in range(kept)]
    ends = [_data(code, f"%e{k}") for k in range(len(states))]
    bits = _data(code, "%buffer")
    flag = byte(bits, times(put("sub i64 %end, %first"), 2))
    work = code.boundary(byte(flag, 2), ALIGNMENT)
    offset, buffers = round_up(workspace), []
    for row in [*wide, *wide]:
        buffers.append(byte(work, offset))
        offset += round_up(lanes * row)
    here, there = buffers[: len(wide)], buffers[len(wide) :]
    code.jump("tiles", then="tiles")
    code.do("%tile = phi i64 [ %first, %start ], [ %tile.next, %tile.done ]")
    code.branch(put("icmp slt i64 %tile, %end"), "tile.run", "done", then="tile.run")
    at, most = times("%tile", lanes), put(f"sub i64 %n, {lanes}")
    sample = put(f"select i1 {put(f'icmp slt i64 {at}, {most}')}, i64 {at}, i64 {most}")
    for buffer, source, row in zip(here, start, wide, strict=True):
        code.copy(buffer, byte(source, times(sample, row)), lanes * row)
    base = [byte(d, times(times(sample, f"{x}.sample"), size)) for d, x in zip(data, xs, strict=True)]
    code.jump("step", then="step")
    code.do("%t = phi i64 [ 0, %tile.run ], [ %t.next, %stepped ]")
    code.do("%valid = phi i16 [ -1, %tile.run ], [ %valid.next, %stepped ]")
    code.do("%record = phi i64 [ 0, %tile.run ], [ %record.next, %stepped ]")
    for k, (a, b) in enumerate(zip(here, there, strict=True)):
        code.do(f"%a{k} = phi ptr [ {a}, %tile.run ], [ %b{k}, %stepped ]")
        code.do(f"%b{k} = phi ptr [ {b}, %tile.run ], [ %a{k}, %stepped ]")
    passed = "".join(f"ptr %a{k}, i64 {columns}, " for k, columns in enumerate(states))
    for x, b in zip(xs, base, strict=True):
        passed += f"ptr {byte(b, times(times('%t', f'{x}.time'), size))}, i64 {x}.sample, "
    passed += "".join(f"ptr %b{k}, " for k in range(len(states)))
    code.do(f"call void %kernel(i64 1, {passed}ptr {flag}, ptr {work}, ptr {constants})")
    code.do(f"%valid.next = and i16 %valid, {code.load('i16', flag)}")
    code.do("%t.next = add i64 %t, 1")
    code.do("%record.next = sdiv i64 %t.next, %every")
    due = put("icmp sgt i64 %record.next, %record")
    code.branch(due, "keep", "stepped", then="keep")
    for k, row in enumerate(wide[:kept]):
        for r in range(lanes):
            place = put(f"add i64 {times(code.add(sample, r), '%recorded')}, %record")
            code.copy(byte(records[k], times(place, row)), byte(f"%b{k}", r * row), row)
    code.jump("stepped", then="stepped")
    code.branch(put("icmp slt i64 %t.next, %steps"), "step", "tile.done", then="tile.done")
    for k, (done, row) in enumerate(zip(ends, wide, strict=True)):
        code.copy(byte(done, times(sample, row)), f"%b{k}", lanes * row)
    code.store("i16", "%valid.next", byte(bits, times(put("sub i64 %tile, %first"), 2)))
    code.do("%tile.next = add i64 %tile, 1")
    code.jump("tiles", then="done")
    code.do("ret void")
    given = "".join(f"ptr %s{k}, " for k in range(len(states)))
    given += "".join(f"ptr {x}, i64 {x}.sample, i64 {x}.time, " for x in xs)
    given += "".join(f"ptr %{x}{k}, " for x, several in (("r", kept), ("e", len(states))) for k in range(several))
    numbers = ", ".join(f"i64 %{x}" for x in ("first", "end", "n", "steps", "every", "recorded"))
    return _COPY + code.function(
        f"define void @time_loop_entry(ptr %kernel, ptr %numbers, {given}ptr %buffer, {numbers})"
    )


_COPY = "\ndeclare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)\n"

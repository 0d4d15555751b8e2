"""LLVM text of the function through which Python runs a compiled program over a batch.

ctypes hands it the arrays as they are, as objects: asking NumPy for an address takes 1 µs, reading it here takes
nothing. What NumPy keeps first in an array object is the address of its data (the fields of a PyArrayObject, part
of NumPy's C interface).
"""

from __future__ import annotations

from collections.abc import Sequence

DATA = object.__basicsize__  # where in an array object the address of its data is
BOUNDARY = 64


def room(inputs: Sequence[int], outputs: Sequence[int], workspace: int, lanes: int, size: int) -> int:
    """Bytes that ``entry`` needs beside the bits of the tiles: a workspace, and a tile of each array."""
    return 2 * BOUNDARY + _padded(workspace) + sum(_padded(lanes * k * size) for k in (*inputs, *outputs))


def entry(inputs: Sequence[int], outputs: Sequence[int], workspace: int, lanes: int, size: int) -> str:
    """``entry(*(input, rows), *outputs, room, n) -> 1``, or 0 if an output overlaps anything, doing nothing.

    inputs, outputs  columns of the arrays, which are in C order
    rows  n, or 1 for an input that serves all samples
    room  takes a bit a sample, 16 bits a tile, and behind them what ``room`` counts

    Samples that do not fill the last tile run on copies, filled up with the last of them.
    """
    ins = {f"in{a}": columns * size for a, columns in enumerate(inputs)}
    outs = {f"out{a}": columns * size for a, columns in enumerate(outputs)}
    rows = {**ins, **outs}
    lines: list[str] = []

    def put(text: str) -> str:
        lines.append(f"  %t{len(lines)} = {text}")
        return f"%t{len(lines) - 1}"

    def byte(base: str, offset: str | int) -> str:
        return put(f"getelementptr i8, ptr {base}, i64 {offset}")

    def copy(to: str, start: str, count: str | int) -> None:
        lines.append(f"  call void @llvm.memcpy.p0.p0.i64(ptr {to}, ptr {start}, i64 {count}, i1 false)")

    def call(tiles: str | int, at: dict[str, str], steps: dict[str, str], bits: str) -> None:
        passed = "".join(f"ptr {at[x]}, i64 {steps[x]}, " for x in ins) + "".join(f"ptr {at[y]}, " for y in outs)
        lines.append(f"  call void @kernel(i64 {tiles}, {passed}ptr {bits}, ptr {work})")

    data = {x: put(f"load ptr, ptr {byte(f'%{x}', DATA)}") for x in [*rows, "room"]}
    count = {x: f"%{x}.rows" if x in ins else "%n" for x in rows}
    end = {x: byte(data[x], put(f"mul i64 {count[x]}, {rows[x]}")) for x in rows}
    apart = "true"
    for k, y in enumerate(outs):
        for x in [*ins, *list(outs)[:k]]:
            before, behind = (put(f"icmp ule ptr {a}, {b}") for a, b in ((end[x], data[y]), (end[y], data[x])))
            apart = put(f"and i1 {apart}, {put(f'or i1 {before}, {behind}')}")
    lines.extend([f"  br i1 {apart}, label %run, label %refuse", "refuse:", "  ret i64 0", "run:"])
    tiles = put(f"sdiv i64 %n, {lanes}")
    first = put(f"mul i64 {tiles}, {lanes}")
    rest = put(f"sub i64 %n, {first}")
    last = byte(data["room"], put(f"mul i64 {tiles}, 2"))
    behind = put(f"add i64 {put(f'ptrtoint ptr {last} to i64')}, {BOUNDARY + 1}")
    work = put(f"inttoptr i64 {put(f'and i64 {behind}, {-BOUNDARY}')} to ptr")
    several = {x: put(f"icmp sgt i64 {count[x]}, 1") for x in ins}
    call(tiles, data, {x: put(f"select i1 {several[x]}, i64 {ins[x] // size}, i64 0") for x in ins}, data["room"])
    lines.extend([f"  br i1 {put(f'icmp eq i64 {rest}, 0')}, label %done, label %tail", "tail:"])
    offset, tile = _padded(workspace), {}
    for x, row in rows.items():
        tile[x] = byte(work, offset)
        offset += _padded(lanes * row)
    for x, row in ins.items():
        step = put(f"select i1 {several[x]}, i64 {row}, i64 0")
        for r in range(lanes):
            there = put(f"icmp slt i64 {r}, {rest}")
            sample = put(f"select i1 {there}, i64 {put(f'add i64 {first}, {r}')}, i64 {put('sub i64 %n, 1')}")
            copy(byte(tile[x], r * row), byte(data[x], put(f"mul i64 {sample}, {step}")), row)
    call(1, tile, {x: str(row // size) for x, row in ins.items()}, last)
    for y, row in outs.items():
        copy(byte(data[y], put(f"mul i64 {first}, {row}")), tile[y], put(f"mul i64 {rest}, {row}"))
    body = "\n".join([*lines, "  br label %done", "done:", "  ret i64 1"])
    given = "".join(f"ptr %{x}, i64 %{x}.rows, " for x in ins) + "".join(f"ptr %{y}, " for y in outs)
    return f"""
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
define i64 @entry({given}ptr %room, i64 %n) {{
start:
{body}
}}
"""


def _padded(size: int) -> int:
    return size + -size % BOUNDARY

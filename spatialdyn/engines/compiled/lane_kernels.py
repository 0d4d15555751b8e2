"""Kernels over the table of bodies on lanes: W samples at a time, compiled once, for all models.

The recursion runs on a tile, which holds the numbers of W samples side by side, with the checks and bits of a
``sample_kernel``, which is the same text on lanes of one sample. If a sample of a tile fails a check, or has an angle
beyond the polynomials' range, the tile is left to the caller, and all its samples have status RETRY.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from ...bodies.table import ANY_NORM, BODIES
from ...recursions.spec import Spec, flat, gather, is_record
from . import disk_cache, lane_names, numba_kernels
from .numba_kernels import OK

LINE = 64  # bytes of a cache line, to which scratch is aligned
MOST_BYTES = 48 << 20  # most bytes of a thread's tiles and scratch: with more, lanes are no faster
MOST_WIDE, WIDE = 4 << 20, 8  # the same of a symmetric matrix on WIDE lanes: half of them are then faster
RETRY = -1  # status of a sample that the kernel leaves to the caller
REFUSED, TOO_LARGE = -1, -2  # results of a kernel that has computed no sample


def _lines(spec: Spec, width: int, edited: bool) -> tuple[list[str], list[str]]:
    """Parameters and statements of the kernel."""
    extent, shape_of = numba_kernels.extent, numba_kernels.kernel_shape
    varying, static, out = [x for x in spec.present if not x.static], [x for x in spec.present if x.static], spec.output
    parameters = ["table", "n"]
    for x in varying:
        parameters += [x.name, f"{x.name}_step"]
    parameters += [x.name for x in static] + [out.name, "status"]
    lines = ["stamp", "bodies = table_at(table)"]
    lines += [f"{x.name}_rows = rows_at({x.name}, {x.name}_dtype)" for x in static if x.table]
    refused = ["bodies[0].kind == ANY_NORM"]
    for x in (*varying, out):
        refused += [f"{x.name}.shape[{k + 1}] != {extent(spec, s)}" for k, s in enumerate(shape_of(x))]
    refused += [f"not no_overlap({x.name}, {out.name})" for x in varying]
    lines += [f"if {' or '.join(refused)}:", f"    return {REFUSED}", *_block_lines(spec, width, edited)]
    lines += [f"{x.name}_at = {x.name}.ctypes.data" for x in (*varying, out)]
    lines += ["failed = 0", f"for s in range(0, n, {width}):", "    sound = True"]
    lines += [f"    {line}" for line in _tile_lines(spec, width, edited)]
    return parameters, [*lines, "release(block, size)", "return failed"]


def _block_lines(spec: Spec, width: int, edited: bool) -> list[str]:
    """The statements that allocate the block of memory of a tile and its scratch, and name the arrays in it."""
    extent, out = numba_kernels.extent, spec.output
    varying = [x for x in spec.present if not x.static]
    tiles = {x.name: [extent(spec, s) for s in numba_kernels.kernel_shape(x)] for x in (*varying, out)}
    tiles |= {f"{x.name}_turned": ["3", extent(spec, "nq")] for x in varying if x.turned}
    tiles |= {name: shape for name, (shape, dtype) in numba_kernels.scratch_of(spec).items() if dtype == "FLOAT"}
    if edited:
        tiles["bodies"] = ["len(bodies)", "TABLE_WORDS"]
    lines = ["size = 0"]
    if spec.mirrored:
        side = _side(spec)
        tiles[out.name] = [f"({side}) * ({side} + 1) // 2"]
    for name, shape in tiles.items():
        lines += [f"{name}_columns = {' * '.join(f'({s})' for s in shape)}", f"{name}_first = size"]
        lines.append(f"size += (8 * {width} * {name}_columns + {LINE - 1}) // {LINE} * {LINE}")
    if spec.work is not None:
        lines += ["work_first = size", f"size += {width} * WORK_SIZE * len(bodies)"]
    most = MOST_WIDE if spec.mirrored and width == WIDE else MOST_BYTES
    lines += [f"size += {LINE}", f"if size > {most}:", f"    return {TOO_LARGE}", "block = memory(size)"]
    if spec.mirrored:
        lines.append(f"{out.name}_tile = lower(aligned(block, {out.name}_first))")
    for name, shape in tiles.items():
        if (spec.mirrored and name == out.name) or name == "bodies":
            continue
        lines.append(f"{name}_tile = lanes{len(shape)}(aligned(block, {name}_first), ({', '.join(shape)},))")
    if spec.work is not None:
        lines.append("work_tile = works(aligned(block, work_first), (len(bodies),))")
    if edited:
        lines.append("bodies_tile = tables(aligned(block, bodies_first), (len(bodies),))")
    return lines


def _side(spec: Spec) -> str:
    """The number of rows of a result that is a symmetric matrix, as an expression in the kernel's names."""
    return numba_kernels.extent(spec, numba_kernels.kernel_shape(spec.output)[0])


def _tile_lines(spec: Spec, width: int, edited: bool) -> list[str]:
    """The statements that compute the tile of the samples from ``s`` on."""
    rows, out, varying = "bodies_tile" if edited else "bodies", spec.output, [x for x in spec.present if not x.static]
    lines = ["fill(table, bodies_columns, s, n - 1, aligned(block, bodies_first))"] if edited else []
    for x in varying:
        lines.append(
            f"fill({x.name}_at, {x.name}_columns, s * {x.name}_step, (n - 1) * {x.name}_step, "
            f"aligned(block, {x.name}_first))"
        )
    lines += [f"sound = sound and unit_norm({rows}, {x.name}_tile)" for x in varying if x.unit_norm]
    lines += [f"sound = turn_lanes({x.name}_tile, {x.name}_turned_tile) and sound" for x in varying if x.turned]
    passed: list[str | None] = [rows, "work_tile"] if spec.work is not None else [rows]

    def named(x: Any) -> str:
        if x.static:
            return f"{x.name}_rows" if x.table else str(x.name)
        if x.turned:
            return f"{x.name}_turned_tile"
        return f"{x.name}_tile" if x.shape else f"{x.name}_tile[0]"

    call_of = numba_kernels.call_of
    passed += gather(spec.inputs, named, call_of)
    passed += [] if spec.parts else [f"{out.name}_tile"]
    parts: list[str | None] = []
    for k, part in enumerate(spec.parts):
        lines.append(f"end{k} = {f'end{k - 1} + ' if k else ''}{numba_kernels.extent(spec, *part.shape)}")
        parts.append(f"{out.name}_tile[{f'end{k - 1}' if k else '0'}:end{k}]")
    passed += [call_of(type(spec.parts), parts)] if is_record(spec.parts) else parts
    names = (f"scratch{k}_tile" for k, _ in enumerate(flat(spec.scratch)))
    passed += ["pivots_tile"] * spec.pivots + gather(spec.scratch, lambda _: next(names), call_of)
    lines.append(f"recursion({', '.join(x or 'None' for x in passed)})")
    if spec.pivots:
        lines.append(f"sound = sound and pivots_regular({rows}, q_tile, pivots_tile)")
    if out.unit_norm:
        lines.append(f"sound = sound and unit_norm({rows}, {out.name}_tile)")
    drain, columns = ("mirror(bodies, ", _side(spec)) if spec.mirrored else ("drain(", f"{out.name}_columns")
    return [
        *lines,
        f"sound = {drain}aligned(block, {out.name}_first), {out.name}_at, {columns}, s, n - 1) and sound",
        f"for k in range(s, min(s + {width}, n)):",
        f"    status[k] = {OK} if sound else {RETRY}",
        "    failed += 0 if sound else 1",
    ]


@cache
def kernel(spec: Spec, width: int, edited: bool = False) -> Callable[..., int]:
    """A ``batch_kernel`` on lanes, compiled or from disk; it leaves samples of status RETRY.

    edited  each sample has a table of its own: the tables of all lie one behind the other. They differ in numbers alone

    The kernel returns REFUSED or TOO_LARGE if it computes none.
    """
    with numba_kernels.compiling(spec):
        from . import jit

        return jit.compile_signature(source(spec, width, edited), numba_kernels.batch_signature(spec), contract=False)


def source(spec: Spec, width: int, edited: bool = False) -> Callable[..., int]:
    """The kernel's Python function."""
    parameters, lines = _lines(spec, width, edited)
    name = f"{numba_kernels.label(spec)}_{'edited' if edited else 'lanes'}{width}"
    words = BODIES.itemsize // 8
    scope = numba_kernels.scope(spec) | lane_names.known(spec, width) | {"ANY_NORM": ANY_NORM, "TABLE_WORDS": words}
    return numba_kernels.kernel_from_text(name, parameters, lines, scope)


def is_stored(spec: Spec, width: int, edited: bool = False) -> bool:
    """Whether the compiled kernel is on disk."""
    from . import jit, tiers

    if disk_cache.folder() is None:
        return False
    return tiers.is_stored(
        jit.numba_jit(source(spec, width, edited), contract=False), numba_kernels.batch_signature(spec)
    )

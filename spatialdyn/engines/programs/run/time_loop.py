"""Programs run in a time loop, tile by tile: their outputs, the states, are the first inputs of the next step.

The states of a tile stay in the first-level cache. Python runs between steps only to handle Ctrl-C: after a group of
tiles, or, if there are few tiles, after a group of steps.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiled import disk_cache
from ...threads import thread_pool
from ..llvm import host_cpu
from ..llvm.llvm_entry import buffer_size, time_loop_entry
from ..record.program import Program
from .batch_kernels import Kernel, code_digest
from .batches import NONE


class StepInput(NamedTuple):
    """An input of each step: rows (samples or 1, steps or 1, columns) in C order; with 1 all share the row."""

    rows: NDArray[Any]

    def steps(self) -> tuple[int, int]:
        """Strides to the row of the next sample and of the next step, in numbers."""
        samples, times, columns = self.rows.shape
        return (times * columns if samples > 1 else 0), (columns if times > 1 else 0)


@cache
def _compiled_loop(
    states: tuple[int, ...], kept: int, inputs: int, workspace: int, width: int, size: int
) -> tuple[Any, Callable[..., None], int]:
    """The loaded code (which must stay referenced), the compiled loop, and the bytes that the loop needs."""
    digest = code_digest(f"time loop {states} {kept} {inputs} {workspace} {width} {size}")
    code = disk_cache.read(digest)
    if code is None:
        code = host_cpu.object_code(time_loop_entry(states, kept, inputs, workspace, width, size))
        disk_cache.write(digest, code)
    loaded = host_cpu.LoadedCode(code)
    given: list[Any] = [ctypes.c_void_p, ctypes.py_object, *[ctypes.py_object] * len(states)]
    given += [ctypes.py_object, ctypes.c_int64, ctypes.c_int64] * inputs
    given += [ctypes.py_object] * (kept + len(states) + 1) + [ctypes.c_int64] * 6
    space = buffer_size(states, states, workspace, width, size)
    return loaded, ctypes.CFUNCTYPE(None, *given)(loaded.address("time_loop_entry")), space


def run(
    kernel: Kernel,
    states: Sequence[NDArray[Any]],
    inputs: Sequence[StepInput],
    records: Sequence[NDArray[Any]],
    steps: int,
    every: int,
    ends: Sequence[NDArray[Any]] = (),
) -> NDArray[np.intp]:
    """Run every sample through all steps; returns the indices of rejected samples, which the caller has to recompute.

    kernel   kernel of a program whose inputs are the states, then the others; its outputs are the states after a step
    states   (n, columns) each, n at least 1
    records  (n, steps // every, columns) each, written in place: the states after every ``every`` steps; if there are
             fewer records than states, only the first states are recorded
    ends     (n, columns) each, written in place: the states after all steps; or none
    """
    n, width = len(states[0]), kernel.lanes
    if n < width:  # fill one tile
        fill = np.minimum(np.arange(width), n - 1)
        more = [StepInput(np.ascontiguousarray(x.rows[fill])) if len(x.rows) > 1 else x for x in inputs]
        made = [np.empty((width, *r.shape[1:]), r.dtype) for r in records]
        last = [np.empty((width, e.shape[1]), e.dtype) for e in ends]
        rejected = run(kernel, [np.ascontiguousarray(s[fill]) for s in states], more, made, steps, every, last)
        for r, m in zip((*records, *ends), (*made, *last), strict=True):
            r[...] = m[:n]
        return rejected[rejected < n]
    columns = tuple(s.shape[1] for s in states)
    size = kernel.dtype.itemsize
    _, call, space = _compiled_loop(columns, len(records), len(inputs), kernel.code.workspace, width, size)
    tiles = -(-n // width)
    if tiles == 1 and steps <= kernel.reach:
        buffer, after = np.empty(4 + space, np.uint8), ends or [np.empty_like(s) for s in states]
        passed: list[Any] = [kernel.code.address, kernel.numbers, *states]
        for x in inputs:
            passed += [x.rows, *x.steps()]
        call(*passed, *records, *after, buffer, 0, 1, n, steps, every, steps // every)
        whole = (1 << width) - 1
        ran = int(buffer[:2].view(np.uint16)[0]) & whole
        return NONE if ran == whole else np.flatnonzero([not ran >> k & 1 for k in range(n)])
    threads = max(1, min(thread_pool.size, kernel.threads(tiles * steps), tiles))
    bits = np.full(tiles, (1 << width) - 1, np.uint16)
    least = kernel.reach * threads
    group = max(threads, least // steps)
    reached = [np.empty_like(s) for s in states], [np.empty_like(s) for s in states]

    def part(passed: list[Any], numbers: tuple[int, ...], first: int, end: int) -> None:
        buffer = np.empty(2 * (end - first) + 2 + space, np.uint8)
        call(*passed, buffer, first, end, *numbers)
        bits[first:end] &= buffer[: 2 * (end - first)].view(np.uint16)

    for tile in range(0, tiles, group):
        several = min(group, tiles - tile)
        now: Sequence[NDArray[Any]] = states
        for k, (step, count, each) in enumerate(_pieces(steps, every, max(1, least // several))):
            passed = [kernel.code.address, kernel.numbers, *now]
            for x in inputs:
                passed += [x.rows if x.rows.shape[1] == 1 else x.rows[:, step:], *x.steps()]
            now = reached[k % 2]
            passed += [*(r[:, step // every :] for r in records), *now]
            numbers = (n, count, each, steps // every)
            cuts = pairwise(tile + several * j // threads for j in range(threads + 1))
            thread_pool.run([partial(part, passed, numbers, *cut) for cut in cuts])
        here = slice(min(tile * width, n - width), min((tile + several) * width, n))
        for end, reach in zip(ends, now, strict=False):
            end[here] = reach[here]
    starts = np.minimum(np.arange(tiles) * width, n - width)
    lane = np.arange(width)
    return np.unique((starts[:, None] + lane)[(bits[:, None] >> lane & 1) == 0])


def _pieces(steps: int, every: int, most: int) -> Iterator[tuple[int, int, int]]:
    """(first step, steps, steps per record) of pieces of at most ``most`` steps; each ends at a record or has none."""
    if most >= every:
        size = most - most % every
        for first in range(0, steps, size):
            yield first, min(size, steps - first), every
        return
    for mark in range(0, steps, every):
        end = min(mark + every, steps)
        for first in range(mark, end, most):
            count = min(most, end - first)
            yield first, count, count if first + count == mark + every else steps + 1


def replay(
    program: Program, states: Sequence[NDArray[Any]], inputs: Sequence[NDArray[Any]],
    records: Sequence[NDArray[Any]], steps: int, every: int,
) -> NDArray[np.intp]:  # fmt: skip
    """As ``run``, by a program in NumPy, which rejects no angle; returns the samples that are not finite."""
    n, now = len(states[0]), [np.asarray(x, np.float64) for x in states]
    ends = np.cumsum([0, *(x.shape[1] for x in states)])
    for k in range(steps):
        rows = [*now, *(np.broadcast_to(x[:, min(k, x.shape[1] - 1)], (n, x.shape[2])) for x in inputs)]
        with np.errstate(all="ignore"):
            found = program.run([column for x in rows for column in x.T])
        after = [np.broadcast_to(np.asarray(x, np.float64), n) for x in found]
        now = [np.stack(after[a:b], 1) if a < b else np.empty((n, 0)) for a, b in pairwise(ends)]
        if (k + 1) % every == 0:
            for record, x in zip(records, now, strict=False):
                with np.errstate(over="ignore"):
                    record[:, (k + 1) // every - 1] = x
    return np.flatnonzero(~np.logical_and.reduce([np.isfinite(x).all(axis=1) for x in now]))

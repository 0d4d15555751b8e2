"""A call over the samples of a batch, one or many: by its program if it has one, else by the table kernel.

Which of the two depends on the table and the call alone. Samples that a program rejects are recomputed by the table
kernel: angles beyond its range, NaN, joints of next to no articulated inertia. The results are written in place; the
caller gets the samples that failed.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Hashable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..bodies.static_table import StaticTable
from ..recursions.spec import Spec
from . import threads
from .compiled import numba_kernels
from .programs import batch_kernels, recording
from .programs.tiered_program import TieredProgram

Arrays = Sequence[NDArray[np.float64]]
SHARE = 10**9 if numba_kernels.PLAIN else 128  # least samples of a thread: some 100 µs
MANY = 8192  # samples of a batch to prepare for
_lock = threading.RLock()
STATIC = "rows" if numba_kernels.PLAIN else "address"  # the attribute of a StaticTable that kernels take
RANGE = numba_kernels.NONFINITE + 1  # a status that the kernels do not have


class Table(Hashable, Protocol):
    """A table of bodies, hashed and compared by its content."""

    @property
    def bodies(self) -> NDArray[Any]:
        """The rows, a structured array of BODIES."""

    @property
    def key(self) -> str:
        """A digest of their content."""

    @property
    def address(self) -> int:
        """Their address in memory."""


class Failed(NamedTuple):
    """The samples of a batch (k) whose status is not OK.

    samples  (k) their indices in the batch
    status   (k) of ``numba_kernels``, or RANGE: a result that is finite in float64 and not in the output's dtype
    finite   (k) whether the whole result is finite, in float64
    inputs   their inputs, each (k, ...), or (1, ...) for all samples
    """

    samples: NDArray[np.intp]
    status: NDArray[np.int8]
    finite: NDArray[np.bool_]
    inputs: Arrays


ALL_OK = Failed(np.empty(0, np.intp), np.empty(0, np.int8), np.empty(0, np.bool_), ())


class CallProgram(NamedTuple):
    """A call on one table as a program."""

    spec: Spec
    table: Table
    static: tuple[Any, ...]
    program: TieredProgram

    def __call__(self, inputs: Arrays, out: NDArray[np.float64], seen: bool = True) -> Failed | None:
        """As ``batch``; returns None if not applicable: arrays of other sizes, or that overlap."""
        large = out.nbytes >= batch_kernels.STREAM_BYTES and out.ctypes.data % 64 == 0
        kernel = self.program.batch(len(out), large)
        left = kernel([x if x.ndim == 2 else x.reshape((len(x), -1)) for x in inputs], (out,), seen)
        if left is None:
            return None
        if not len(left):
            return ALL_OK
        rest = [x[left] if len(x) == len(out) else x for x in inputs]
        return run_table_kernel(self.spec, self.table, rest, self.static, out, left, seen=seen)


def batch(
    spec: Spec,
    table: Table,
    inputs: Arrays,
    static: tuple[Any, ...],
    out: NDArray[np.float64],
    seen: bool = True,
) -> Failed:
    """Every sample of a batch; returns those that failed, ALL_OK if none did.

    inputs  each (n, ...) in C order, or (1, ...) for all samples
    static  values of the static inputs
    out     (n, columns) in C order, written in place
    seen    whether the caller reads ``out`` after Ctrl-C: it then holds the results so far, and NaN in the others
    """
    made = program(spec, table, hashable(static))
    failed = None if made is None else made(inputs, out, seen)
    return failed if failed is not None else run_table_kernel(spec, table, inputs, static, out, seen=seen)


def hashable(static: tuple[Any, ...]) -> tuple[bytes | int, ...]:
    """Values of static inputs, arrays as bytes; a StaticTable is hashed by its content."""
    return tuple(x.tobytes() if isinstance(x, np.ndarray) else x for x in static)


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def program(spec: Spec, table: Table, static: tuple[bytes | int, ...]) -> CallProgram | None:
    """A call as a program; None if it has none. ``static`` as of ``hashable``."""
    with _lock:
        return _program(spec, table, static)


def forget_programs() -> None:
    """Have programs be recorded or loaded again."""
    program.cache_clear()
    _program.cache_clear()


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def _program(spec: Spec, table: Table, static: tuple[bytes | int, ...]) -> CallProgram | None:
    """As ``program``, for one thread at a time: each is recorded once."""
    if numba_kernels.PLAIN or not recording.fits((spec,), table.bodies, static=static):
        return None
    values = tuple(np.frombuffer(x).reshape(4, 4) if isinstance(x, bytes) else x for x in static)
    try:
        made = TieredProgram((spec,), table.bodies, table.key, values)
    except ZeroDivisionError:  # a joint with zero articulated inertia in every state
        return None
    return CallProgram(spec, table, values, made)


def compile_program(spec: Spec, table: Table, static: tuple[Any, ...]) -> bool:
    """Compile a call's program for one sample and for batches, instead of when it pays; False if it has none.

    Also for batches that bypass the CPU caches, if those of MANY samples do.
    """
    made = program(spec, table, hashable(static))
    if made is None:
        return False
    for one in (True, False):
        made.program.compiled(one)
    if 8 * math.prod(_core(spec, table, hashable(static))) * MANY >= batch_kernels.STREAM_BYTES:
        made.program.compiled(one=False, stream=True)
    return True


def run_table_kernel(
    spec: Spec,
    table: Table,
    inputs: Arrays,
    static: tuple[Any, ...],
    out: NDArray[Any],
    at: NDArray[np.intp] | None = None,
    columns: NDArray[np.intp] | None = None,
    seen: bool = True,
) -> Failed:
    """Samples computed by the table kernel, in float64; returns those that failed.

    inputs   of these samples, as of ``batch``
    out      (n, columns) of any float dtype, written in place
    at       the rows of ``out`` of these samples, all if left out
    columns  the wanted entries of a result, flat, all if left out
    seen     as of ``batch``
    """
    count, bodies = len(out) if at is None else len(at), table.bodies
    core = _core(spec, table, hashable(static))
    width = math.prod(core)
    kernel, rows = numba_kernels.batch_kernel(spec), getattr(table, numba_kernels.TABLE)
    in_place = at is None and columns is None and out.dtype == np.float64
    failed: list[Failed] = []
    first = 0
    try:
        for first, end in threads.slices(count, len(bodies), width):
            here = slice(first, end) if at is None else at[first:end]
            given = [x[first:end] if len(x) == count else x for x in inputs]
            flat = out[here] if in_place else np.empty((end - first, width))
            status = np.empty(end - first, np.int8)
            count_bad = _share(kernel, rows, given, static, flat.reshape((len(flat), *core)), status)
            if not in_place:
                count_bad += _store(out, here, flat if columns is None else flat[:, columns], status)
            if count_bad:
                rows_failed = np.flatnonzero(status != numba_kernels.OK)
                finite = np.asarray(np.isfinite(flat[rows_failed]).all(axis=1))
                samples = rows_failed + first if at is None else at[rows_failed + first]
                failed_inputs = [x[rows_failed] if len(x) == len(flat) else x for x in given]
                failed.append(Failed(samples, status[rows_failed], finite, failed_inputs))
            first = end
    except KeyboardInterrupt:
        if seen:
            out[slice(first, None) if at is None else at[first:]] = np.nan
        raise
    return concatenate_failed(failed)


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def _core(spec: Spec, table: Table, static: tuple[Any, ...]) -> tuple[int, ...]:
    """Shape of one sample of the output as the table kernel takes it: a scalar is an array of one."""
    return recording.shape_of(spec.output, table.bodies, static) or (1,)


def _share(kernel: Any, rows: Any, inputs: Arrays, static: tuple[Any, ...], out: Any, status: Any) -> int:
    """The table kernel over the samples of ``out``, shared among the threads; returns how many failed."""
    n, known = len(out), [getattr(x, STATIC) if isinstance(x, StaticTable) else x for x in static]

    def part(first: int, end: int) -> int:
        passed = [y for x in inputs for y in ((x[first:end], 1) if len(x) == n else (x, 0))]
        return int(kernel(rows, end - first, *passed, *known, out[first:end], status[first:end]))

    return threads.thread_pool.share(0, n, SHARE, part)


def _store(out: NDArray[Any], here: Any, results: NDArray[np.float64], status: NDArray[np.int8]) -> int:
    """Write results to the rows ``here`` of ``out``, in its dtype; returns how many samples overflow it."""
    with np.errstate(over="ignore"):
        out[here] = results
    if out.dtype == np.float64:
        return 0
    overflowed = (np.isfinite(results) & ~np.isfinite(out[here])).any(axis=1)
    status[overflowed & ((status == numba_kernels.OK) | (status == numba_kernels.NONFINITE))] = RANGE
    return int(overflowed.sum())


def concatenate_failed(parts: Sequence[Failed]) -> Failed:
    """The failed samples of several slices."""
    if not parts:
        return ALL_OK
    first, *more = parts
    if not more:
        return first
    inputs = [
        np.concatenate([np.broadcast_to(x, (len(p.samples), *x.shape[1:])) for p, x in zip(parts, of, strict=True)])
        for of in zip(*(p.inputs for p in parts), strict=True)
    ]
    samples, status, finite = (np.concatenate(of) for of in zip(*(p[:3] for p in parts), strict=True))
    return Failed(samples, status, finite, inputs)

"""A call over the samples of a batch, one or many: by its program if it has one, else by the table kernel.

The choice depends on the table and the call alone. The recursion in NumPy computes the samples that a program rejects
(angles beyond its range, NaN, joints of almost no articulated inertia), however many there are: the table kernel takes
seconds to compile, and its results have other bits. The results are written in place; the samples that failed are
returned.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..bodies.static_table import StaticTable
from ..bodies.table import ANY_NORM
from ..recursions.spec import Spec, shape_in, sizes_of
from ..waiting import watch
from . import locks, mimic_batches, threads
from .compiled import entries, lane_batches, lane_names, numba_kernels, tiers
from .failed import ALL_OK as ALL_OK
from .failed import Arrays as Arrays
from .failed import Failed as Failed
from .failed import concatenate_failed as concatenate_failed
from .failed import in_order
from .numbers.samples import Evaluation
from .programs.record import parameters as edits
from .programs.record import recording
from .programs.record.parameters import Parameter
from .programs.run import batch_kernels
from .programs.run.batches import NONE
from .programs.run.tiered_program import TieredProgram

SHARE = 10**9 if numba_kernels.PLAIN else 128  # least samples of a thread: fewer take less time than waking it
FEW, FEW_NUMBERS = 512, 1 << 20  # most samples, and most numbers in their results, that NumPy computes
FEW_ALONE = 16  # as FEW, for a recursion that branches on values, which NumPy runs on one sample at a time
MANY_ALONE = 512  # a batch of so many samples compiles a recursion that branches on values at once
MOST_STEPS = 200_000  # most rows of the table times numbers of a result that NumPy computes
MOST_BESIDE_LANES = 2080  # most numbers, in one triangle, that M may hold for a program, if lanes can: a chain of 64
EDITED_BYTES = 1 << 24  # of the tables of samples with parameters of their own, at a time
CHECKS_SECONDS = 1e-4  # time of the checks of a call in Python, which a plan of one sample saves
MANY = 8192  # samples of the batches that ``compile_program`` prepares for
_lock = locks.new()
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
        failed = run_in_numpy(self.spec, self.table, rest, self.static, out, left, seen=seen)
        return self._off_norm(failed, inputs, out, seen) if self.table.bodies[0]["kind"] == ANY_NORM else failed

    def _off_norm(self, failed: Failed, inputs: Arrays, out: NDArray[np.float64], seen: bool) -> Failed:
        """Compute samples off unit norm, which the table allows, by the table kernel; returns those that failed."""
        off = failed.status == numba_kernels.UNIT
        if not off.any():
            return failed
        at, kept = failed.samples[off], np.flatnonzero(~off)
        rest = [x[at] if len(x) == len(out) else x for x in inputs]
        again = run_table_kernel(self.spec, self.table, rest, self.static, out, at, seen=seen)
        others = [x[kept] if len(x) == len(off) else x for x in failed.inputs]
        held = Failed(failed.samples[kept], failed.status[kept], failed.finite[kept], others)
        return in_order(concatenate_failed([x for x in (held, again) if len(x.samples)]))


class Single(NamedTuple):
    """The (entry, context, left) of a plan of ``single_call``, and the objects at these addresses."""

    words: tuple[int, int, int]
    alive: object


def batch(
    spec: Spec,
    table: Table,
    inputs: Arrays,
    static: tuple[Any, ...],
    out: NDArray[np.float64],
    seen: bool = True,
) -> Failed:
    """Compute every sample of a batch; returns those that failed, ALL_OK if none did.

    inputs  each (n, ...) in C order, or (1, ...) for all samples
    static  values of the static inputs
    out     (n, columns) in C order, written in place
    seen    whether the caller reads ``out`` after Ctrl-C: ``out`` then holds the results so far and NaN for the rest
    """
    made = program(spec, table, hashable(static))
    failed = None if made is None else made(inputs, out, seen)
    return failed if failed is not None else run_table_kernel(spec, table, inputs, static, out, seen=seen)


def hashable(static: tuple[Any, ...]) -> tuple[bytes | int, ...]:
    """Hashable values of static inputs: arrays as bytes; a StaticTable is hashed by its content."""
    return tuple(x.tobytes() if isinstance(x, np.ndarray) else x for x in static)


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def program(spec: Spec, table: Table, static: tuple[bytes | int, ...]) -> CallProgram | None:
    """A call as a program; None if it has none. ``static`` as of ``hashable``."""
    with _lock:
        return _program(spec, table, static)


def forget_programs() -> None:
    """Forget all programs, so that they are recorded or loaded again."""
    program.cache_clear()
    _program.cache_clear()


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def _program(spec: Spec, table: Table, static: tuple[bytes | int, ...]) -> CallProgram | None:
    """As ``program``, for one thread at a time, so that each program is recorded once."""
    if numba_kernels.PLAIN or not recording.fits((spec,), table.bodies, static=static):
        return None
    if spec.mirrored and lane_names.fits(spec) and _pairs(table) > MOST_BESIDE_LANES:
        return None
    values = tuple(np.frombuffer(x).reshape(4, 4) if isinstance(x, bytes) else x for x in static)
    try:
        made = TieredProgram((spec,), table.bodies, table.key, values)
    except ZeroDivisionError:  # a joint with zero articulated inertia in every state
        return None
    return CallProgram(spec, table, values, made)


def _pairs(table: Table) -> int:
    """Of how many pairs of a row and a row of its subtree M has a number: the others are zero."""
    last = table.bodies["last_row"][1:]
    return int((last - np.arange(len(last))).sum())


def single(spec: Spec, table: Table, static: tuple[Any, ...], found: CallProgram | None) -> Single | None:
    """What a plan of ``single_call`` runs for one sample: the program, or else the table kernel of one sample.

    Returns None if the table kernel does not apply, or is not in memory. Its bits are those of batches.
    """
    if found is not None:
        return Single(*found.program.single())
    if numba_kernels.PLAIN or len(table.bodies) == 1 or spec.large or mimic_batches.reduced(table) is not None:
        return None
    if not spec.traceable or table.bodies[0]["kind"] == ANY_NORM:
        if not tiers.table_kernel(spec).is_made:
            return None
        made: entries.CompiledEntry = entries.table_entry(spec)
    elif numba_kernels.is_made(spec) and lane_names.fits(spec):
        made = entries.sample_entry(spec)
    else:
        return None
    made.spend(CHECKS_SECONDS)
    if made.code() is None:
        return None
    static = tuple(np.ascontiguousarray(x) if isinstance(x, np.ndarray) else x for x in static)
    context = entries.context_of(table, static)
    return Single(made.words(context.ctypes.data), (made, context, *static))


def compile_program(spec: Spec, table: Table, static: tuple[Any, ...]) -> bool:
    """Compile a call's program now, for one sample and for batches; returns False if the call has no program.

    If batches of MANY samples bypass the CPU caches, the code for such batches is compiled too.
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
    """Compute samples by the table kernel, in float64; returns those that failed.

    inputs   of these samples, as of ``batch``
    out      (n, columns) of any float dtype, written in place
    at       the rows of ``out`` of these samples; all rows by default
    columns  the wanted entries of a flat result; all entries by default
    seen     as of ``batch``

    A recursion that branches on values has no program; it runs in plain Python until compiling pays, with the same
    bits. NumPy computes a few samples with NaN or infinity, so that no kernel is compiled for a result of NaN. NumPy
    also computes all samples of a model without joints, of a Spec that is ``large``, and of a model with mimic joints
    where ``mimic_batches`` does not.
    """
    count = len(out) if at is None else len(at)
    in_numpy = len(table.bodies) == 1 or (mimic_batches.reduced(table) is not None and not mimic_batches.fits(spec))
    if in_numpy or (spec.large and not numba_kernels.PLAIN):
        samples = np.arange(count) if at is None else at
        return run_in_numpy(spec, table, inputs, static, out, samples, columns, seen)
    odd = _few_not_finite(spec, table, inputs, static, count)
    if not len(odd):
        return _run_table_kernel(spec, table, inputs, static, out, at, columns, seen)
    samples = np.arange(count) if at is None else at
    if seen:
        out[samples[odd]] = np.nan
    parts, rest = [], np.delete(np.arange(count), odd)
    for chosen, compute in ((rest, _run_table_kernel), (odd, run_in_numpy)):
        if len(chosen):
            given = [x[chosen] if len(x) == count else x for x in inputs]
            parts.append(compute(spec, table, given, static, out, samples[chosen], columns, seen))
    return in_order(concatenate_failed([x for x in parts if len(x.samples)]))


def preview(spec: Spec, table: Table, inputs: Arrays, static: tuple[Any, ...], count: int) -> Failed:
    """The failed samples of a call, computed in NumPy, if its table kernel would have to be compiled first.

    Returns ALL_OK also if the call has a program, if its kernel is in memory, or if the samples are many.
    """
    if (
        numba_kernels.PLAIN
        or not spec.traceable  # its recursion is compiled when that pays
        or mimic_batches.reduced(table) is not None  # their calls run several kernels
        or numba_kernels.is_made(spec)
        or (lane_names.fits(spec) and lane_batches.batches(spec).is_made)
        or count > _few(spec, table, static)
        or program(spec, table, hashable(static)) is not None
    ):
        return ALL_OK
    out = np.empty((count, math.prod(_core(spec, table, hashable(static)))))
    return run_in_numpy(spec, table, inputs, static, out, np.arange(count))


def _few(spec: Spec, table: Table, static: tuple[Any, ...]) -> int:
    """The number of samples that NumPy computes in the time of compiling the table kernel; 0 if NumPy cannot."""
    if numba_kernels.PLAIN or table.bodies[0]["kind"] == ANY_NORM:
        return 0
    numbers = max(1, math.prod(_core(spec, table, hashable(static))))
    if len(table.bodies) * numbers > MOST_STEPS:
        return 0
    most = min(FEW, FEW_NUMBERS // numbers)
    if spec.term_shape:  # as of crba_solve, which factors M: 186 samples of 100 rows take 17 s
        most = min(most, MOST_STEPS // math.prod(shape_in(spec.term_shape[:2], sizes_of(table.bodies))))
    return max(1, most) if spec.traceable else FEW_ALONE


def _few_not_finite(spec: Spec, table: Table, inputs: Arrays, static: tuple[Any, ...], count: int) -> NDArray[np.intp]:
    """The samples with an input that is not finite, if such samples are few.

    An infinity or NaN makes the sum infinite or NaN, which takes half the time of looking at each number.
    """
    found = np.zeros(count, np.bool_)
    for x in inputs:
        if not np.isfinite(np.einsum("i->", x.ravel())):
            found |= ~np.isfinite(x).reshape(len(x), -1).all(axis=1)
    odd = np.flatnonzero(found)
    return odd if len(odd) <= _few(spec, table, static) else NONE


def _run_table_kernel(
    spec: Spec,
    table: Table,
    inputs: Arrays,
    static: tuple[Any, ...],
    out: NDArray[Any],
    at: NDArray[np.intp] | None,
    columns: NDArray[np.intp] | None,
    seen: bool,
) -> Failed:
    """As ``run_table_kernel``, for samples of any kind."""
    core, rows = _core(spec, table, hashable(static)), getattr(table, numba_kernels.TABLE)
    reduced = mimic_batches.reduced(table)
    kernel = _kernel(spec, len(out) if at is None else len(at), table) if reduced is None else None

    def compute(here: slice, given: Arrays, flat: NDArray[np.float64], status: NDArray[np.int8]) -> None:
        results = flat.reshape((len(flat), *core))
        if reduced is not None:
            reduced.compute(_run_kernel, spec, given, static, results, status)
        elif kernel is not None:
            _share(kernel, rows, given, static, results, status)
        else:
            _one_by_one(spec, rows, given, static, results, status)

    least = lane_names.width() if lane_names.fits(spec) else 1
    return _in_slices(compute, len(table.bodies), math.prod(core), inputs, out, at, columns, seen, least)


def _run_kernel(
    spec: Spec, table: Any, inputs: Sequence[NDArray[np.float64]], static: tuple[Any, ...], out: NDArray[np.float64],
    status: NDArray[np.int8],
) -> None:  # fmt: skip
    """A ``mimic_batches.Run``."""
    _share(
        _kernel(spec, len(out), table, alone=False), getattr(table, numba_kernels.TABLE), inputs, static, out, status
    )


def compile_table_kernel(spec: Spec, table: Table, static: tuple[Any, ...] = ()) -> None:
    """Compile the table kernels that compute batches of a call without a program."""
    reduced = mimic_batches.reduced(table)
    if reduced is None:
        _compile_kernel(spec)
    elif mimic_batches.fits(spec):
        reduced.visit(_compile_kernel, spec, static)


def _compile_kernel(spec: Spec) -> None:
    if lane_names.fits(spec):
        lane_batches.batches(spec).compile_now()
        entries.sample_entry(spec).compile_now()
    else:
        _kernel(spec, MANY_ALONE)


def _kernel(spec: Spec, count: int, table: Table | None = None, alone: bool = True) -> Callable[..., int] | None:
    """The table kernel of batches on a table; None for few samples of a recursion that still runs in plain Python: one
    that branches on values, as all do on tables of ANY_NORM, which the kernel on lanes refuses.

    alone  whether the caller can run one sample at a time
    """
    any_norm = table is not None and table.bodies[0]["kind"] == ANY_NORM
    if table is not None and lane_names.fits(spec) and not any_norm:
        made = lane_batches.batches(spec)
        made.prepare(count)
        return made
    if (spec.traceable and not (any_norm and alone)) or numba_kernels.PLAIN:
        return numba_kernels.batch_kernel(spec)
    tier = tiers.table_kernel(spec)
    return tier.batches if count >= MANY_ALONE or tier.code() is not None else None


def _one_by_one(
    spec: Spec, rows: Any, inputs: Arrays, static: tuple[Any, ...], out: NDArray[Any], status: NDArray[np.int8]
) -> None:
    """As ``_share``, sample by sample, by a kernel that is compiled when that pays."""
    kernel, varying = tiers.table_kernel(spec), [x for x in spec.present if not x.static]
    known = dict(zip((x.name for x in spec.present if x.static), static, strict=True))
    for k in range(len(out)):
        given = (x[k] if len(x) == len(out) else x[0] for x in inputs)
        values = known | {x.name: y if x.shape else y.item() for x, y in zip(varying, given, strict=True)}
        status[k] = kernel(rows, *(values[x.name] for x in spec.present), out[k])


def run_edited(
    spec: Spec,
    table: Table,
    parameters: Sequence[Parameter],
    values: Arrays,
    inputs: Arrays,
    static: tuple[Any, ...],
    out: NDArray[Any],
    at: NDArray[np.intp],
    columns: NDArray[np.intp] | None,
) -> NDArray[np.bool_]:
    """As ``run_table_kernel``, for samples with parameters of their own: on lanes, each sample with its own table.

    Returns which samples are not computed, because they fail or have big angles: the caller runs them one by one.
    """
    left = np.ones(len(at), np.bool_)
    if not lane_names.fits(spec) or table.bodies[0]["kind"] == ANY_NORM or table.bodies["leader"].any():
        return left
    core, kernel = _core(spec, table, hashable(static)), lane_batches.batches(spec, edited=True)
    count = max(lane_names.width(), EDITED_BYTES // table.bodies.nbytes)
    for first in range(0, len(at), count):
        here = slice(first, min(first + count, len(at)))
        n = here.stop - first
        of_each = [x[here] if len(x) == len(at) else np.repeat(x, n, axis=0) for x in values]
        given = [y for x in inputs for y in ((x[here], 1) if len(x) == len(at) else (x, 0))]
        results, status = np.empty((n, *core)), np.full(n, numba_kernels.NONFINITE, np.int8)
        kernel.prepare(n)
        kernel(edits.tables(table.bodies, parameters, of_each), n, *given, *static, results, status)
        flat = results.reshape(n, -1)
        _store(out, at[here], flat if columns is None else flat[:, columns], status)
        left[here] = status != numba_kernels.OK
    return left


def run_in_numpy(
    spec: Spec,
    table: Table,
    inputs: Arrays,
    static: tuple[Any, ...],
    out: NDArray[Any],
    at: NDArray[np.intp],
    columns: NDArray[np.intp] | None = None,
    seen: bool = True,
    parameters: Sequence[Parameter] = (),
    values: Arrays = (),
) -> Failed:
    """As ``run_table_kernel``, by the recursion in NumPy, which compiles nothing.

    parameters, values  the parameters, and their values in the samples: each (k, ...), or (1, ...) for all samples
    """
    evaluate = Evaluation(spec, table.bodies, static, parameters)

    def compute(here: slice, given: Arrays, flat: NDArray[np.float64], status: NDArray[np.int8]) -> None:
        evaluate(given, flat, status, [x[here] if len(x) == len(at) else x for x in values])

    return _in_slices(
        compute, len(table.bodies), math.prod(_core(spec, table, hashable(static))), inputs, out, at, columns, seen
    )


def _in_slices(
    compute: Callable[[slice, Arrays, NDArray[np.float64], NDArray[np.int8]], None],
    rows: int,
    width: int,
    inputs: Arrays,
    out: NDArray[Any],
    at: NDArray[np.intp] | None,
    columns: NDArray[np.intp] | None,
    seen: bool,
    least: int = 1,
) -> Failed:
    """Compute samples in slices, between which Ctrl-C is handled, as ``run_table_kernel``; returns those that failed.

    compute  ``(slice of the samples, their inputs, flat results, status)``; results and status are written in place
    least    least samples of a slice: so many take hardly longer than one
    """
    count = len(out) if at is None else len(at)
    in_place = at is None and columns is None and out.dtype == np.float64
    failed: list[Failed] = []
    first = 0
    with watch.batch(count, lambda: first):
        try:
            for first, end in threads.slices(count, rows, width, least):
                here = slice(first, end) if at is None else at[first:end]
                given = [x[first:end] if len(x) == count else x for x in inputs]
                flat = out[here] if in_place else np.empty((end - first, width))
                status = np.empty(end - first, np.int8)
                compute(slice(first, end), given, flat, status)
                if not in_place:
                    _store(out, here, flat if columns is None else flat[:, columns], status)
                rows_failed = np.flatnonzero(status != numba_kernels.OK)
                if len(rows_failed):
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
    """Shape of one sample of the output, as the table kernel takes it: a scalar has the shape (1,)."""
    return recording.shape_of(spec.output, table.bodies, static) or (1,)


def _share(kernel: Any, rows: Any, inputs: Arrays, static: tuple[Any, ...], out: Any, status: Any) -> None:
    """Run the table kernel over the samples of ``out``, shared among the threads."""
    n, known = len(out), [getattr(x, STATIC) if isinstance(x, StaticTable) else x for x in static]

    def part(first: int, end: int) -> int:
        passed = [y for x in inputs for y in ((x[first:end], 1) if len(x) == n else (x, 0))]
        return int(kernel(rows, end - first, *passed, *known, out[first:end], status[first:end]))

    threads.thread_pool.share(0, n, SHARE, part)


def _store(out: NDArray[Any], here: Any, results: NDArray[np.float64], status: NDArray[np.int8]) -> None:
    """Write results to the rows ``here`` of ``out``; a result that overflows the dtype of ``out`` has status RANGE."""
    with np.errstate(over="ignore"):
        out[here] = results
    if out.dtype == np.float64:
        return
    overflowed = (np.isfinite(results) & ~np.isfinite(out[here])).any(axis=1)
    status[overflowed & ((status == numba_kernels.OK) | (status == numba_kernels.NONFINITE))] = RANGE

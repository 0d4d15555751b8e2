"""A call over the samples of a batch without a program: by its table kernel, or by the recursion in NumPy.

NumPy computes what no kernel is compiled for: a few samples of NaN or infinity, models without joints. The results are
written in place; the samples that failed are returned.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.static_table import StaticTable
from ..bodies.table import ANY_NORM
from ..recursions.spec import Spec, shape_in, sizes_of
from ..waiting import watch
from . import mimic_batches, threads
from .compiled import entries, lane_batches, lane_names, numba_kernels, tiers
from .failed import RANGE, Arrays, Failed, concatenate_failed, in_order
from .numbers.samples import Evaluation
from .programs.record import parameters as edits
from .programs.record import recording
from .programs.record.parameters import Parameter
from .programs.run import batch_kernels
from .programs.run.batches import NONE
from .tables import Table, hashable

SHARE = 10**9 if numba_kernels.PLAIN else 128  # least samples of a thread: fewer take less time than waking it
FEW, FEW_NUMBERS = 512, 1 << 20  # most samples, and most numbers in their results, that NumPy computes
FEW_ALONE = 16  # as FEW, for a recursion that branches on values, which NumPy runs on one sample at a time
MANY_ALONE = 512  # a batch of so many samples compiles a recursion that branches on values at once
MOST_STEPS = 200_000  # most rows of the table times numbers of a result that NumPy computes
EDITED_BYTES = 1 << 24  # of the tables of samples with parameters of their own, at a time
STATIC = "rows" if numba_kernels.PLAIN else "address"  # the attribute of a StaticTable that kernels take


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

    inputs   of these samples, as of ``run.batch``
    out      (n, columns) of any float dtype, written in place
    at       the rows of ``out`` of these samples; all rows by default
    columns  the wanted entries of a flat result; all entries by default
    seen     as of ``run.batch``

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


def few_samples(spec: Spec, table: Table, static: tuple[Any, ...]) -> int:
    """The number of samples that NumPy computes in the time of compiling the table kernel; 0 if NumPy cannot."""
    if numba_kernels.PLAIN or table.bodies[0]["kind"] == ANY_NORM:
        return 0
    numbers = max(1, math.prod(sample_shape(spec, table, hashable(static))))
    if len(table.bodies) * numbers > MOST_STEPS:
        return 0
    most = min(FEW, FEW_NUMBERS // numbers)
    if spec.term_shape:  # as of crba_solve, which factors M: 186 samples of 100 rows take 17 s
        most = min(most, MOST_STEPS // max(1, math.prod(shape_in(spec.term_shape[:2], sizes_of(table.bodies)))))
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
    return odd if len(odd) <= few_samples(spec, table, static) else NONE


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
    core, rows = sample_shape(spec, table, hashable(static)), getattr(table, numba_kernels.TABLE)
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
    core, kernel = sample_shape(spec, table, hashable(static)), lane_batches.batches(spec, edited=True)
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

    width = math.prod(sample_shape(spec, table, hashable(static)))
    return _in_slices(compute, len(table.bodies), width, inputs, out, at, columns, seen)


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
def sample_shape(spec: Spec, table: Table, static: tuple[Any, ...]) -> tuple[int, ...]:
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

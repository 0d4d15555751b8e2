"""A call in double-double over a batch: as a program on SIMD lanes if that is faster, else by NumPy."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..recursions.spec import Spec
from ..waiting import watch
from . import threads
from .compiled import numba_kernels
from .failed import Arrays
from .numbers.double_double import DoubleDouble, record_double_double
from .programs.record import recording
from .programs.record.mimic_rows import evaluate
from .programs.run import batch_kernels
from .tables import Table

LEAST_BATCH = 512  # smaller batches do not run on lanes
MOST_ROWS = 32  # for tables with more rows, double-double programs take too long to compile


def compute_on_lanes(spec: Spec, table: Table, inputs: Arrays, out: NDArray[np.float64]) -> bool:
    """Compute a batch on lanes; returns whether that was done and every sample is valid.

    If it returns False, and after Ctrl-C, ``out`` holds no results.

    inputs  each (n, columns) in C order, or (1, columns) for all samples
    out     (n, columns) in C order, written in place
    """
    kernel = _lane_kernel(spec, table) if len(out) >= LEAST_BATCH else None
    rejected = None if kernel is None else kernel(inputs, (out,), seen=False)
    return rejected is not None and not len(rejected)


def rewrite(spec: Spec, table: Table, inputs: Arrays, out: NDArray[np.float64], seen: bool = True) -> None:
    """Replace the finite samples of ``out``, which are float64 results, by double-double results.

    Arguments as of ``compute_on_lanes``.

    seen  as of ``run.batch``
    """
    left = np.isfinite(out).all(axis=1)
    kernel = _lane_kernel(spec, table) if len(out) >= LEAST_BATCH else None
    if kernel is not None:
        results = np.empty(out.shape)
        try:
            rejected = kernel(inputs, (results,), seen)
        except KeyboardInterrupt:
            if seen:
                out[...] = results
            raise
        if rejected is not None:
            valid = np.ones(len(out), bool)
            valid[rejected] = False
            out[valid] = results[valid]
            left &= ~valid
    rest, program = np.flatnonzero(left), _numpy_program(spec, table) if left.any() else None
    first = 0
    try:
        with watch.batch(len(rest), lambda: first):
            for first, end in threads.slices(len(rest), len(table.bodies), len(table.bodies) ** 2):
                at = rest[first:end]
                columns = [np.broadcast_to(x if len(x) == 1 else x[at], (len(at), x.shape[1])) for x in inputs]
                out[at] = program(np.ascontiguousarray(np.concatenate(columns, axis=1).T))[0].T  # type: ignore[misc]
                first = end
    except KeyboardInterrupt:
        if seen:
            out[rest[first:]] = np.nan
        raise


def runs_on_lanes(spec: Spec, table: Table) -> bool:
    """Whether a call has a double-double program on SIMD lanes; compiles the program."""
    return _lane_kernel(spec, table) is not None


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def _lane_kernel(spec: Spec, table: Table) -> batch_kernels.Kernel | None:
    """The double-double program on SIMD lanes; None if not applicable."""
    if numba_kernels.PLAIN or not 1 < len(table.bodies) <= MOST_ROWS + 1:
        return None
    return batch_kernels.kernel((spec,), table.bodies, table.key, options=recording.ProgramOptions(double_double=True))


@lru_cache(maxsize=batch_kernels.CACHE_SIZE)
def _numpy_program(spec: Spec, table: Table) -> DoubleDouble:
    """The double-double program for NumPy, for small batches and tables of any size."""
    shapes = [recording.shape_of(x, table.bodies) for x in spec.present]
    places = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])
    output = recording.shape_of(spec.output, table.bodies)

    def made(rows: Any, x: Any) -> list[Any]:
        parts = {
            arg.name: x[first:end].reshape(shape)
            for arg, first, end, shape in zip(spec.present, places[:-1], places[1:], shapes, strict=True)
        }
        return list(evaluate(spec, rows, output, parts, np.empty(len(rows) - 1, object)))

    return record_double_double(table.bodies, int(places[-1]), made)

"""A call over the samples of a batch, one or many: by its program if it has one, else by the table kernel.

The choice depends on the table and the call alone. The recursion in NumPy computes the samples that a program rejects
(angles beyond its range, NaN, joints of almost no articulated inertia), however many there are: the table kernel takes
seconds to compile, and its results have other bits. The results are written in place; the samples that failed are
returned.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bodies.table import ANY_NORM
from ..recursions.spec import Spec
from . import by_table_kernel, locks, mimic_batches
from .compiled import entries, lane_batches, lane_names, numba_kernels, tiers
from .failed import ALL_OK, Arrays, Failed, concatenate_failed, in_order
from .programs.record import recording
from .programs.run import batch_kernels
from .programs.run.tiered_program import TieredProgram
from .tables import Table, hashable

MOST_BESIDE_LANES = 2080  # most numbers, in one triangle, that M may hold for a program, if lanes can: a chain of 64
CHECKS_SECONDS = 1e-4  # time of the checks of a call in Python, which a plan of one sample saves
MANY = 8192  # samples of the batches that ``compile_program`` prepares for
_lock = locks.new()


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
        failed = by_table_kernel.run_in_numpy(self.spec, self.table, rest, self.static, out, left, seen=seen)
        return self._off_norm(failed, inputs, out, seen) if self.table.bodies[0]["kind"] == ANY_NORM else failed

    def _off_norm(self, failed: Failed, inputs: Arrays, out: NDArray[np.float64], seen: bool) -> Failed:
        """Compute samples off unit norm, which the table allows, by the table kernel; returns those that failed."""
        off = failed.status == numba_kernels.UNIT
        if not off.any():
            return failed
        at, kept = failed.samples[off], np.flatnonzero(~off)
        rest = [x[at] if len(x) == len(out) else x for x in inputs]
        again = by_table_kernel.run_table_kernel(self.spec, self.table, rest, self.static, out, at, seen=seen)
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
    if failed is not None:
        return failed
    return by_table_kernel.run_table_kernel(spec, table, inputs, static, out, seen=seen)


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
    if 8 * math.prod(by_table_kernel.sample_shape(spec, table, hashable(static))) * MANY >= batch_kernels.STREAM_BYTES:
        made.program.compiled(one=False, stream=True)
    return True


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
        or count > by_table_kernel.few_samples(spec, table, static)
        or program(spec, table, hashable(static)) is not None
    ):
        return ALL_OK
    out = np.empty((count, math.prod(by_table_kernel.sample_shape(spec, table, hashable(static)))))
    return by_table_kernel.run_in_numpy(spec, table, inputs, static, out, np.arange(count))

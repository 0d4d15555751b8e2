"""Batches on any table: by the kernel on lanes or the table kernel of one sample, which give the same bits.

Each takes as long to compile as the other, and computes what the other is for: one sample takes 1.1 to 1.9 times as
long on lanes, a batch up to ``width`` times as long sample by sample. So the first call compiles the kernel that suits
it, if neither is on disk, and the other one is compiled when that pays.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ...recursions.spec import Spec
from . import disk_cache, lane_kernels, lane_names, numba_kernels
from .tiers import Tier, is_stored

COMPILE_SECONDS = 6.0  # expected time to compile a kernel on lanes, or of one sample


class LaneBatches(Tier):
    """As ``numba_kernels.batch_kernel``, on lanes if they are compiled, or are to be: see above.

    Its clock counts the time spent without lanes; once they are compiled, the time of few samples on them.
    """

    compile_seconds = COMPILE_SECONDS

    def __init__(self, spec: Spec, width: int, edited: bool = False) -> None:
        """The batches of a call for which ``lane_names.fits``, on so many lanes; ``edited`` as of ``lane_kernels``."""
        super().__init__()
        self._spec, self._width, self._edited = spec, width, edited
        self._has_one, self._looked_for_one = False, False

    def _compile(self) -> Callable[..., int]:
        made, self._spent = lane_kernels.kernel(self._spec, self._width, self._edited), 0.0
        return made

    def _is_stored(self, *arguments: Any) -> bool:
        return lane_kernels.is_stored(self._spec, self._width, self._edited)

    def prepare(self, count: int) -> None:
        """Load or compile the kernel for a batch of ``count`` samples, on the calling thread."""
        many = 2 * count > self._width
        if many and self._code is None and not (self._has_one or self._one_at_hand()):
            self.spend(self.compile_seconds)  # to compile the kernel of one sample
        if (self.code() if many else self._code) is None or (not many and self._one_is_better()):
            self._one()

    def _one_is_better(self) -> bool:
        """Whether few samples take the kernel of one sample, which is on disk, or pays by now."""
        first, self._looked_for_one = not (self._looked_for_one or self._has_one), True
        return self.pays or (first and self._one_at_hand())

    def _one_at_hand(self) -> bool:
        """Whether the kernel of one sample is in memory or on disk."""
        if self._edited:
            return lane_kernels.is_stored(self._spec, 1, edited=True)
        return numba_kernels.is_made(self._spec) or one_is_stored(self._spec)

    def _one(self) -> Callable[..., int]:
        """The kernel of one sample at a time."""
        edited, spec = self._edited, self._spec
        made = lane_kernels.kernel(spec, 1, edited=True) if edited else numba_kernels.batch_kernel(spec)
        self._has_one = True
        return made

    def compile_now(self) -> None:
        """Compile the kernels, whether that pays or not."""
        self._one()
        if self._spec.mirrored and self._width == lane_kernels.WIDE:
            batches(self._spec, self._width // 2, self._edited).compile_now()
        super().compile_now()

    def __call__(self, table: Any, n: int, *arguments: Any) -> int:
        """As the kernels; ``table`` is an address, or for edited samples the array of their tables (n, rows)."""
        lanes, at = self._code, table.ctypes.data if self._edited else table
        few = 2 * n <= self._width
        if lanes is None or (few and self._has_one):
            return int(self.timed(self._one(), at, n, *arguments))
        left = self.timed(lanes, at, n, *arguments) if few else lanes(at, n, *arguments)
        if left == 0:
            return 0
        if left == lane_kernels.TOO_LARGE and self._width == lane_kernels.WIDE:
            narrower = batches(self._spec, self._width // 2, self._edited)
            narrower.prepare(n)
            return narrower(table, n, *arguments)
        if left < 0:  # no sample is computed
            return self._one()(at, n, *arguments)
        return self._again(table, arguments)

    def _again(self, table: Any, arguments: tuple[Any, ...]) -> int:
        """Compute the samples that the kernel on lanes has left; returns how many failed."""
        *given, out, status = arguments
        again = np.flatnonzero(status == lane_kernels.RETRY)
        varying = 2 * sum(not x.static for x in self._spec.present)
        for k in range(0, varying, 2):
            if given[k + 1]:
                given[k] = given[k][again]
        own = table[again] if self._edited else None  # held until the kernel returns
        at = table if own is None else own.ctypes.data
        results, found = np.empty((len(again), *out.shape[1:])), np.empty(len(again), np.int8)
        failed = self._one()(at, len(again), *given, results, found)
        out[again], status[again] = results, found
        return failed


@cache
def _batches(spec: Spec, width: int, edited: bool) -> LaneBatches:
    return LaneBatches(spec, width, edited)


def batches(spec: Spec, width: int | None = None, edited: bool = False) -> LaneBatches:
    """The LaneBatches of a call, by default on all lanes of a vector."""
    return _batches(spec, width or lane_names.width(), edited)


def one_is_stored(spec: Spec) -> bool:
    """Whether the compiled ``sample_kernel`` of a call on lanes is on disk."""
    from . import jit

    if disk_cache.folder() is None:
        return False
    return is_stored(jit.numba_jit(numba_kernels.sample_source(spec), contract=False), numba_kernels.signature(spec))

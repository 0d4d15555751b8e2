"""Batches on any table: by the table kernel of one sample until compiling the kernel on lanes pays.

Both kernels give the same bits. The kernel on lanes is a ``Tier``; until its code is there, the kernel of one sample
computes the batches.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ...recursions.spec import Spec
from . import lane_kernels, lane_names, numba_kernels
from .tiers import Tier

COMPILE_SECONDS = 6.0  # expected time to compile a kernel on lanes


class LaneBatches(Tier):
    """As ``numba_kernels.batch_kernel``, on lanes once compiling that kernel pays."""

    compile_seconds = COMPILE_SECONDS

    def __init__(self, spec: Spec, width: int, edited: bool = False) -> None:
        """The batches of a call for which ``lane_names.fits``, on so many lanes; ``edited`` as of ``lane_kernels``."""
        super().__init__()
        self._spec, self._width, self._edited = spec, width, edited

    @property
    def is_made(self) -> bool:
        """Whether the kernel on lanes is in memory."""
        return self._code is not None

    def _compile(self) -> Callable[..., int]:
        return lane_kernels.kernel(self._spec, self._width, self._edited)

    def _is_stored(self, *arguments: Any) -> bool:
        return lane_kernels.is_stored(self._spec, self._width, self._edited)

    def prepare(self, count: int) -> None:
        """Load or compile the kernel for a batch of ``count`` samples, on the calling thread."""
        if (self.code() if 2 * count > self._width else self._code) is None:
            self._one()

    def _one(self) -> Callable[..., int]:
        """The kernel of one sample at a time."""
        if self._edited:
            return lane_kernels.kernel(self._spec, 1, edited=True)
        return numba_kernels.batch_kernel(self._spec)

    def compile_now(self) -> None:
        """Compile the kernels, whether that pays or not."""
        self._one()
        if self._spec.mirrored and self._width == lane_kernels.WIDE:
            batches(self._spec, self._width // 2, self._edited).compile_now()
        super().compile_now()

    def __call__(self, table: Any, n: int, *arguments: Any) -> int:
        """As the kernels; ``table`` is an address, or for edited samples the array of their tables (n, rows)."""
        lanes, at = self._code, table.ctypes.data if self._edited else table
        if lanes is None or 2 * n <= self._width:
            return int(self.timed(self._one(), at, n, *arguments))
        left = lanes(at, n, *arguments)
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

"""Batches of samples run by machine code on several threads, in slices between which Ctrl-C is handled."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....waiting import watch
from ...threads import thread_pool

NONE = np.empty(0, np.intp)


class Batches(ABC):
    """A program over batches: the part that compiled and interpreted programs share.

    dtype    dtype of all arrays
    lanes    samples of a tile
    inputs   columns of each input
    outputs  columns of each output
    share    least number of tiles that a thread runs
    """

    dtype: np.dtype[Any]
    lanes: int
    inputs: tuple[int, ...]
    outputs: tuple[int, ...]
    share: int

    @property
    @abstractmethod
    def reach(self) -> int:
        """The number of tiles, or of steps of one tile, that a thread runs until Ctrl-C is handled."""

    def __call__(
        self, inputs: Sequence[NDArray[Any]], outputs: Sequence[NDArray[Any]], seen: bool = True
    ) -> NDArray[np.intp] | None:
        """Compute a batch; returns the indices of rejected samples, which the caller has to recompute.

        inputs   (n, columns) in C order, or (1, columns) for all samples
        outputs  (n, columns) in C order, written in place
        seen     whether the caller reads outputs after Ctrl-C

        Returns None if not applicable: arrays of other sizes, order or dtype, or an output that overlaps another array.
        After Ctrl-C, which is handled between slices, outputs hold the results so far and NaN in the other samples; if
        ``seen`` is false, their values are unspecified.
        """
        n, dtype = len(outputs[0]), self.dtype
        arguments: list[Any] = []
        for x, columns in zip(inputs, self.inputs, strict=True):  # written out: it counts in batches of 100 samples
            rows = len(x)
            if x.shape != (rows, columns) or not (rows == n or rows == 1):
                return None
            if not ((x.dtype is dtype or x.dtype == dtype) and x.flags.c_contiguous):
                return None
            arguments += (x, rows)
        for y, columns in zip(outputs, self.outputs, strict=True):
            flags = y.flags
            if y.shape != (n, columns) or y.dtype != dtype or not (flags.c_contiguous and flags.writeable):
                return None
        tiles = -(-n // self.lanes)
        threads = self.threads(tiles)
        reach = self.reach * threads
        if tiles <= reach:
            try:
                return self._part(n, [*arguments, *outputs], threads)
            except KeyboardInterrupt:  # the indices of rejected samples are lost
                _forget(outputs if seen else (), 0)
                raise
        if overlap(inputs, outputs):  # a slice would check only its own rows
            return None
        found: list[NDArray[np.intp]] = []
        done = 0
        try:
            with watch.batch(n, lambda: done):
                while done < n:
                    end = min(done + reach * self.lanes, n)
                    part = [*self._cut(inputs, done, end, n), *(y[done:end] for y in outputs)]
                    some = self._part(end - done, part, threads)
                    found += [] if some is None else [some + done]
                    done = end
        except KeyboardInterrupt:
            _forget(outputs if seen else (), done, found)
            raise
        return np.concatenate(found)

    def threads(self, tiles: int) -> int:
        """How many threads share so many tiles."""
        most = tiles // self.share
        return max(1, min(thread_pool.size, most)) if most > 1 else 1

    def _cut(self, inputs: Sequence[NDArray[Any]], first: int, end: int, n: int) -> list[Any]:
        arguments: list[Any] = []
        for x in inputs:
            part = x[first:end] if len(x) == n else x
            arguments += [part, len(part)]
        return arguments

    @abstractmethod
    def _part(self, n: int, arguments: list[Any], threads: int) -> NDArray[np.intp] | None:
        """Compute n samples on these threads without the GIL; returns the same as ``__call__``.

        arguments  for each input the array and its number of rows, then the outputs
        """


def _forget(outputs: Sequence[NDArray[Any]], done: int, rejected: Sequence[NDArray[np.intp]] = ()) -> None:
    """Write NaN to the rejected samples of outputs, and to those from ``done`` on."""
    for y in outputs:
        y[done:] = np.nan  # a slice: far faster than indices
        for samples in rejected:
            y[samples] = np.nan


def overlap(inputs: Sequence[NDArray[Any]], outputs: Sequence[NDArray[Any]]) -> bool:
    """Whether an output may share memory with another array."""
    return any(np.may_share_memory(y, x) for k, y in enumerate(outputs) for x in (*inputs, *outputs[:k]))


def rejected(bits: NDArray[np.uint16], width: int, n: int) -> NDArray[np.intp]:
    """The indices of the samples below n whose bit is 0; each number has ``width`` bits."""
    whole = (1 << width) - 1
    if bits.tobytes() == whole.to_bytes(2, sys.byteorder) * len(bits):
        return NONE
    lane = np.arange(width)
    with_rejected = np.flatnonzero(bits != whole)
    found = (with_rejected[:, None] * width + lane)[(bits[with_rejected, None] >> lane & 1) == 0]
    return np.asarray(found[found < n])

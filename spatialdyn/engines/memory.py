"""Memory of results: the pool keeps the memory of large results when they are freed, and uses it again.

The system provides a zeroed page at the first write to it. For large results, such as the mass matrices of 8192
humanoids (121 MB), that takes longer than computing them; pages of 4 KB take much longer than huge pages of 2 MB.

A block returns to the pool when the result and all its views are gone. The pool keeps at most MOST bytes of free
blocks, which the system may reclaim if memory is short (MADV_FREE). Blocks are private to the process and its forks.
"""

from __future__ import annotations

import math
import mmap
import threading
from collections import deque
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from . import locks

ALIGNED = 1 << 20  # least bytes of a result aligned to 64 bytes, which stores that bypass the CPU caches need
POOLED = 16 << 20  # least bytes of a block: the C library itself reuses smaller ones
MOST = 256 << 20  # most bytes of free blocks in the pool
PAGE = 2 << 20  # bytes of a huge page
SPARE = 1.25  # a block is at most this many times as large as a result in it

_PRIVATE = {"flags": mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS} if hasattr(mmap, "MAP_ANONYMOUS") else {}


class Block:
    """Memory from the system, returned when this object is freed."""

    def __init__(self, size: int) -> None:
        """``size`` bytes, not written yet. Raises MemoryError."""
        self.size = size
        try:
            self._memory = mmap.mmap(-1, size, **_PRIVATE)
        except (OSError, ValueError, OverflowError):
            raise MemoryError(f"no memory for a result of {size} bytes") from None
        self._advise("MADV_HUGEPAGE")
        self.address = int(np.frombuffer(self._memory, np.uint8).ctypes.data)

    def release(self) -> None:
        """Let the system reclaim the pages, if it can, until they are written again."""
        self._advise("MADV_FREE")

    def _advise(self, name: str) -> None:
        if hasattr(mmap, name):
            with suppress(OSError):  # a kernel without huge pages
                self._memory.madvise(getattr(mmap, name))


class _Loan:
    """The owner of a result's memory; NumPy keeps it while a view of the result lives."""

    def __init__(self, pool: Pool, block: Block, size: int) -> None:
        self._pool, self._block = pool, block
        self.__array_interface__ = {"data": (block.address, False), "shape": (size,), "typestr": "|u1", "version": 3}

    def __del__(self) -> None:
        self._pool.give(self._block)


class Pool:
    """Free blocks, the last used last."""

    def __init__(self) -> None:
        self._free: list[Block] = []
        self._given: deque[Block] = deque()  # blocks from ``give`` that are not in ``_free`` yet
        self._lock = locks.new(threading.Lock)

    @property
    def kept(self) -> int:
        """Bytes of the free blocks."""
        return sum(block.size for block in (*self._free, *self._given))

    def borrow(self, size: int) -> NDArray[np.uint8]:
        """An array of this number of bytes, in the memory of a freed result if possible. Raises MemoryError."""
        size_of_block = -(-size // PAGE) * PAGE
        block = self._taken(size_of_block)
        if block is None:
            try:
                block = Block(size_of_block)
            except MemoryError:
                self.clear()
                block = Block(size_of_block)
        return np.asarray(_Loan(self, block, size))

    def give(self, block: Block) -> None:
        """Take back a block for later results; when too many are free, the pool drops those used longest ago.

        The garbage collector may call this method at any time, also within ``borrow``, so it waits for no lock.
        """
        if block.size <= MOST:
            block.release()
            self._given.append(block)
            self._settle()

    def clear(self) -> None:
        """Give all free blocks back to the system."""
        self._free, self._given = [], deque()

    def _settle(self) -> None:
        """Move given blocks to the free ones, and drop the oldest beyond MOST bytes."""
        if self._lock.acquire(blocking=False):
            try:
                while self._given:
                    self._free.append(self._given.popleft())
                while self._free and sum(block.size for block in self._free) > MOST:
                    del self._free[0]
            finally:
                self._lock.release()

    def _taken(self, size: int) -> Block | None:
        """The last free block that is large enough; None if there is none."""
        self._settle()
        if self._lock.acquire(blocking=False):
            try:
                for k in reversed(range(len(self._free))):
                    if size <= self._free[k].size <= SPARE * size:
                        return self._free.pop(k)
            finally:
                self._lock.release()
        return None


pool = Pool()


def empty(shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """An uninitialized array, from 1 MiB on aligned to 64 bytes, from 16 MiB on in memory of the pool."""
    kind = np.dtype(dtype)
    size = kind.itemsize * math.prod(shape)
    if size < ALIGNED:
        return np.empty(shape, kind)
    if POOLED <= size <= MOST:
        return pool.borrow(size).view(kind).reshape(shape)
    raw = np.empty(size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + size].view(kind).reshape(shape)

"""The thread pool that shares a batch, and slices of work between which Ctrl-C is handled."""

from __future__ import annotations

import math
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SpatialDynError, literal
from . import locks

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

SLICE_SECONDS = 0.05  # seconds of a slice, after which Ctrl-C is handled, for samples outside of programs
FIRST_SLICE = 1 << 18  # rows² or rows times results, summed over the samples of the first slice

PIECES = 4  # pieces of a thread's share of a batch: other threads take the pieces of a thread that starts late
IDLE = 0.5  # the machine is busy if a thread waits for others, or for a core, longer than this part of its work time
PAUSE = 10.0  # on a busy machine batches run on one thread for this many times that wait, at most MOST_PAUSE seconds
MOST_PAUSE = 1.0
MOST_THREADS = 1 << 20  # largest number passed to compiled code
FINE_CLOCK = time.get_clock_info("thread_time").resolution < 1e-5  # 16 ms on Windows
VARIABLE = "SPATIALDYN_NUM_THREADS"
_V2 = "/sys/fs/cgroup/cpu.max", ""  # files of a control group's quota and its period
_V1 = "/sys/fs/cgroup/cpu/cpu.cfs_quota_us", "/sys/fs/cgroup/cpu/cpu.cfs_period_us"

_lock = locks.new(threading.Lock)


class ThreadPool:
    """The threads that share batches, and their number."""

    def __init__(self) -> None:
        self._pools: dict[int, ThreadPoolExecutor] = {}
        self._asked: int | None = None  # the number set by ``ask``
        self._found: tuple[int, bool] | None = None  # as of ``default_threads``
        self._forked = False
        self._pause = self._busy_until = 0.0
        self._most = np.zeros(1, np.int64)

    @property
    def most(self) -> NDArray[np.int64]:
        """The most threads of a batch that threads outside this pool compute: a word that compiled code reads."""
        self._tell()
        return self._most

    def _tell(self) -> None:
        self._most[0] = min(self._asked or default_threads(self._forked)[0], MOST_THREADS)

    @property
    def size(self) -> int:
        """The number of threads for a batch of the calling thread: the number set, else all cores in the main thread.

        By default the number is 1 while the machine is busy and in other threads, of which the program may start many.
        Raises SpatialDynError if the environment variable is no valid number.
        """
        if self._asked is not None:
            return self._asked
        if self._found is None:
            self._found = default_threads(self._forked)
        n, asked = self._found
        if n == 1 or asked:
            return n
        main = threading.get_ident() == threading.main_thread().ident
        return n if main and time.perf_counter() >= self._busy_until else 1

    def ask(self, n: int | None) -> None:
        """Run the batches of every calling thread on n threads; None: the default."""
        self._asked, self._busy_until = n, 0.0
        if self._most[0]:  # compiled code reads it
            self._tell()

    def forked(self) -> None:
        """In a forked child: forget the threads, which do not exist there; the child counts as a worker."""
        self._pools.clear()
        self._asked, self._found, self._forked = None, None, True

    def pool(self, threads: int) -> ThreadPoolExecutor:
        from concurrent.futures import ThreadPoolExecutor

        with _lock:
            if threads not in self._pools:
                locks.come_first()  # a fork then takes our locks before that of concurrent.futures
                self._pools[threads] = ThreadPoolExecutor(threads, thread_name_prefix="spatialdyn")
            return self._pools[threads]

    def together(self, work: Callable[[], Any], threads: int) -> list[Any]:
        """Call ``work`` in this number of threads, including the caller's; returns the results.

        The caller does not wait for a thread that has not begun when its own call ends, since no work is left then.
        All other threads have ended when this method returns or raises.
        """
        from concurrent.futures import wait

        began, busy = time.perf_counter(), time.thread_time()
        jobs = [self.pool(threads).submit(work) for _ in range(threads - 1)]
        try:
            made = [work()]
        finally:
            begun = [job for job in jobs if not job.cancel()]
            wait(begun)
        made += [job.result() for job in begun]
        busy = time.thread_time() - busy
        if FINE_CLOCK:
            self._judge(busy, time.perf_counter() - began - busy if begun else busy)
        return made

    def run(self, parts: Sequence[Callable[[], Any]], threads: int | None = None) -> list[Any]:
        """The results of the parts; each free thread takes the next part.

        threads  number of threads; by default one for each part

        All parts have ended when this method returns; if it raises, all parts that have begun have ended.
        """
        results: list[Any] = [None] * len(parts)
        left = deque(range(len(parts)))

        def work() -> None:
            while left:
                try:
                    k = left.popleft()
                except IndexError:  # another thread took it
                    return
                try:
                    results[k] = parts[k]()
                except BaseException:
                    left.clear()
                    raise

        self.together(work, len(parts) if threads is None else threads)
        return results

    def _judge(self, worked: float, idle: float) -> None:
        """Pause after a batch in which this thread was idle for long; the pause doubles if that happens in a row."""
        if idle <= IDLE * worked:
            self._pause = 0.0
            return
        self._pause = min(MOST_PAUSE, max(2.0 * self._pause, PAUSE * idle))
        self._busy_until = time.perf_counter() + self._pause

    def share(self, first: int, end: int, least: int, part: Callable[[int, int], int]) -> int:
        """The sum of ``part(first, end)`` over samples divided among the threads, at least ``least`` in each part."""
        n = end - first
        most = n // least
        threads = max(1, min(self.size, most))
        if threads == 1:
            return part(first, end)
        pieces = max(threads, min(most, PIECES * threads))
        cuts = [first + n * k // pieces for k in range(pieces + 1)]
        return sum(self.run([partial(part, *cut) for cut in pairwise(cuts)], threads))


def default_threads(worker: bool = False) -> tuple[int, bool]:
    """The number of threads that a process uses, and whether its environment sets it.

    The number is SPATIALDYN_NUM_THREADS if set; 1 in a ``worker``, such as a process of multiprocessing, joblib or
    Dask; else the number of cores that affinity and control group's quota allow, or OMP_NUM_THREADS if less.

    Raises SpatialDynError if SPATIALDYN_NUM_THREADS is not a whole number of at least 1.
    """
    own = os.environ.get(VARIABLE, "").strip()
    if own:
        if not (own.isdecimal() and int(own)):
            raise SpatialDynError(f"{VARIABLE} is {literal(own)}, expected a whole number of threads, at least 1")
        return int(own), True
    processes = sys.modules.get("multiprocessing.process")
    if worker or (processes is not None and processes.parent_process() is not None):
        return 1, False
    others = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
    cores = available_cores()
    return (min(cores, int(others)) if others.isdecimal() and int(others) else cores), False


def available_cores() -> int:
    """The number of cores that this process may use, by its affinity and its control group's quota, rounded up."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    for quota, period in (_V2, _V1):
        with suppress(OSError, ValueError, IndexError):
            words = " ".join(Path(name).read_text() for name in (quota, period) if name).split()
            if words[0] not in ("max", "-1"):
                return max(1, min(cores, math.ceil(int(words[0]) / int(words[1]))))
    return cores


def slices(n: int, rows: int, results: int, least: int = 1) -> Iterator[tuple[int, int]]:
    """Slices (first, end) of n samples, each of about SLICE_SECONDS of the caller's work; Ctrl-C is handled in between.

    rows, results  rows of the table, and numbers of a result, which set the size of the first slice
    least          least samples of a slice, also of the last slice, unless n is less
    """
    end, count = 0, max(least, FIRST_SLICE // (rows * max(rows, results)))
    while end < n:
        began, done = time.perf_counter(), end
        end = done + count if n - done - count >= least else n
        yield done, end
        spent = max(time.perf_counter() - began, 1e-6)
        count = least * max(1, int(min(10.0 * count, count * SLICE_SECONDS / spent)) // least)


thread_pool = ThreadPool()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=thread_pool.forked)


def set_num_threads(n: int) -> None:
    """Set the number of threads for later batches of all calling threads. Results do not depend on this number.

    By default a batch of the main thread that takes longer than about 0.2 ms runs on all cores that the process may use
    (affinity, control group; OMP_NUM_THREADS if less), while these cores are free. Batches of other threads and of
    worker processes (forked, multiprocessing, joblib, Dask) run on one thread. The environment variable
    SPATIALDYN_NUM_THREADS sets another number for a process and its workers. A forked child forgets the number set
    here.

    Raises SpatialDynError unless n is a whole number of at least 1.
    """
    if isinstance(n, bool) or not isinstance(n, (int, np.integer)) or n < 1:
        raise SpatialDynError(f"n is {literal(n)}, expected a whole number of threads, at least 1")
    thread_pool.ask(int(n))

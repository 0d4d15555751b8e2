"""A fork beside a thread that compiles: the child goes on, with every lock of the library free."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from slow import slow_but

import spatialdyn as sd
from spatialdyn.engines import locks
from spatialdyn.engines.compiled import numba_kernels

FORKS = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing compiles")

# A thread compiles; the main thread forks meanwhile; the child computes, makes threads and ends as processes do.
SCRIPT = """
import os, sys, threading, time, warnings
import numpy as np
import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.llvm import host_cpu
from spatialdyn.recursions import SPECS

way, samples, known = sys.argv[1], int(sys.argv[2]), sys.argv[3] == "known"
warnings.simplefilter("ignore")  # of forking a process with threads
model = sd.load_urdf("panda")
other = model if known else sd.load_urdf("ur5")
began = threading.Event()
right = host_cpu._object_code

def slow(*arguments):
    began.set()
    time.sleep(0.3)
    return right(*arguments)

host_cpu._object_code = slow

def compiles():
    if way == "program":
        sd.compile(model, "rnea")
    else:
        began.set()
        numba_kernels.batch_kernel(numba_kernels.variant(SPECS["center_of_mass"], ()))

thread = threading.Thread(target=compiles)
thread.start()
began.wait()
time.sleep(0.1)
child = os.fork()
if not child:
    q = np.zeros((samples, other.nv)) if samples else np.zeros(other.nv)
    assert np.isfinite(sd.rnea(other, q, q, q)).all()
    sd.compile(other, "rnea")
    if way == "kernel":
        numba_kernels.batch_kernel(numba_kernels.variant(SPECS["center_of_mass"], ()))
    sd.set_num_threads(2)
    sd.rnea(other, *(np.zeros((100_000, other.nv)) for _ in range(3)))
    sys.exit(7)
_, status = os.waitpid(child, 0)
thread.join()
assert os.waitstatus_to_exitcode(status) == 7, status
assert np.isfinite(sd.rnea(model, *(np.zeros(model.nv) for _ in range(3)))).all()
"""


@FORKS
@COMPILED
@pytest.mark.parametrize(
    ("way", "samples", "known"),
    slow_but(
        [("program", 0, "new"), ("program", 300, "known")],
        [*itertools.product(["program"], [0, 300], ["known", "new"]), ("kernel", 300, "new")],
    ),
)
def test_a_child_forked_beside_a_compiling_thread_goes_on(way: str, samples: int, known: str, tmp_path: Path) -> None:
    environment = {**os.environ, "SPATIALDYN_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", SCRIPT, way, str(samples), known]
    running = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        _, said = running.communicate(timeout=300.0)
    except subprocess.TimeoutExpired:
        os.killpg(running.pid, signal.SIGKILL)  # the child that hangs too
        running.communicate()
        raise
    assert not running.returncode, said


def every_lock(folder: Path) -> Iterator[str]:
    """Where the package makes a lock."""
    for path in folder.rglob("*.py"):
        for line in path.read_text(encoding="utf-8").splitlines():
            if "Lock()" in line or "RLock()" in line:
                yield f"{path.relative_to(folder).as_posix()}: {line.strip()}"


def test_one_place_makes_the_locks() -> None:
    """And ``algebra``, which lies below it."""
    found = {place.partition(":")[0] for place in every_lock(Path(sd.__file__).parent)}
    assert found == {"engines/locks.py", "algebra/scalars.py"}


@COMPILED
def test_the_locks_of_numba_and_llvmlite_are_found() -> None:
    """They are private: a version that has them elsewhere fails here, not in a child."""
    import llvmlite.binding.ffi
    from numba.core.compiler_lock import global_compiler_lock

    locked: list[bool] = []

    def look() -> None:
        locked.extend(not lock.acquire(blocking=False) for lock in locks.foreign())

    owners: Any = llvmlite.binding.ffi.lib._lock, global_compiler_lock
    with owners[0], owners[1]:
        other = threading.Thread(target=look)
        other.start()
        other.join()
    assert locked == [True, True]


@FORKS
def test_a_fork_waits_for_a_lock_without_holding_another() -> None:
    """Threads that take two locks in either order meet no deadlock."""
    one, two = locks.new(), locks.new(threading.Lock)
    stop, turns = threading.Event(), [0, 0]

    def take(k: int) -> None:
        first, second = ((one, two), (two, one))[k]
        while not stop.is_set():
            with first:
                if second.acquire(timeout=0.01):
                    turns[k] += 1
                    second.release()
            time.sleep(0.001)  # as no lock is fair: it would be taken again before another thread wakes

    threads = [threading.Thread(target=take, args=(k,)) for k in range(2)]
    for x in threads:
        x.start()
    try:
        for _ in range(20):
            locks._before()
            at = list(turns)
            time.sleep(0.005)
            assert turns == at
            locks._release()
    finally:
        stop.set()
        for x in threads:
            x.join()
    assert one.acquire(blocking=False)
    assert two.acquire(blocking=False)


def test_where_there_is_no_fork_the_package_is_imported() -> None:
    """As on Windows: nothing is registered then."""
    code = """
import os
for name in ("fork", "register_at_fork"):
    if hasattr(os, name):
        delattr(os, name)
import spatialdyn as sd
print(sd.rnea(sd.load_urdf("two_link"), [0.5, -0.3], [1.0, 2.0], [0.0, 0.0]).shape)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "(2,)", done.stderr

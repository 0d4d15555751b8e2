"""Long work on a thread of its own: the main thread hears Ctrl-C at once, and everything else is as without it."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from typing import Any

import numpy as np
import pytest
from inputs import empty_memory

import spatialdyn as sd
from spatialdyn.engines import interrupt
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.interrupt import interruptible
from spatialdyn.engines.programs.llvm import host_cpu
from spatialdyn.engines.programs.run import batch_kernels

COMPILED = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing compiles")


def test_a_call_on_another_thread_returns_and_raises_as_here() -> None:
    places: list[Any] = []

    def divide(a: float, b: float) -> float:
        places.append(threading.current_thread())
        return a / b

    assert interruptible(divide, 6.0, 3.0) == 2.0
    with pytest.raises(ZeroDivisionError):
        interruptible(divide, 6.0, 0.0)
    assert threading.main_thread() not in places
    with np.errstate(over="raise"):
        assert interruptible(np.geterr)["over"] == np.geterr()["over"] or np.__version__ < "2"


def test_other_threads_make_no_thread() -> None:
    found: list[Any] = []
    other = threading.Thread(target=lambda: found.append(interruptible(threading.current_thread)))
    other.start()
    other.join()
    assert found == [other]


def test_the_main_thread_hears_ctrl_c_while_the_work_goes_on() -> None:
    go, done = threading.Event(), threading.Event()

    def work() -> None:
        signal.raise_signal(signal.SIGINT)
        go.wait(60.0)
        done.set()

    with pytest.raises(KeyboardInterrupt):
        interruptible(work)
    assert not done.is_set()
    go.set()
    assert done.wait(60.0)


@COMPILED
@pytest.mark.parametrize("way", ["program", "kernel"])
def test_compiling_leaves_the_main_thread_free(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a long program; of kernels always. The next call compiles."""
    go, threads_of_work = threading.Event(), []

    def waits(*arguments: Any) -> Any:
        threads_of_work.append(threading.current_thread())
        signal.raise_signal(signal.SIGINT)
        go.wait(60.0)
        raise RuntimeError("after Ctrl-C")

    arm = sd.load_urdf("two_link")
    q = np.zeros((512, 2))
    if way == "program":
        monkeypatch.setattr(host_cpu, "LONG", 100)
        empty_memory(monkeypatch)
        monkeypatch.setattr(batch_kernels, "_from_disk_cache", lambda *words: None)
        with monkeypatch.context() as patch:
            patch.setattr(host_cpu, "_object_code", waits)
            with pytest.raises(KeyboardInterrupt):
                sd.specialize(arm, sd.generalized_gravity)
        assert sd.specialize(arm, sd.generalized_gravity)(q).shape == (512, 2)
    else:
        function = numba_kernels.kernel_from_text("twice", ["x"], ["stamp", "return 2.0 * x"], {})
        from spatialdyn.engines.compiled import jit

        dispatcher: Any = jit.numba_jit(function, keep=False)
        right = dispatcher.compile
        dispatcher.compile = waits
        with pytest.raises(KeyboardInterrupt):
            dispatcher(1.5)
        dispatcher.compile = right
        assert dispatcher(1.5) == 3.0
    go.set()
    assert threading.main_thread() not in threads_of_work
    assert len(threads_of_work) == 1


SCRIPT = """
import sys, threading
from spatialdyn.engines import interrupt
ended = []

def work():
    import signal, time
    signal.raise_signal(signal.SIGINT)
    time.sleep(0.3)
    print("worked", flush=True)

try:
    interrupt.interruptible(work)
except KeyboardInterrupt:
    print("heard", flush=True)
    if sys.argv[1] == "leave":
        interrupt.leave(130)
"""


@pytest.mark.parametrize(("way", "status", "lines"), [("exit", 0, ["heard", "worked"]), ("leave", 130, ["heard"])])
def test_a_process_waits_at_its_end_unless_it_leaves(way: str, status: int, lines: list[str]) -> None:
    """LLVM must not lose its memory while it compiles; the command line does not wait."""
    done = subprocess.run([sys.executable, "-c", SCRIPT, way], capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode, done.stdout.split(), done.stderr) == (status, lines, "")
    assert interrupt.INTERRUPTED == 130

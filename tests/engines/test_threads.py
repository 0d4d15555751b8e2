"""The number of threads: by default all cores for the main thread of a main process, one for workers."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import spatialdyn as sd
from spatialdyn.engines import threads
from spatialdyn.engines.threads import ThreadPool, default_threads


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight cores, no variable set, no worker."""
    for name in ("OMP_NUM_THREADS", threads.VARIABLE):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(threads, "available_cores", lambda: 8)
    monkeypatch.setitem(sys.modules, "multiprocessing.process", SimpleNamespace(parent_process=lambda: None))


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({}, (8, False)),
        ({"OMP_NUM_THREADS": "3"}, (3, False)),
        ({"OMP_NUM_THREADS": "4,2"}, (4, False)),
        ({"OMP_NUM_THREADS": "99"}, (8, False)),
        ({"OMP_NUM_THREADS": "0"}, (8, False)),
        ({"OMP_NUM_THREADS": "many"}, (8, False)),
        ({"OMP_NUM_THREADS": "1", threads.VARIABLE: "5"}, (5, True)),
        ({threads.VARIABLE: " 99 "}, (99, True)),
        ({threads.VARIABLE: ""}, (8, False)),
    ],
)
def test_the_environment_sets_the_number(
    variables: dict[str, str], expected: tuple[int, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert default_threads() == expected
    worker = expected if expected[1] else (1, False)
    assert default_threads(worker=True) == worker
    process = SimpleNamespace(parent_process=lambda: object())
    monkeypatch.setitem(sys.modules, "multiprocessing.process", process)
    assert default_threads() == worker


@pytest.mark.parametrize("value", ["0", "-2", "two", "1.5"])
def test_what_is_no_number_in_the_environment_is_named(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(threads.VARIABLE, value)
    with pytest.raises(sd.SpatialDynError, match=f"SPATIALDYN_NUM_THREADS is '{value}', expected a whole number"):
        assert ThreadPool().size


def test_threads_other_than_the_main_one_stay_single_unless_asked() -> None:
    pool = ThreadPool()
    with ThreadPoolExecutor(1) as other:
        assert pool.size == 8
        assert other.submit(lambda: pool.size).result() == 1
        pool.ask(3)
        assert (pool.size, other.submit(lambda: pool.size).result()) == (3, 3)
        pool.ask(None)
        assert pool.size == 8
        pool.forked()
        assert pool.size == 1
        pool.ask(2)
        assert pool.size == 2


@pytest.fixture
def control_group(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.undo()
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(6)), raising=False)
    monkeypatch.setattr(threads, "_V2", (str(tmp_path / "max"), ""))
    monkeypatch.setattr(threads, "_V1", (str(tmp_path / "quota"), str(tmp_path / "period")))
    return tmp_path


@pytest.mark.parametrize(
    ("files", "cores"),
    [
        ({}, 6),
        ({"max": "max 100000\n"}, 6),
        ({"max": "250000 100000\n"}, 3),
        ({"max": "50000 100000\n"}, 1),
        ({"max": "900000 100000\n"}, 6),
        ({"max": ""}, 6),
        ({"quota": "-1\n", "period": "100000\n"}, 6),
        ({"quota": "200000\n", "period": "100000\n"}, 2),
        ({"max": "nonsense", "quota": "200000\n", "period": "100000\n"}, 2),
    ],
)
def test_a_quota_of_the_control_group_counts_as_cores(control_group: Path, files: dict[str, str], cores: int) -> None:
    for name, text in files.items():
        (control_group / name).write_text(text)
    assert threads.available_cores() == cores


def test_a_busy_machine_is_left_to_others_for_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    """The longer the more often; a good batch forgets it. A number asked for stays."""
    clock = [100.0]
    monkeypatch.setattr(threads.time, "perf_counter", lambda: clock[0])
    pool = ThreadPool()
    pool._judge(1e-3, 0.4e-3)
    assert pool.size == 8
    pool._judge(1e-3, 2e-3)
    assert pool.size == 1
    clock[0] += 0.0201
    assert pool.size == 8
    pool._judge(1e-3, 1e-3)
    clock[0] += 0.0399
    assert pool.size == 1
    clock[0] += 0.0002
    assert pool.size == 8
    pool._judge(1e-3, 0.0)
    pool._judge(1e-3, 5.0)
    assert pool._pause == threads.MOST_PAUSE
    pool.ask(4)
    assert pool.size == 4


def test_a_thread_that_does_not_begin_is_not_waited_for() -> None:
    """Here the only other thread is taken by work that ends after this call."""
    pool, go = ThreadPool(), threading.Event()
    taken = [pool.pool(2).submit(go.wait, 60.0) for _ in range(2)]
    assert pool.together(lambda: threading.get_ident(), 2) == [threading.get_ident()]
    assert pool.run([lambda k=k: k for k in range(7)], 2) == list(range(7))  # type: ignore[misc]
    go.set()
    assert all(job.result() for job in taken)


def test_any_thread_takes_any_part() -> None:
    """The caller waits in its first part until another thread has done all others."""
    pool, rest = ThreadPool(), threading.Semaphore(0)

    def first() -> int:
        for _ in range(9):
            rest.acquire()
        return threading.get_ident()

    def other() -> int:
        rest.release()
        return threading.get_ident()

    parts: list[Any] = [first, *[other] * 9]
    found = pool.run(parts, 2)
    assert len(set(found)) == 2
    assert set(found[1:]) != {found[0]}


SCRIPT = """
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from spatialdyn.engines import threads

def size(_):
    return threads.thread_pool.size

if __name__ == "__main__":
    threads.available_cores = lambda: 8
    here = threads.thread_pool.size
    with ProcessPoolExecutor(1, get_context(sys.argv[1])) as workers:
        print(here, *workers.map(size, [0]))
"""


@pytest.mark.parametrize("way", ["spawn", "fork"])
def test_worker_processes_are_single(way: str, tmp_path: Path) -> None:
    if way == "fork" and not hasattr(os, "fork"):
        pytest.skip("no fork here")
    script = tmp_path / "workers.py"
    script.write_text(SCRIPT)
    ours = {name: value for name, value in os.environ.items() if name not in ("OMP_NUM_THREADS", threads.VARIABLE)}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", str(script), way], capture_output=True, text=True, check=True, env=ours
    )
    assert done.stdout.split() == ["8", "1"]


def test_compiled_code_gets_any_number_of_threads() -> None:
    pool = ThreadPool()
    pool.ask(3)
    word = pool.most
    assert word[0] == 3
    pool.ask(10**5000)
    assert 3 < word[0] <= threads.MOST_THREADS

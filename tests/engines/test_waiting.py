"""Long work is named once, while it goes on: through the logger, and in a line of the command line."""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
from contextlib import AbstractContextManager
from typing import Any

import pytest

import spatialdyn as sd
from spatialdyn import waiting
from spatialdyn.calls import progress
from spatialdyn.calls.progress import LOGGER, reporting
from spatialdyn.commands import cli
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.llvm import host_cpu
from spatialdyn.engines.programs.run import batch_kernels
from spatialdyn.waiting import watch


class Said(list[str]):
    """Messages; ``wait`` returns when there is one."""

    def __init__(self) -> None:
        super().__init__()
        self._any = threading.Event()

    def add(self, text: str) -> None:
        self.append(text)
        self._any.set()

    def wait(self) -> bool:
        return self._any.wait(30.0)


@pytest.fixture
def arm() -> sd.Model:
    """Asked for before ``said``, to which loading may take long."""
    return sd.load_urdf("two_link")


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Work takes long after 20 ms; the thread that looks sleeps no longer than that."""
    monkeypatch.setattr(waiting, "LONG", 0.02)
    watch.forget()


@pytest.fixture
def said(soon: None) -> Any:
    found = Said()
    with progress.messages(found.add):
        yield found


def pause() -> None:
    threading.Event().wait(0.1)


def test_long_work_is_named_while_it_goes_on(said: Said) -> None:
    with watch.work("counting sheep", lambda: "; they are kept"):
        assert said.wait()
    assert list(said) == ["counting sheep takes more than 0.02 s; they are kept"]


def test_it_is_named_once_and_not_by_its_parts(said: Said) -> None:
    with watch.work("all"):
        with watch.work("a part"):
            assert said.wait()
        with watch.work("another"):
            pause()
    assert list(said) == ["all takes more than 0.02 s"]
    with watch.work("the next"):
        pause()
    assert len(said) == 2


def test_short_work_and_work_that_raised_say_nothing(said: Said, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ZeroDivisionError), watch.work("dividing"):
        raise ZeroDivisionError
    with watch.work("little"):
        pass
    pause()
    assert list(said) == []


@pytest.mark.parametrize("how", [False, lambda done, total: None])
def test_a_report_of_progress_says_how_far_the_work_is(said: Said, how: Any) -> None:
    working: AbstractContextManager[Any] = reporting(how, "shearing")
    with working as report:
        report(2, 7)
        assert said.wait()
    assert list(said) == ["shearing takes more than 0.02 s: 2 of 7 steps are done"]


def test_a_call_that_compiles_is_named_once_with_what_compiles(said: Said) -> None:
    with reporting(False, "simulate"):
        with watch.work("compiling crba", lambda: "; it is kept"), watch.work("compiling a part of it"):
            assert said.wait()
        with watch.work("compiling rnea"):
            pause()
    assert list(said) == ["simulate takes more than 0.02 s: compiling crba; it is kept"]


def test_the_innermost_call_is_named_with_the_outermost(said: Said) -> None:
    """As the command line names a call that it makes, and not its own name twice."""
    with watch.call("excite"), watch.call("excitation"), watch.work("recording fourier"):
        assert said.wait()
    with watch.call("trade"), reporting(False, "trade") as report:
        report(3, 9)
        while len(said) < 2:
            pause()
    assert list(said) == [
        "excite takes more than 0.02 s: recording fourier",
        "trade takes more than 0.02 s: 3 of 9 steps are done",
    ]


def test_a_batch_says_how_many_are_done_and_one_sample_nothing_of_its_own(said: Said) -> None:
    for count in (1, 40):
        with watch.call("rnea"), watch.batch(count, lambda: 7):
            while len(said) < 1 + (count > 1):
                pause()
    assert list(said) == [
        "rnea takes more than 0.02 s",
        "rnea takes more than 0.02 s: a batch of 40 samples: 7 are done",
    ]


@pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: nothing compiles")
@pytest.mark.parametrize("way", ["program", "kernel"])
def test_what_compiles_is_named(arm: sd.Model, said: Said, way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if way == "program":
        right = host_cpu._object_code

        def slow(*arguments: Any) -> bytes:
            assert said.wait()
            return right(*arguments)

        monkeypatch.setattr(host_cpu, "_object_code", slow)
        monkeypatch.setattr(batch_kernels, "_from_disk_cache", lambda digest, kind: None)
        batch_kernels.forget()
        sd.specialize(arm, sd.crba)
    else:
        from spatialdyn.engines.compiled import jit

        monkeypatch.setattr(jit, "compile_signature", lambda *arguments, **options: said.wait())
        numba_kernels.sample_kernel.__wrapped__(numba_kernels.variant(sd.recursions.SPECS["crba"], ()))
    assert said[0].startswith(
        f"compiling the {'program' if way == 'program' else 'table kernel'} of crba takes more than"
    )
    assert "cache" in said[0]


def test_the_logger_is_the_packages_and_silent_by_itself() -> None:
    assert LOGGER.name == "spatialdyn"
    assert any(isinstance(x, logging.NullHandler) for x in LOGGER.handlers)
    code = """
import threading, spatialdyn
from spatialdyn import waiting
waiting.LONG = 0.01
with waiting.watch.work("waiting"):
    threading.Event().wait(0.1)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout + done.stderr == ""
    code = code.replace("\nfrom", "\nimport logging; logging.basicConfig(level='INFO')\nfrom", 1)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "INFO:spatialdyn:waiting takes more than 0.01 s\n"


@pytest.mark.parametrize("words", [[], ["--quiet"]])
def test_the_command_line_prints_it_unless_quiet(
    words: list[str], soon: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from spatialdyn.commands import compile as command

    def work(*arguments: Any, **named: Any) -> dict[str, float]:
        with watch.work("knitting"):
            pause()
        return {"rnea": 1.0}

    monkeypatch.setattr(command, "compile_calls", work)
    assert cli.main(["compile", "two_link", *words]) == 0
    assert ("spatialdyn: compile takes more than 0.02 s" in capsys.readouterr().err) == (not words)


def test_an_example_prints_it(soon: None, capsys: pytest.CaptureFixture[str]) -> None:
    from spatialdyn.examples import first_steps, gallery

    def main() -> None:
        with watch.work("knitting"):
            pause()

    main.__module__ = first_steps.__name__
    gallery.start(main, [])
    assert capsys.readouterr().err == "first_steps: the example takes more than 0.02 s: knitting\n"

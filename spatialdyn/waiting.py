"""Work that takes long is named once, while it goes on, by a function that the calls hand in.

One thread looks at what is at work, a few times in LONG seconds and only while there is some: to begin and end costs a
microsecond. The work may be one call of LLVM. Work within other work gets no line of its own.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import NamedTuple

LONG = 3.0  # seconds
LOOKS = 8  # in LONG seconds; after as many at nothing the thread waits for work


class Part(NamedTuple):
    """Work within other work: what is done, the end of its text, whether its own parts are named in its place."""

    what: str
    more: Callable[[], str]
    parts: bool


_within: ContextVar[list[Part] | None] = ContextVar("_within", default=None)  # what is done in the work, if any is on


class Watch:
    """What reports long work.

    tell  a function of a text, called in another thread; none by default
    """

    def __init__(self) -> None:
        self.tell: Callable[[str], None] = lambda text: None
        self.forget()
        if hasattr(os, "register_at_fork"):  # Windows has no fork
            os.register_at_fork(after_in_child=self.forget)

    def forget(self) -> None:
        """Know of no work and of no thread, as after a fork."""
        self._at_work: dict[object, tuple[float, Callable[[], str]]] = {}
        self._begun, self._idle, self._wake = 0, True, threading.Event()
        self._thread: threading.Thread | None = None

    @contextmanager
    def after(self, text: Callable[[], str]) -> Iterator[None]:
        """Report a text, made then, if what is done within takes LONG seconds."""
        key = object()
        self._begun += 1
        self._at_work[key] = time.monotonic() + LONG, text
        if self._idle:
            self._start()
        try:
            yield
        finally:
            self._at_work.pop(key, None)

    def _start(self) -> None:
        self._idle = False
        if self._thread is None:
            self._thread = threading.Thread(target=self._look, args=(self._wake,), name="spatialdyn-watch", daemon=True)
            self._thread.start()
        self._wake.set()

    def _look(self, wake: threading.Event) -> None:
        while True:
            wake.wait()
            wake.clear()
            begun, quiet = self._begun, 0
            while quiet < LOOKS:
                time.sleep(LONG / LOOKS)
                now = time.monotonic()
                for key, (due, text) in list(self._at_work.items()):
                    if due <= now and self._at_work.pop(key, None) is not None:
                        self.tell(text())
                quiet = 0 if self._at_work or self._begun != begun else quiet + 1
                begun = self._begun
            self._idle = True
            if self._at_work:  # begun in the meantime
                self._start()

    @contextmanager
    def work(self, what: str, more: Callable[[], str] = str, parts: bool = False) -> Iterator[None]:
        """Name what is done within, if it takes long and is no part of other such work.

        more   the end of the text
        parts  whether the text ends with the work that goes on within, if there is some, and so on
        """
        outer = _within.get()
        if outer is not None:
            known = outer[:]
            if not known or known[-1].parts:
                outer.append(Part(what, more, parts))
            try:
                yield
            finally:
                outer[:] = known
            return
        within: list[Part] = []

        def text() -> str:
            said = f"{what} takes more than {LONG:g} s"
            for part in within[-1:] if parts else []:
                return f"{said}{'' if part.what == what else f': {part.what}'}{part.more()}"
            return said + more()

        reset = _within.set(within)
        try:
            with self.after(text):
                yield
        finally:
            _within.reset(reset)

    def batch(self, count: int, done: Callable[[], int]) -> AbstractContextManager[None]:
        """Name work on the samples of a batch and how many are done; of one sample the work around it says all."""
        return nullcontext() if count == 1 else self.work(f"a batch of {count} samples", lambda: f": {done()} are done")

    @contextmanager
    def call(self, name: str) -> Iterator[None]:
        """Name a call that may take long, and the work within it that does.

        Without ``with`` it decorates the call's function, where no warning counts frames.
        """
        with self.work(name, parts=True):
            yield


watch = Watch()

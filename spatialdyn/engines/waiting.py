"""Work that takes long is named once, while it goes on, by a function that the calls hand in.

One thread looks at what is at work, a few times in LONG seconds and only while there is some: to begin and end costs a
microsecond. The work may be one call of LLVM; work within other work is not named.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

LONG = 3.0  # seconds
LOOKS = 8  # in LONG seconds; after as many at nothing the thread waits for work

_within: ContextVar[bool] = ContextVar("_within", default=False)


class Watch:
    """What reports long work.

    tell  a function of a text, called in another thread; none by default
    """

    def __init__(self) -> None:
        self.tell: Callable[[str], None] = lambda text: None
        self.forget()
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
    def work(self, what: str, more: Callable[[], str] = str) -> Iterator[None]:
        """Name what is done within, if it takes long and is no part of other such work; ``more`` ends the text."""
        if _within.get():
            yield
            return
        known = _within.set(True)
        try:
            with self.after(lambda: f"{what} takes more than {LONG:g} s{more()}"):
                yield
        finally:
            _within.reset(known)


watch = Watch()

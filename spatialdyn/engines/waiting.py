"""Work that takes long is named once, while it goes on, by a function that the calls hand in.

A thread waits for LONG seconds beside the work, which may be one call of LLVM; work within other work is not named.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

LONG = 3.0  # seconds

_within: ContextVar[bool] = ContextVar("_within", default=False)


class Watch:
    """What reports long work.

    tell  a function of a text, called in another thread; none by default
    """

    def __init__(self) -> None:
        self.tell: Callable[[str], None] = lambda text: None

    @contextmanager
    def after(self, text: Callable[[], str]) -> Iterator[None]:
        """Report a text, made then, if what is done within takes LONG seconds."""
        timer = threading.Timer(LONG, lambda: self.tell(text()))
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()

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

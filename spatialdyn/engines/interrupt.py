"""Run long work that handles no signal, such as LLVM's, on another thread, so that the main thread handles Ctrl-C.

Python handles signals in its main thread, between two of its own operations. LLVM compiles the ABA of a humanoid for
a second in one call.
"""

from __future__ import annotations

import atexit
import contextvars
import os
import threading
from collections.abc import Callable
from typing import Any

WAKE = 0.1  # seconds between two looks at signals, on systems where a signal does not end a wait
INTERRUPTED = 130  # exit status, 128 + number of the signal, as in shells


_at_work: set[_Worker] = set()


class _Worker(threading.Thread):
    """One call of a function, in the caller's context."""

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        super().__init__(name="spatialdyn-compile", daemon=True)
        self._call = contextvars.copy_context().run, function, *arguments
        self.done = threading.Event()
        self.result: Any = None
        self.error: BaseException | None = None

    def run(self) -> None:
        run, *rest = self._call
        try:
            self.result = run(*rest)
        except BaseException as error:
            self.error = error
        finally:
            del run, rest, self._call
            _at_work.discard(self)
            self.done.set()

    def finish(self) -> None:
        """Wait for the end, at the end of the process: it must not take LLVM away from a thread that compiles."""
        try:
            while not self.done.wait(WAKE):
                pass
        except KeyboardInterrupt:
            os._exit(INTERRUPTED)


def leave(status: int) -> None:
    """End the process now, without waiting for other threads; the caller must have flushed its files."""
    os._exit(status)


def interruptible(function: Callable[..., Any], *arguments: Any) -> Any:
    """``function(*arguments)``, on another thread if called in the main one, which raises KeyboardInterrupt at once.

    The function then goes on to its end, as what it has locked would stay so; the process waits for it when it exits,
    until another Ctrl-C. A second call waits where both need the same lock.
    """
    if threading.current_thread() is not threading.main_thread():
        return function(*arguments)
    worker = _Worker(function, arguments)
    _at_work.add(worker)
    atexit.register(worker.finish)
    worker.start()
    while not worker.done.wait(WAKE):
        pass
    atexit.unregister(worker.finish)
    if worker.error is not None:
        try:
            raise worker.error
        finally:
            worker.error = None  # its traceback holds this frame
    return worker.result


def _forked() -> None:
    """In a forked child: the threads are gone, and its end waits for none of them."""
    while _at_work:
        atexit.unregister(_at_work.pop().finish)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)

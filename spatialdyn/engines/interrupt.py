"""Run long work on another thread, so that the main thread can handle Ctrl-C meanwhile.

Python handles signals in its main thread, between two Python operations. One call of LLVM, which compiles the ABA of a
humanoid, takes a second and handles no signal.
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
        """Wait for the thread when the process ends, which would otherwise unload LLVM while the thread compiles."""
        try:
            while not self.done.wait(WAKE):
                pass
        except KeyboardInterrupt:
            os._exit(INTERRUPTED)


def leave(status: int) -> None:
    """End the process now, without waiting for other threads; the caller must have flushed its files."""
    os._exit(status)


def interruptible(function: Callable[..., Any], *arguments: Any) -> Any:
    """``function(*arguments)``; a call in the main thread runs on another thread, and Ctrl-C raises at once.

    After KeyboardInterrupt the function runs on to its end, since the locks it holds would otherwise stay locked. The
    process waits for it at exit, until another Ctrl-C. A second call waits if both calls need the same lock.
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
    """In a forked child: forget the threads, which do not exist there, so that exit does not wait for them."""
    while _at_work:
        atexit.unregister(_at_work.pop().finish)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)

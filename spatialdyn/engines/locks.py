"""The locks of the library and their treatment in a fork: the only module that makes locks.

A child of ``os.fork`` has one thread and a copy of each lock: a lock that another thread held stays locked for ever.
So the forking thread takes all locks before the fork, those of Numba and llvmlite too, and both processes release them
after it. A fork waits until a compiling thread is done, because the child cannot use an LLVM that was stopped midway.
The forking thread holds no lock while it waits for one, so there is no deadlock with threads that take several locks.
"""

from __future__ import annotations

import functools
import os
import sys
import threading
from collections.abc import Callable
from typing import Any
from weakref import WeakSet

from ..algebra import scalars

PACKAGE = __name__.partition(".")[0]

_making = threading.Lock()  # held while a lock is made, and during a fork
_made: WeakSet[Any] = WeakSet([scalars.lock])
_held: list[Any] = []  # locks held by the thread that forks
_forking: list[int] = []  # identifier of that thread, during a fork


def new(kind: Callable[[], Any] = threading.RLock) -> Any:
    """A new lock, which is never locked in a forked child."""
    made = kind()
    with _making:
        _made.add(made)
    return made


def foreign() -> list[Any]:
    """The locks of Numba's compiler and of llvmlite, if they are imported."""
    owners = (
        getattr(sys.modules.get("numba.core.compiler_lock"), "global_compiler_lock", None),
        getattr(getattr(sys.modules.get("llvmlite.binding.ffi"), "lib", None), "_lock", None),
    )
    found = (getattr(owner, "_lock", None) for owner in owners)
    return [lock for lock in found if hasattr(lock, "acquire")]


def come_first() -> None:
    """Make a fork take the library's locks before those of modules imported since the last call.

    Hooks run in the reverse order of their registration. If a fork took the lock of ``logging`` first, it would wait
    for a thread that compiles, and that thread, which may import a module that makes a logger, would wait for the fork.
    """
    if hasattr(os, "register_at_fork"):  # not on Windows
        os.register_at_fork(before=_before)


def _before() -> None:
    if threading.get_ident() in _forking:  # the hook was registered more than once
        return
    busy = None
    while True:
        _making.acquire()
        first, busy = busy, None
        if first is not None:
            _held.append(first)  # the lock that this thread waited for
        for lock in (*_made, *foreign()):
            if lock is not first and not lock.acquire(blocking=False):
                busy = lock
                break
            if lock is not first:
                _held.append(lock)
        if busy is None:
            _forking.append(threading.get_ident())
            return
        _release()
        busy.acquire()


def _release() -> None:
    _forking.clear()
    while _held:
        _held.pop().release()
    if _making.locked():
        _making.release()


def _in_child() -> None:
    """Release the locks, and make new ones for ``functools.cached_property``, which has locks up to Python 3.11."""
    _release()
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] == PACKAGE:
            for kind in [x for x in vars(module).values() if isinstance(x, type)]:
                for x in vars(kind).values():
                    if isinstance(x, functools.cached_property) and hasattr(x, "lock"):
                        x.lock = threading.RLock()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(before=_before, after_in_parent=_release, after_in_child=_in_child)

"""The locks of the library and their treatment in a fork: the only module that makes and owns them.

A child of ``os.fork`` has one thread, and a copy of each lock as it was: one that another thread held is locked for
ever. So before a fork all of them are taken, Numba's and llvmlite's too, and after it both processes release them; a
thread that compiles is waited for, as a child cannot go on with an LLVM that was stopped midway. A thread that forks
waits for one lock at a time and holds none meanwhile: no order in which others take several can meet it in a deadlock.
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

_making = threading.Lock()  # while a lock is made, and from before a fork until after it
_made: WeakSet[Any] = WeakSet([scalars.lock])
_held: list[Any] = []  # by the thread that forks
_forking: list[int] = []  # that thread, from before a fork until after it


def new(kind: Callable[[], Any] = threading.RLock) -> Any:
    """A lock, which no fork copies locked."""
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

    Hooks run in the reverse order of their registration. With ``logging``'s lock taken first, a fork would wait for a
    thread that compiles, and that thread, which may import what makes a logger, for the fork.
    """
    if hasattr(os, "register_at_fork"):  # not on Windows
        os.register_at_fork(before=_before)


def _before() -> None:
    if threading.get_ident() in _forking:  # registered again
        return
    busy = None
    while True:
        _making.acquire()
        first, busy = busy, None
        if first is not None:
            _held.append(first)  # that was waited for
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
    """Release the locks; those of ``functools.cached_property``, in Python up to 3.11, are made anew."""
    _release()
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] == PACKAGE:
            for kind in [x for x in vars(module).values() if isinstance(x, type)]:
                for x in vars(kind).values():
                    if isinstance(x, functools.cached_property) and hasattr(x, "lock"):
                        x.lock = threading.RLock()


if hasattr(os, "register_at_fork"):  # not on Windows
    os.register_at_fork(before=_before, after_in_parent=_release, after_in_child=_in_child)

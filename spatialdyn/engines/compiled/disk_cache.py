"""Compiled code on disk, so that a second process starts at once.

A file is named by a digest of all that its code depends on, holds a checksum of that name and its content, and is
written in one move; one that does not read back whole, or is another's, is as good as none. Nothing that goes wrong
here is worth an error: what cannot be kept is compiled again. The MOST files last used are kept.

What is read here is run, and a checksum is no signature. So the folder and each file are used only if their owner is
the effective user or root, neither their group nor others may write to them, and they are no links; else code is
compiled in memory, with one warning. The folder is made for its owner alone (0700), files too (0600). What is checked
is what was opened, and names are looked up in the open folder, so that nothing can be exchanged in between.

Defended: other users of the machine, also where they may write to a folder above (a shared /tmp) and made the cache's
own folder, a file or a link in its place first. The folders above may be links, which is how people move ~/.cache.
Not defended: what runs as the same user or as root; file systems that do not tell the owner, and access lists that a
mode does not show. On Windows links are refused, but neither owners nor access lists are looked at: the folder there is
the user's own, unless a variable names another.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from numba import config

VARIABLE = "SPATIALDYN_CACHE_DIR"  # the folder itself, or none if it is empty; Numba's variable is for a folder of it
MOST = 2048  # of each kind; some 0.1 MB each, and one version of the package makes up to 300 kernels
PROGRAM, KERNEL = ".lanes", ".kernel"
PART = ".part"  # what is being written

OWNED = hasattr(os, "geteuid")  # whether files have an owner and a mode that say who may write
BY_FOLDER = {
    os.open,
    os.stat,
    os.unlink,
    os.rename,
} <= os.supports_dir_fd  # if names can be looked up in open folders
_SURE = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NONBLOCK", 0)
_BINARY = getattr(os, "O_BINARY", 0)
_REPARSED = (0xA000000C, 0xA0000003)  # Windows' links and junctions

_lock = threading.Lock()
_once: set[tuple[str, Path]] = set()  # what was done to a folder and is not done again


class _UnsafeError(Exception):
    """A path that another user may have put there, and why."""


def folder() -> Path | None:
    """Where they are: what ``SPATIALDYN_CACHE_DIR`` names, Numba's cache folder if one is set, else the user's.

    None if that variable is empty, or the user has no home.
    """
    own = os.environ.get(VARIABLE)
    if own is not None:
        return Path(own) if own else None
    chosen = getattr(config, "CACHE_DIR", "")
    if chosen:
        return Path(chosen) / "spatialdyn"
    try:
        if sys.platform == "win32":
            base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
        elif sys.platform == "darwin":
            base = Path.home() / "Library" / "Caches"
        else:
            base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:
        return None
    return base / "spatialdyn"


def read(digest: str, kind: str = PROGRAM) -> bytes | None:
    """What was written under a digest; None if nothing was, it is damaged, or not sure to be the user's.

    Warns once of a folder that is not sure to be.
    """
    place = folder()
    if place is None:
        return None
    try:
        with _opened(place) as files:
            handle = files.open(digest + kind, os.O_RDONLY)
            with _closing(handle, "rb") as file:
                if not stat.S_ISREG(os.fstat(handle).st_mode):
                    return None
                whole = file.read()
                checksum, payload = whole[:32], whole[32:]
                if _checksum(digest, payload) != checksum:
                    return None
                with suppress(OSError):
                    os.utime(handle if os.utime in os.supports_fd else place / (digest + kind))
    except _UnsafeError as error:
        _warn(place, str(error))
        return None
    except OSError:
        return None
    return bytes(payload)


def write(digest: str, payload: bytes, kind: str = PROGRAM) -> None:
    """Keep it; a folder that cannot be written to, or is not sure to be the user's, keeps nothing.

    Warns once of a folder that is not sure to be. A file that is not stays as it is.
    """
    place = folder()
    if place is None:
        return
    try:
        _make(place)
        with _opened(place) as files:
            name, part = digest + kind, os.urandom(8).hex() + PART
            files.check(name)
            try:
                handle = files.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
                with _closing(handle, "wb") as file:
                    file.write(_checksum(digest, payload) + payload)
                files.replace(part, name)
            except (OSError, _UnsafeError):
                with suppress(OSError):
                    files.unlink(part)
                raise
            if _first("prune", place):
                _prune(files)
    except _UnsafeError as error:
        _warn(place, str(error))
    except OSError:
        pass


# --- the folder -------------------------------------------------------------------------------------------


class _Files:
    """What is in an open folder."""

    def __init__(self, place: Path, handle: int | None) -> None:
        self._place, self._handle = place, handle
        self._at: dict[str, Any] = {} if handle is None else {"dir_fd": handle}

    def _path(self, name: str) -> str:
        return name if self._at else str(self._place / name)

    def open(self, name: str, flags: int) -> int:
        """A descriptor of a file that is sure to be the user's. Raises _UnsafeError, OSError."""
        return _open(self._path(name), f'file "{self._place / name}"', flags | _BINARY, **self._at)

    def check(self, name: str) -> None:
        """Raise _UnsafeError if there is something of that name that is not sure to be the user's."""
        with suppress(FileNotFoundError):
            _check(self.state(name), f'file "{self._place / name}"')

    def state(self, name: str) -> os.stat_result:
        return os.stat(self._path(name), follow_symlinks=False, **self._at)

    def replace(self, old: str, new: str) -> None:
        at = {} if self._handle is None else {"src_dir_fd": self._handle, "dst_dir_fd": self._handle}
        os.replace(self._path(old), self._path(new), **at)

    def unlink(self, name: str) -> None:
        os.unlink(self._path(name), **self._at)

    def names(self) -> list[str]:
        return os.listdir(self._place if self._handle is None else self._handle)


def _make(place: Path) -> None:
    """Make a folder, and those above it that are missing, for the user alone."""
    try:
        place.mkdir(0o700)
    except FileExistsError:
        pass
    except FileNotFoundError:
        if place.parent == place:
            raise
        _make(place.parent)
        place.mkdir(0o700, exist_ok=True)


@contextmanager
def _opened(place: Path) -> Iterator[_Files]:
    """The folder, if it is sure to be the user's. Raises _UnsafeError, OSError."""
    what = f'folder "{place}"'
    if not BY_FOLDER:
        _check(os.stat(place, follow_symlinks=False), what)
        yield _Files(place, None)
        return
    handle = _open(str(place), what, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
    try:
        yield _Files(place, handle)
    finally:
        os.close(handle)


def _open(path: str, what: str, flags: int, **at: Any) -> int:
    """A descriptor of what is sure to be the user's. Raises _UnsafeError, OSError."""
    if not hasattr(os, "O_NOFOLLOW") and not flags & os.O_CREAT:
        _check(os.stat(path, follow_symlinks=False, **at), what)
    try:
        handle = os.open(path, flags | _SURE, 0o600, **at)
    except OSError:
        _check(os.stat(path, follow_symlinks=False, **at), what)  # a link says so
        raise
    try:
        _check(os.fstat(handle), what)
    except _UnsafeError:
        os.close(handle)
        raise
    return handle


def _check(state: os.stat_result, what: str) -> None:
    """Raise _UnsafeError if another user may have put there what has this state."""
    if stat.S_ISLNK(state.st_mode) or getattr(state, "st_reparse_tag", 0) in _REPARSED:
        raise _UnsafeError(f"{what} is a link, expected none; remove it")
    if OWNED and state.st_uid not in (os.geteuid(), 0):
        raise _UnsafeError(f"{what} belongs to user {state.st_uid}, expected {os.geteuid()} or root; remove it")
    if OWNED and state.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        mode = f"{stat.S_IMODE(state.st_mode):04o}"
        raise _UnsafeError(f"{what} has mode {mode}, expected one that only its owner may write; chmod go-w")


@contextmanager
def _closing(handle: int, mode: str) -> Iterator[Any]:
    """The file of a descriptor, closed in the end."""
    try:
        file = os.fdopen(handle, mode)
    except OSError:
        os.close(handle)
        raise
    with file:
        yield file


def _first(what: str, place: Path) -> bool:
    """Whether this is the first time in this process that something is done to a folder."""
    with _lock:
        known = (what, place) in _once
        _once.add((what, place))
        return not known


def _warn(place: Path, fault: str) -> None:
    if _first("warn", place):
        text = f"cache {fault}, or set {VARIABLE} to a folder of your own. Until then code is compiled anew"
        warnings.warn(text, RuntimeWarning, stacklevel=3)


def _prune(files: _Files) -> None:
    """Leave the MOST files of each kind that were used last."""
    for kind in (PROGRAM, KERNEL):
        found = []
        for name in files.names():
            with suppress(OSError):  # another process prunes too
                if name.endswith(kind):
                    found.append((files.state(name).st_mtime, name))
        for _, name in sorted(found)[:-MOST]:
            with suppress(OSError):
                files.unlink(name)


def _checksum(digest: str, payload: bytes) -> bytes:
    return hashlib.sha256(digest.encode() + payload).digest()

"""Disk cache of compiled code, so that a second process starts at once.

The name of a file is a digest of all that its code depends on. A file holds a checksum of its name and content and is
written atomically; a damaged file, or one under the name of another, counts as missing. No failure here is an error:
code that cannot be cached is compiled again. The MOST_FILES last used files of each kind are kept.

The process runs the code that it reads here, and a checksum is no signature. So the folder and each file are used only
if the owner is the effective user or root, neither group nor others may write to them, and they are no links. Otherwise
code is compiled in memory, with one warning. The folder is made with mode 0700, files with 0600. Checks are made on the
open descriptor, and names are looked up in the open folder, so that no file can be exchanged in between.

Protects against: other users of the machine, also if they may write to a folder above (a shared /tmp) and have first
made the cache's own folder, or a file or link in its place. The folders above may be links, since users move ~/.cache
that way. Does not protect against: processes of the same user or of root; file systems without owners; access lists
that a mode does not show. On Windows links are refused, but neither owners nor access lists are checked: the folder
there is the user's own, unless a variable names another folder.
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

from .. import locks
from .numba_settings import setting

VARIABLE = "SPATIALDYN_CACHE_DIR"  # names the folder itself; no cache if empty. Numba's variable names the folder above
MOST_FILES = 4096  # of each kind; a file has 0.1 MB or less, and the tests of one version make 2100 for programs
KINDS = PROGRAM, NUMBERS, KERNEL, INLINED = ".lanes", ".numbers", ".kernel", ".inlined"
PART = ".part"  # suffix of a file that is being written

OWNED = hasattr(os, "geteuid")  # whether files have an owner and a mode that say who may write
BY_FOLDER = {
    os.open,
    os.stat,
    os.unlink,
    os.rename,
} <= os.supports_dir_fd  # whether names can be looked up in open folders
_SURE = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NONBLOCK", 0)
_BINARY = getattr(os, "O_BINARY", 0)
_REPARSED = (0xA000000C, 0xA0000003)  # Windows' links and junctions

_lock = locks.new(threading.Lock)
_done: set[tuple[str, Path]] = set()  # (action, folder) done in this process


class _UnsafeError(Exception):
    """A path that another user may control, with the reason."""


def kept() -> str:
    """The place where compiled code goes, in words for the message about compiling."""
    if folder() is None:
        return f"; set {VARIABLE} to a folder to keep it for later processes"
    return "; it is kept in the cache for later processes"


def folder() -> Path | None:
    """The cache's folder: ``SPATIALDYN_CACHE_DIR``, else a folder in Numba's cache folder if set, else the user's.

    None if that variable is empty, or the user has no home folder.
    """
    own = os.environ.get(VARIABLE)
    if own is not None:
        return Path(own) if own else None
    chosen = setting("CACHE_DIR", "")
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
    """The payload written under a digest; None if the file is missing, damaged or unsafe.

    Warns once if the folder is unsafe.
    """
    place = folder()
    if place is None:
        return None
    try:
        with _open_folder(place) as files:
            handle = files.open(digest + kind, os.O_RDONLY)
            with _file_of(handle, "rb") as file:
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
    """Write a payload under a digest; does nothing if the folder cannot be written to or is unsafe.

    Warns once if the folder is unsafe. An unsafe file of that name is left as it is.
    """
    place = folder()
    if place is None:
        return
    try:
        _make(place)
        with _open_folder(place) as files:
            name, part = digest + kind, os.urandom(8).hex() + PART
            files.check(name)
            try:
                handle = files.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
                with _file_of(handle, "wb") as file:
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
    """The files of an open folder."""

    def __init__(self, place: Path, handle: int | None) -> None:
        self._place, self._handle = place, handle
        self._at: dict[str, Any] = {} if handle is None else {"dir_fd": handle}

    def _path(self, name: str) -> str:
        return name if self._at else str(self._place / name)

    def open(self, name: str, flags: int) -> int:
        """The descriptor of a file, opened if it is safe. Raises _UnsafeError, OSError."""
        return _open(self._path(name), f'file "{self._place / name}"', flags | _BINARY, **self._at)

    def check(self, name: str) -> None:
        """Raise _UnsafeError if a file of that name is unsafe."""
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
    """Make a folder, and missing folders above it, with mode 0700."""
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
def _open_folder(place: Path) -> Iterator[_Files]:
    """Open a folder if it is safe. Raises _UnsafeError, OSError."""
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
    """The descriptor of a file or folder, opened if it is safe. Raises _UnsafeError, OSError."""
    if not hasattr(os, "O_NOFOLLOW") and not flags & os.O_CREAT:
        _check(os.stat(path, follow_symlinks=False, **at), what)
    try:
        handle = os.open(path, flags | _SURE, 0o600, **at)
    except OSError:
        _check(os.stat(path, follow_symlinks=False, **at), what)  # raises for a link
        raise
    try:
        _check(os.fstat(handle), what)
    except _UnsafeError:
        os.close(handle)
        raise
    return handle


def _check(state: os.stat_result, what: str) -> None:
    """Raise _UnsafeError for the state of a link, of another user's file, or of a file that others may write."""
    if stat.S_ISLNK(state.st_mode) or getattr(state, "st_reparse_tag", 0) in _REPARSED:
        raise _UnsafeError(f"{what} is a link, expected none; remove it")
    if OWNED and state.st_uid not in (os.geteuid(), 0):
        raise _UnsafeError(f"{what} belongs to user {state.st_uid}, expected {os.geteuid()} or root; remove it")
    if OWNED and state.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        mode = f"{stat.S_IMODE(state.st_mode):04o}"
        raise _UnsafeError(f"{what} has mode {mode}, expected one that only its owner may write; chmod go-w")


@contextmanager
def _file_of(handle: int, mode: str) -> Iterator[Any]:
    """The file of a descriptor, closed at exit."""
    try:
        file = os.fdopen(handle, mode)
    except OSError:
        os.close(handle)
        raise
    with file:
        yield file


def _first(what: str, place: Path) -> bool:
    """Whether this is the first call in this process with that action and folder."""
    with _lock:
        known = (what, place) in _done
        _done.add((what, place))
        return not known


def _warn(place: Path, fault: str) -> None:
    if _first("warn", place):
        text = f"cache {fault}, or set {VARIABLE} to a folder of your own. Until then code is compiled anew"
        warnings.warn(text, RuntimeWarning, stacklevel=3)


def _prune(files: _Files) -> None:
    """Remove all but the MOST_FILES last used files of each kind."""
    for kind in KINDS:
        found = []
        for name in files.names():
            with suppress(OSError):  # another process may have removed it
                if name.endswith(kind):
                    found.append((files.state(name).st_mtime, name))
        for _, name in sorted(found)[:-MOST_FILES]:
            with suppress(OSError):
                files.unlink(name)


def _checksum(digest: str, payload: bytes) -> bytes:
    return hashlib.sha256(digest.encode() + payload).digest()

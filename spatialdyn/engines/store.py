"""Compiled code on disk, so that a second process starts at once.

A file is named by a digest of all that its code depends on, holds a checksum of that name and its content, and is
written in one move; one that does not read back whole, or is another's, is as good as none. Nothing that goes wrong
here is worth an error: what cannot be kept is compiled again. The MOST files last used are kept.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

from numba import config

MOST = 2048  # of each kind; some 0.1 MB each, and one version of the package makes up to 300 kernels
PROGRAM, KERNEL = ".lanes", ".kernel"
PART = ".part"  # what is being written


def folder() -> Path:
    """Where they are: Numba's cache folder if one is set, else the user's."""
    chosen = getattr(config, "CACHE_DIR", "")
    if chosen:
        return Path(chosen) / "spatialdyn"
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "spatialdyn"


def read(digest: str, kind: str = PROGRAM) -> bytes | None:
    """What was written under a digest; None if nothing was, or it is damaged."""
    try:
        path = folder() / (digest + kind)
        whole = path.read_bytes()
    except (OSError, RuntimeError):  # no home to be found
        return None
    checksum, payload = whole[:32], whole[32:]
    if _checksum(digest, payload) != checksum:
        return None
    with suppress(OSError):
        os.utime(path)
    return payload


def write(digest: str, payload: bytes, kind: str = PROGRAM) -> None:
    """Keep it; a folder that cannot be written to keeps nothing."""
    part = None
    try:
        place = folder()
        place.mkdir(parents=True, exist_ok=True)
        handle, part = tempfile.mkstemp(PART, dir=place)
        with os.fdopen(handle, "wb") as file:
            file.write(_checksum(digest, payload) + payload)
        os.replace(part, place / (digest + kind))
        for path in sorted(place.glob("*" + kind), key=lambda p: p.stat().st_mtime)[:-MOST]:
            path.unlink(missing_ok=True)
    except (OSError, RuntimeError):
        if part is not None:
            with suppress(OSError):
                os.unlink(part)


def _checksum(digest: str, payload: bytes) -> bytes:
    return hashlib.sha256(digest.encode() + payload).digest()

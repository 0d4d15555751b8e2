"""Compiled programs on disk, so that a second process starts at once.

A file is named by a digest of all that its code depends on, holds a checksum, and is written in one move; one
that does not read back whole is as good as none. The newest MOST files are kept.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from pathlib import Path

from numba import config

MOST = 512
SUFFIX = ".lanes"


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


def read(digest: str) -> bytes | None:
    """What was written under a digest; None if nothing was, or it is damaged."""
    try:
        whole = (folder() / (digest + SUFFIX)).read_bytes()
    except OSError:
        return None
    checksum, payload = whole[:32], whole[32:]
    return payload if hashlib.sha256(payload).digest() == checksum else None


def write(digest: str, payload: bytes) -> None:
    """Keep it; a folder that cannot be written to keeps nothing."""
    place = folder()
    try:
        place.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=place)
        with os.fdopen(handle, "wb") as file:
            file.write(hashlib.sha256(payload).digest() + payload)
        os.replace(name, place / (digest + SUFFIX))
        old = sorted(place.glob("*" + SUFFIX), key=lambda p: p.stat().st_mtime)[:-MOST]
        for path in old:
            path.unlink(missing_ok=True)
    except OSError:
        return

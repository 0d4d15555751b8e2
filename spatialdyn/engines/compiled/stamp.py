"""The stamp of the sources of compiled code: code with another stamp is not read from disk.

Cached code is named by a Spec's name and the stamp if these determine the code; otherwise it is named by its content,
or not cached.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from typing import Any

from ...recursions.spec import Spec

COMPILED = (
    "algebra", "bodies", "recursions", "engines", "constraints", "simulation", "compat/native"
)  # fmt: skip  # the packages that hold compiled code: an edit elsewhere leaves the cache valid


def package_folder() -> Path:
    """The folder of the whole package, wherever this module is in it: a stamp of a subfolder would miss edits."""
    return Path(str(sys.modules[__name__.partition(".")[0]].__file__)).resolve().parent


def _stamp() -> str:
    package = package_folder()
    digest = hashlib.sha256()
    for room in COMPILED:
        for source in sorted((package / room).rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


STAMP = _stamp()
_ROOMS = tuple(f"{__name__.partition('.')[0]}.{room.replace('/', '.')}." for room in COMPILED)


def covers(source: Any) -> bool:
    """Whether the stamp covers the source of a function or class."""
    return str(getattr(source, "__module__", "")).startswith(_ROOMS)


def names(spec: Spec) -> bool:
    """Whether the name of a Spec and the stamp determine the code of its recursion."""
    return spec.stamped and covers(spec.recursion)

"""The stamp of the sources that compiled code is made of: no code is read from the disk under another."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

COMPILED = (
    "algebra", "bodies", "recursions", "engines", "constraints", "simulation", "compat/native"
)  # fmt: skip  # the packages that hold compiled code: an edit elsewhere leaves the cache valid


def package_folder() -> Path:
    """The folder of the package, wherever in it this module is: a stamp of one folder would miss edits elsewhere."""
    return Path(str(sys.modules[__name__.partition(".")[0]].__file__)).resolve().parent


def _stamp() -> str:
    package = package_folder()
    digest = hashlib.sha256()
    for room in COMPILED:
        for source in sorted((package / room).rglob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


STAMP = _stamp()

"""Names of files to write: the ending must name the format of the file; any other ending is refused."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from ..errors import SpatialDynError, literal


def check_ending(name: str, path: Any, endings: Sequence[str]) -> Any:
    """The argument ``name``: a path that ends in one of the endings, in upper or lower case, or an open file.

    Raises SpatialDynError for any other ending, and for a value that is no path.
    """
    if hasattr(path, "write"):
        return path
    shown = path.__fspath__() if hasattr(path, "__fspath__") else path
    if not isinstance(shown, str):
        raise SpatialDynError(f"{name} is {literal(path)}, expected the name of a file")
    stem, dot, ending = re.split(r"[/\\]", shown)[-1].rpartition(".")
    if not stem or dot + ending.lower() not in endings:
        known = f"one of {', '.join(endings)}" if len(endings) > 2 else endings[0]
        raise SpatialDynError(f"{name} is {literal(shown)}, expected a name that ends in {known}")
    return path

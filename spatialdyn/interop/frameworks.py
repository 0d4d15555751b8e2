"""Frameworks of others, imported when a bridge to one is used."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ..errors import SpatialDynError, pip_install


def framework(name: str) -> Any:
    """A package, imported. Raises SpatialDynError with the line that installs it where it is missing."""
    try:
        return import_module(name)
    except ImportError as error:
        raise SpatialDynError(f"{name} is not installed; {pip_install(name)}") from error

"""Other frameworks, each imported when its bridge is used."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ..errors import SpatialDynError, pip_install


def framework(name: str) -> Any:
    """Import a package. Raises SpatialDynError with the command that installs it if it is missing."""
    try:
        return import_module(name)
    except ImportError as error:
        raise SpatialDynError(f"{name} is not installed; {pip_install(name)}") from error

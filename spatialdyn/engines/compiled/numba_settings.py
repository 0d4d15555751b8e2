"""Numba's settings, and whether Numba made a function, without importing Numba, which takes time."""

from __future__ import annotations

import os
import sys
from typing import Any, TypeVar

Value = TypeVar("Value", int, str)
CONFIG_FILE = ".numba_config.yaml"  # in the working directory


def setting(name: str, default: Value) -> Value:
    """The value of ``numba.config.NAME``: from the environment variable ``NUMBA_NAME`` until Numba is imported.

    If Numba's own file of settings exists, Numba is imported to read it. A value that is not of the default's type is
    replaced by the default; Numba warns of it.
    """
    if "numba" not in sys.modules and os.path.isfile(CONFIG_FILE):
        import numba  # noqa: F401
    config = getattr(sys.modules.get("numba"), "config", None)
    if config is not None:
        found: Value = getattr(config, name, default)
        return found
    try:
        return type(default)(os.environ.get(f"NUMBA_{name}", default))
    except ValueError:
        return default


PLAIN = bool(setting("DISABLE_JIT", 0))  # NUMBA_DISABLE_JIT: the recursions run in plain Python


def is_jitted(function: Any) -> bool:
    """Whether Numba made a function."""
    if "numba" not in sys.modules:
        return False
    from numba.extending import is_jitted

    return bool(is_jitted(function))

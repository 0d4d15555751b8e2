"""Numba's compiled functions in our disk cache, in place of Numba's own.

Numba's cache does not check its files: a truncated index raises, a flipped bit runs, two processes that write at once
may save one's code under the other's name, and a full disk or a read-only folder is an error. Here a function is one
file of ``disk_cache``, named by a digest of all that its code depends on.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
from collections.abc import Callable
from typing import Any

import llvmlite
import numba
from numba.core import compiler, serialize
from numba.core.caching import _Cache
from numba.core.runtime import rtsys  # type: ignore[attr-defined]

from . import disk_cache


class NumbaCache(_Cache):
    """The cache of one function, whose closure holds text only."""

    def __init__(self, function: Callable[..., Any]) -> None:
        """Name the function by its code and its closure, which must hold all else that the code depends on."""
        code, cells = function.__code__, function.__closure__ or ()
        text = (code.co_code, code.co_consts, code.co_names, [cell.cell_contents for cell in cells])
        versions = (numba.__version__, llvmlite.__version__, sys.version)
        self._function = repr((function.__module__, function.__qualname__, text, versions))
        self._enabled = True

    @property
    def cache_path(self) -> str:
        """The folder of the disk cache, empty if there is none."""
        return str(disk_cache.folder() or "")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The function as compiled for a signature; None if it is not in the cache."""
        payload = (
            disk_cache.read(self._digest(sig, target_context.codegen()), disk_cache.KERNEL) if self._enabled else None
        )
        if payload is None:
            return None
        rtsys.initialize(target_context)  # all that code links to; Numba's registries, 0.2 s, serve the compiler alone
        rebuild: Any = compiler.CompileResult._rebuild
        return rebuild(target_context, *pickle.loads(payload))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write compiled code, unless it holds addresses of this process."""
        if self._enabled and not data.lifted and not data.library.has_dynamic_globals:
            dumps: Any = serialize.dumps
            disk_cache.write(self._digest(sig, data.codegen), dumps(data._reduce()), disk_cache.KERNEL)

    def _digest(self, sig: Any, codegen: Any) -> str:
        return hashlib.sha256(f"{self._function} {sig} {codegen.magic_tuple()}".encode()).hexdigest()

    def enable(self) -> None:
        """Read and write from now on."""
        self._enabled = True

    def disable(self) -> None:
        """Neither read nor write from now on."""
        self._enabled = False

    def flush(self) -> None:
        """Nothing: no file is ever stale."""

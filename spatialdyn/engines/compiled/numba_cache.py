"""Numba's compiled functions in this library's disk cache, in place of Numba's own cache.

Numba's cache does not check its files: a truncated index raises, code with a flipped bit runs, two processes that write
at once may save the code of one under the name of the other, and a full disk or a read-only folder is an error. Here
each function is one file of ``disk_cache``, named by a digest of all that its code depends on.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
from collections.abc import Callable
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types
from numba.core import compiler, serialize
from numba.core.caching import _Cache
from numba.core.runtime import rtsys  # type: ignore[attr-defined]

from . import disk_cache
from .numba_settings import setting
from .stamp import covers


def settings() -> tuple[Any, ...]:
    """What compiled code depends on besides its sources: versions, and Numba's settings of optimization and checks."""
    names = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "DEBUGINFO_DEFAULT", "LLVM_REFPRUNE_FLAGS")
    chosen = [str(setting(name, "")) for name in names]
    return numba.__version__, llvmlite.__version__, np.__version__, sys.version, *chosen


class NumbaCache(_Cache):
    """The cache of one function."""

    def __init__(self, function: Callable[..., Any], key: str = "") -> None:
        """Name the function by its code and closure, or by a key: one of them must hold all that the code depends on.

        A closure may hold text only.
        """
        code, cells = function.__code__, function.__closure__ or ()
        text: Any = key or (code.co_code, code.co_consts, code.co_names, [cell.cell_contents for cell in cells])
        self._function = repr((function.__module__, function.__qualname__, text, settings()))
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
        rtsys.initialize(target_context)  # all that the code links to; only the compiler needs Numba's registries
        rebuild: Any = compiler.CompileResult._rebuild
        return rebuild(target_context, *pickle.loads(payload))

    def is_stored(self, sig: Any, target_context: Any) -> bool:
        """Whether the function is in the cache, as compiled for a signature."""
        if not self._enabled:
            return False
        return disk_cache.read(self._digest(sig, target_context.codegen()), disk_cache.KERNEL) is not None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write compiled code, unless it holds addresses of this process."""
        if self._enabled and not data.lifted and not data.library.has_dynamic_globals:
            dumps: Any = serialize.dumps
            disk_cache.write(self._digest(sig, data.codegen), dumps(data._reduce()), disk_cache.KERNEL)

    def _digest(self, sig: Any, codegen: Any) -> str:
        return hashlib.sha256(f"{self._function} {sig} {codegen.magic_tuple()}".encode()).hexdigest()

    def enable(self) -> None:
        """Use the cache from now on."""
        self._enabled = True

    def disable(self) -> None:
        """Do not use the cache from now on."""
        self._enabled = False

    def flush(self) -> None:
        """Do nothing: no file is ever stale."""


class InlinedCache:
    """The cache of the LLVM code of the package's ``inline`` functions, from which kernels are linked."""

    def __init__(self, stamp: str) -> None:
        """Keep the functions that the stamp covers; values that a process sets in a module are not noticed."""
        self._stamp = stamp

    def digest(self, function: Callable[..., Any], state: Any) -> str:
        """The name of a function's file; "" if the stamp, its name and its types do not determine its code."""
        if not covers(function) or "<" in function.__qualname__ or not all(map(_is_value, state.args)):
            return ""
        target = (*settings(), state.targetctx.codegen().magic_tuple())
        name = (function.__module__, function.__qualname__, state.args, state.return_type, state.flags)
        return hashlib.sha256(f"{self._stamp} {target} {name}".encode()).hexdigest()

    def read(self, digest: str) -> Any:
        """The object written under a name, or None."""
        payload = disk_cache.read(digest, disk_cache.INLINED)
        return payload and pickle.loads(payload)

    def write(self, digest: str, content: Any) -> None:
        """Write a picklable object under a name."""
        disk_cache.write(digest, pickle.dumps(content), disk_cache.INLINED)


def _is_value(kind: Any) -> bool:
    """Whether a type's name determines the type; the name of a function's type does not."""
    if isinstance(kind, types.BaseTuple):
        return all(map(_is_value, kind))  # type: ignore[call-overload]
    if isinstance(kind, types.Type) and covers(type(kind)):  # lanes and their masks
        return True
    return isinstance(kind, (types.Number, types.Boolean, types.Array, types.Record, types.NoneType, types.Omitted))

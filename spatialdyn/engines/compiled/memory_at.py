"""Memory at an address, in compiled code: words, and arrays of numbers or indices."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, types  # type: ignore[attr-defined]
from numba.extending import intrinsic

from ...algebra.scalars import inline
from . import jit

_WORD = ir.IntType(64)
_pointer = jit.pointer


def _word_at(typing_context: Any, base: Any, k: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(builder.gep(builder.inttoptr(arguments[0], _WORD.as_pointer()), [arguments[1]]))

    return types.int64(types.intp, types.intp), generate


word: Any = intrinsic(_word_at)  # (address, k): word k behind an address


@inline
def at(address: int, shape: tuple[int, ...]) -> Any:
    """Array of float64 at an address, in C order."""
    return carray(_pointer(address), shape, np.float64)


@inline
def places(address: int, shape: tuple[int, ...]) -> Any:
    """Array of indices at an address, in C order."""
    return carray(_pointer(address), shape, np.intp)

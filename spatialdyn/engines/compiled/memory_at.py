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


def _real_function(typing_context: Any, address: Any, x: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        function = ir.FunctionType(ir.DoubleType(), [_WORD]).as_pointer()
        return builder.call(builder.inttoptr(values[0], function), [values[1]])

    return types.float64(types.intp, types.intp), generate


word: Any = intrinsic(_word_at)  # (address, k): word k behind an address
real_function: Any = intrinsic(_real_function)  # (address, word) -> float64 of a C function


@inline
def at(address: int, shape: tuple[int, ...]) -> Any:
    """Array of float64 at an address, in C order."""
    return carray(_pointer(address), shape, np.float64)


@inline
def places(address: int, shape: tuple[int, ...]) -> Any:
    """Array of indices at an address, in C order."""
    return carray(_pointer(address), shape, np.intp)

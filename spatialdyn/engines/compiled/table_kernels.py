"""Kernels over the table of bodies for functions other than public calls."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from . import numba_kernels


@cache
def kernel(
    function: Callable[..., int], *ranks: int, work: np.dtype | None = None, contract: bool = True
) -> Callable[..., int]:
    """A kernel ``(table, *arrays) -> status`` of an inlined ``function(bodies, [work,] *arrays)``, cached on disk.

    ranks     number of axes of each array; arrays are float64, in C order and writable
    work      dtype of a scratch table with a row per body
    contract  whether LLVM may fuse products and sums; not in what a Routine computes too
    """
    from numba import types

    from . import jit

    names = [f"x{k}" for k in range(len(ranks))]
    body = ["stamp", "bodies = table_at(table)"]
    if work is None:
        body.append(f"return function(bodies, {', '.join(names)})")
    else:
        body += ["size = len(bodies) * WORK_SIZE", "work = memory(size)"]
        body.append(f"status = function(bodies, array_at(work, (len(bodies),), WORK), {', '.join(names)})")
        body += ["release(work, size)", "return status"]
    scope = numba_kernels.native() | {"function": function, "WORK": work, "WORK_SIZE": work.itemsize if work else 0}
    made = numba_kernels.kernel_from_text(f"table_{function.__name__}", ["table", *names], body, scope)
    array: Any = types.Array
    signature = types.intp, *(array(types.float64, rank, "C") for rank in ranks)
    return jit.compile_signature(made, signature, contract=contract)

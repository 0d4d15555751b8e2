"""The failed samples of a batch; the public call names the fault of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiled import numba_kernels

Arrays = Sequence[NDArray[np.float64]]
RANGE = numba_kernels.NONFINITE + 1  # a status that the kernels do not have


class Failed(NamedTuple):
    """The samples of a batch (k) whose status is not OK.

    samples  (k) their indices in the batch
    status   (k) a status of ``numba_kernels``, or RANGE if a result is finite in float64 but not in the output's dtype
    finite   (k) whether the whole result is finite in float64
    inputs   their inputs, each (k, ...), or (1, ...) if all samples share the input
    """

    samples: NDArray[np.intp]
    status: NDArray[np.int8]
    finite: NDArray[np.bool_]
    inputs: Arrays


ALL_OK = Failed(np.empty(0, np.intp), np.empty(0, np.int8), np.empty(0, np.bool_), ())


def in_order(failed: Failed) -> Failed:
    """Failed samples sorted by their indices."""
    if failed is ALL_OK or (np.diff(failed.samples) > 0).all():
        return failed
    order = np.argsort(failed.samples)
    inputs = [x[order] if len(x) == len(order) else x for x in failed.inputs]
    return Failed(failed.samples[order], failed.status[order], failed.finite[order], inputs)


def concatenate_failed(parts: Sequence[Failed]) -> Failed:
    """The failed samples of several slices."""
    if not parts:
        return ALL_OK
    first, *more = parts
    if not more:
        return first
    inputs = [
        np.concatenate([np.broadcast_to(x, (len(p.samples), *x.shape[1:])) for p, x in zip(parts, of, strict=True)])
        for of in zip(*(p.inputs for p in parts), strict=True)
    ]
    samples, status, finite = (np.concatenate(of) for of in zip(*(p[:3] for p in parts), strict=True))
    return Failed(samples, status, finite, inputs)

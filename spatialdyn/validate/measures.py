"""Errors and their bounds, and what rounding does to them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BOUND = 1e-11  # on the scaled error of an entry, and on the residuals of aba and minverse
VALUE_BOUND = 1e-9  # on values of aba and minverse: Pinocchio's own are off by 4e-8 on a floating icub
WELL_CONDITIONED = 1e5  # condition number of M, scaled to a diagonal of 1, up to which those values are compared
RAISED = "bound raised to 4 eps |M| |x|"  # how the note begins where the bound on a residual is not BOUND


def size(error: float | None) -> float:
    """An error to be ordered by: one that is not finite is infinite."""
    return 0.0 if error is None else error if np.isfinite(error) else float("inf")


def scaled_error(x: Array, reference: Array, rank: int) -> float:
    """max |x - reference| / max(1, max |reference|) of each result of ``rank`` axes, the largest; nan if any is."""
    if x.shape != reference.shape:
        return float("inf")
    if x.size == 0:
        return 0.0
    axes = tuple(range(x.ndim - rank, x.ndim))
    with np.errstate(invalid="ignore"):
        off, scale = abs(x - reference).max(axis=axes), abs(reference).max(axis=axes)
        return float(np.max(off / np.maximum(1.0, scale)))


def rounding(M: Array, x: Array, right: Array) -> float:
    """What rounding the entries of x makes of M x = right: eps |M| |x|, scaled as an error of it is."""
    return float(np.finfo(float).eps * (abs(M) @ abs(x)).max(initial=0.0) / abs(right).max(initial=1.0))


def raised(rounded: float) -> float:
    """The bound on a residual of which rounding the exact answer costs so much."""
    return max(BOUND, 4.0 * rounded)


def times_vector(A: Array, x: Array) -> Array:
    """A x, sample by sample; A may have further axes after the samples."""
    product: Array = np.einsum("s...ij,sj->s...i", A, x)
    return product


def unit_diagonal(M: Array) -> Array:
    """Matrices (n, nv, nv) with rows and columns scaled to a diagonal of 1: units drop out."""
    scale = 1.0 / np.sqrt(np.einsum("...ii->...i", M))
    scaled: Array = M * scale[..., :, None] * scale[..., None, :]
    return scaled


def singular(M: Array) -> bool:
    """Whether an M of a batch is singular to rounding, whatever the units."""
    if (np.einsum("...ii->...i", M) <= 0.0).any():
        return True
    smallest = np.linalg.eigvalsh(unit_diagonal(M))[..., 0]
    return bool((smallest <= 10.0 * M.shape[-1] * np.finfo(float).eps).any())

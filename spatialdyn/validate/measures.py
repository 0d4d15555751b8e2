"""Errors, their bounds, and the effect of rounding on them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BOUND = 1e-11  # on the scaled error of an entry, and on the residuals of aba and minverse
VALUE_BOUND = 1e-9  # on values of aba and minverse: Pinocchio's own are off by 4e-8 on a floating icub
WELL_CONDITIONED = 1e5  # condition number of M, scaled to a diagonal of 1, up to which those values are compared
RAISED = "bound raised to 4 eps |M| |x|"  # begins the note of a residual whose bound is not BOUND


def sort_key(error: float | None) -> float:
    """An error as a sort key: infinite if it is not finite, 0 for None."""
    return 0.0 if error is None else error if np.isfinite(error) else float("inf")


def scaled_error(x: Array, reference: Array, rank: int) -> float:
    """The largest max |x - reference| / max(1, max |reference|) of results of ``rank`` axes; nan if any is."""
    if x.shape != reference.shape:
        return float("inf")
    if x.size == 0:
        return 0.0
    axes = tuple(range(x.ndim - rank, x.ndim))
    with np.errstate(invalid="ignore"):
        off, scale = abs(x - reference).max(axis=axes), abs(reference).max(axis=axes)
        return float(np.max(off / np.maximum(1.0, scale)))


def rounding(M: Array, x: Array, right: Array) -> float:
    """The residual of M x = right by rounding of x: eps |M| |x|, scaled as an error."""
    return float(np.finfo(float).eps * (abs(M) @ abs(x)).max(initial=0.0) / abs(right).max(initial=1.0))


def raised(rounded: float) -> float:
    """The bound on a residual, given the residual of the rounded exact result."""
    return max(BOUND, 4.0 * rounded)


def times_vector(A: Array, x: Array) -> Array:
    """A x, sample by sample; A may have further axes after the samples."""
    product: Array = np.einsum("s...ij,sj->s...i", A, x)
    return product


def unit_diagonal(M: Array) -> Array:
    """Matrices (n, nv, nv) with rows and columns scaled to a diagonal of 1, which makes them independent of units."""
    scale = 1.0 / np.sqrt(np.einsum("...ii->...i", M))
    scaled: Array = M * scale[..., :, None] * scale[..., None, :]
    return scaled


def singular(M: Array) -> bool:
    """Whether any M of a batch is singular to rounding, in any units."""
    if (np.einsum("...ii->...i", M) <= 0.0).any():
        return True
    smallest = np.linalg.eigvalsh(unit_diagonal(M))[..., 0]
    return bool((smallest <= 10.0 * M.shape[-1] * np.finfo(float).eps).any())

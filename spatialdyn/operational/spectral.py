"""Axes of a task, and the inverse of its mobility J M⁻¹ Jᵀ that stays bounded near singularities.

Rotations are compared with translations by a length: 1 rad/s² counts as ``length`` m/s². In that metric the mobility
has eigenvalues w. Those of at least ε = damping · w_max are inverted; below ε, w (3 - 2 w/ε) / ε² replaces 1/w. It has
the same value and slope at ε, never exceeds 1.125/ε, and vanishes with w: no force is applied in directions in which it
would not accelerate the task.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_number
from ..errors import SpatialDynError, literal

Array = NDArray[np.float64]
ALL_AXES = "xyz rxyz"
LENGTH = 0.3  # [m] by which rotations are compared with translations: about a link of an arm
LEAST_SHARE = 1e-100  # of the largest eigenvalue: lower bound of divisors
DAMPING = 1e-3  # of the largest eigenvalue: below, a direction is weak


def axes_of(axes: Any) -> list[int]:
    """The rows of a Jacobian, linear first, for a word like "xyz rz". Raises SpatialDynError."""
    return list(_rows(axes if isinstance(axes, str) else literal(axes)))


class Inverse(NamedTuple):
    """The bounded inverse of a mobility.

    matrix  (..., m, m)  symmetric
    rank    (...)        how many directions are strong
    weak    (..., m, m)  rows: unit vectors of weak directions in the metric of lengths, the others 0
    """

    matrix: Array
    rank: NDArray[np.intp]
    weak: Array


@lru_cache(maxsize=64)
def _rows(axes: str) -> tuple[int, ...]:
    found: list[int] = []
    for word in axes.split():
        turning = word.startswith("r")
        letters = word[turning:]
        if not letters or any(x not in "xyz" for x in letters):
            raise SpatialDynError(
                f'axes is {literal(axes)}, expected letters of xyz, and of rotations after an r: "xyz rz"'
            )
        found += ["xyz".index(x) + 3 * turning for x in letters]
    if not found or len(set(found)) < len(found):
        raise SpatialDynError(f'axes is {literal(axes)}, expected one axis or more, each once, as in "xyz rz"')
    return tuple(found)


def lengths_of(rows: list[int], length: Any) -> Array:
    """Factors that make each row a length: 1, for rotations ``length``. Raises SpatialDynError."""
    size = as_number(length)
    if not 0.0 < size < math.inf:
        raise SpatialDynError(f"length is {literal(length)}, expected a finite number above 0")
    return np.array([size if row >= 3 else 1.0 for row in rows])


def share_of(damping: Any) -> float:
    """The share of the largest eigenvalue below which a direction is weak. Raises SpatialDynError."""
    share = as_number(damping)
    if not LEAST_SHARE <= share <= 1.0:
        raise SpatialDynError(
            f"damping is {literal(damping)}, expected a number above 0 and at most 1, from {LEAST_SHARE:g} on"
        )
    return share


def spectral_inverse(A: Array, lengths: Array, share: float, whole: Array | None = None) -> Inverse:
    """The bounded inverse of A (..., m, m).

    whole  the mobility with the largest eigenvalue to compare with, by default A: the task's before others restrict it
    """
    scale = lengths[:, None] * lengths
    w, Q = np.linalg.eigh(A * scale)
    largest = w[..., -1:] if whole is None else np.linalg.eigvalsh(whole * scale)[..., -1:]
    eps = np.where(largest > 0.0, share * largest, 1.0)
    weak = w < eps
    part = np.where(weak, np.clip(w, 0.0, None) / eps, 0.0)
    gain = np.where(weak, part * (3.0 - 2.0 * part) / eps, 1.0 / np.where(weak, 1.0, w))
    inverse = (Q * gain[..., None, :]) @ np.swapaxes(Q, -1, -2)
    directions = np.where(weak[..., None], np.swapaxes(Q, -1, -2), 0.0)
    return Inverse(inverse * scale, (~weak).sum(-1), directions)

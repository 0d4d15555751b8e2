"""Physical consistency of inertias, and the nearest consistent one.

With Σ = ½ tr(I) 1 - I the second moments of mass about the com, a mass distribution exists exactly if mass >= 0
and Σ is positive semidefinite, which is I positive semidefinite and the triangle inequality on its principal
moments. Source: Wensing, Kim, Slotine, Linear matrix inequalities for physically consistent inertial parameter
identification (2018), the pseudo-inertia [[Σ, h], [hᵀ, m]]; about the com its first moment h is zero.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LARGE = 2.0**1000  # sums of a few such numbers do not overflow
ROUNDING = 1e-6  # of the largest moment: files print few digits, and for a flat plate the inequality is an equality


def shown_moments(I: Array) -> str:
    """The principal moments of I (3, 3), in words."""
    return "principal moments [{:.6g} {:.6g} {:.6g}]".format(*np.linalg.eigvalsh(I))


def inertia_defect(I: Array) -> str:
    """Why I (3, 3) about the com [kg m²] is not physical, in words; empty if it is.

    The moments a <= b <= c fail if c - (a + b) exceeds ROUNDING times the largest. A negative moment fails that too, as
    c >= b. There is no absolute tolerance: an inertia of 1e-20 kg m² is judged like any other.
    """
    a, b, c = np.linalg.eigvalsh(I).tolist()
    largest = max(abs(a), abs(c))
    if c - (a + b) <= ROUNDING * largest:
        return ""
    ratio = c / (a + b) if a + b > 1e-15 * largest else math.inf
    what = f"the largest is {ratio:.6g} times the sum of the others, expected at most 1"
    if a < -ROUNDING * largest:
        what = "expected none negative, and " + what
    return f"has {shown_moments(I)}: {what}"


def parallel_axis(I: Array, mass: float, d: Array) -> Array:
    """Ī + m (d·d 1 - d dᵀ): an inertia (3, 3) about the com moved to a point at the distance vector d."""
    return np.asarray(I + mass * (d @ d * np.eye(3) - np.outer(d, d)))


def symmetric(I: Array) -> Array:
    """½ (I + Iᵀ) of an inertia (3, 3), without overflow; a symmetric I keeps its bits."""
    return np.asarray(np.where(I == I.T, I, 0.5 * I + 0.5 * I.T))


def nearest_physical(I: Array) -> Array:
    """The nearest physical rotational inertia (3, 3) about the com [kg m²]; infinite if it overflows.

    Σ is projected on the positive semidefinite cone: nearest in the Frobenius norm of the pseudo-inertia about the
    com; mass and com stay.
    """
    scale = LARGE if abs(I).max() > LARGE else 1.0  # a power of two: exact
    I = I / scale
    second = 0.5 * np.trace(I) * np.eye(3) - I
    values, axes = np.linalg.eigh(second)
    second = (axes * np.maximum(values, 0.0)) @ axes.T
    second = 0.5 * (second + second.T)
    with np.errstate(over="ignore"):
        return np.asarray((np.trace(second) * np.eye(3) - second) * scale)

"""Norms of inputs and results at which underflow in float32 does not matter.

Below 2⁻¹²⁶ float32 has a fixed grid, so an operation is off by at most 2⁻¹⁵⁰, however small its result. This is an
absolute error, which only the numbers of the robot, velocities, and divisions by articulated inertias can enlarge. If
the largest result is far above the enlarged error, the error is below the rounding of float32, 2⁻²⁴ of the result;
``specialize`` recomputes other samples in float64.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..record.kernel_layout import Float32Range

MOST = 2.0**60  # upper limit of the largest number of a body's inertia
LEAST = 2.0**-60  # lower limit of it; also least ratio of an articulated inertia to the robot's largest number
INPUTS = 2.0**30  # upper limit of the norm of all inputs together
RESULTS = 2.0**-58  # lower limit of the largest result; its square is a normal number
UNDERFLOW = 2.0**-106  # 2⁻¹⁵⁰ over 2⁻²⁴, enlarged by velocities up to 2²⁰
FULL = 2.0**60  # cap of the least values: rejects all samples, and its square is finite
SMALLEST = np.float32(2.0**-149)  # the smallest number above 0


def ranges(bodies: NDArray[Any], driving: Sequence[int] | None) -> tuple[Float32Range, float]:
    """Norms of inputs and outputs of a program in float32, and the least value of its pivots.

    driving  indices of the input arrays that are not positions; None if one of them is a constant other than 0
    """
    c = float(max([1.0, *map(size, bodies), *(abs(x) for row in bodies for x in (*row["X"]["p"], *row["gravity"]))]))
    least = min(max(RESULTS, UNDERFLOW * c * c), FULL)
    return Float32Range(INPUTS, least, None if driving is None else tuple(driving)), min(LEAST * c, FULL)


def beyond(bodies: NDArray[Any]) -> list[int]:
    """Rows of the table whose inertia, or products of it, are out of float32's range."""
    return [i for i, row in enumerate(bodies) if i and size(row) and not LEAST <= size(row) <= MOST]


def size(row: Any) -> float:
    """The largest magnitude of a number in a row's inertia or armature."""
    m, h, I = row["inertia"].tolist()
    return float(max(map(abs, (m, *h, *I, float(row["armature"])))))

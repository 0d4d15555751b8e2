"""What float32 can hold: sizes at which nothing that counts is lost below its least number.

Below 2⁻¹²⁶ float32 has a fixed grid, so an operation is off by 2⁻¹⁵⁰ at most however small its result: an absolute
error, which what it is multiplied with afterwards can only enlarge by the numbers of the robot, by velocities, and
by divisions by the articulated inertias. Where the largest result is far above that, the error is below the rounding
of float32, 2⁻²⁴ of it; where it is not, ``specialize`` turns to float64.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .simd import Range

MOST = 2.0**60  # of a body's mass, moments and inertia, whichever is largest
LEAST = 2.0**-60  # of the same; an articulated inertia may be so many times the largest number of the robot
INPUTS = 2.0**30  # of all inputs together
RESULTS = 2.0**-58  # of the largest result; its square is a normal number
UNDERFLOW = 2.0**-106  # 2⁻¹⁵⁰ over 2⁻²⁴, grown by velocities to 2²⁰
FULL = 2.0**60  # beyond, whatever is asked for: nothing stays on the lanes, and the square is still a number
SMALLEST = np.float32(2.0**-149)  # above 0


def ranges(bodies: NDArray[Any], driving: Sequence[int] | None) -> tuple[Range, float]:
    """Sizes of inputs and outputs of a program in float32, and the least that its pivots may be.

    driving  numbers of the input arrays that are not positions; None if a constant in place of one is not 0
    """
    c = float(max([1.0, *map(size, bodies), *(abs(x) for row in bodies for x in (*row["X"]["p"], *row["gravity"]))]))
    least = min(max(RESULTS, UNDERFLOW * c * c), FULL)
    return Range(INPUTS, least, None if driving is None else tuple(driving)), min(LEAST * c, FULL)


def beyond(bodies: NDArray[Any]) -> list[int]:
    """Rows of the table with an inertia that has no digits in float32, or whose products have none."""
    return [i for i, row in enumerate(bodies) if i and size(row) and not LEAST <= size(row) <= MOST]


def size(row: Any) -> float:
    """The largest number of a row's inertia, its armature included."""
    m, h, I = row["inertia"].tolist()
    return float(max(map(abs, (m, *h, *I, float(row["armature"])))))

"""Argument checks and result checks of one sample, which kernels run before and after a recursion.

The checks branch on values, so they are not part of the recursion.
"""

from __future__ import annotations

from typing import Any

from ...algebra.rotations import UNIT_TOLERANCE
from ...algebra.scalars import EPS, everywhere, inline
from ...bodies.joints import norms_within, pitch_of
from ...bodies.kinds import LENGTHS, SCREWS, SLIDES
from ...bodies.table import ANY_NORM

LARGEST = 1.7976931348623157e308


@inline
def unit_norm(bodies: Any, q: Any) -> bool:
    """Whether every quaternion and (cos, sin) pair of q has unit norm, or the table allows any norm.

    A NaN passes, and the result is NaN.
    """
    return bodies[0].kind == ANY_NORM or norms_within(bodies, q, UNIT_TOLERANCE)


@inline
def no_overlap(x: Any, out: Any) -> bool:
    """Whether an input and the output, in C order, share no memory."""
    first = last = x.ctypes.data
    for size, stride in zip(x.shape, x.strides):  # noqa: B905 - Numba has no strict
        reach = (size - 1) * stride
        if reach < 0:
            first += reach
        else:
            last += reach
    start = out.ctypes.data
    return bool(x.size == 0 or last < start or first >= start + out.itemsize * out.size)


@inline
def pivots_regular(bodies: Any, q: Any, pivots: Any) -> bool:
    """Whether no row is singular in float64; composite inertias are bounded, so a few regular rows fail too."""
    return singular_row(bodies, q, pivots, EPS) == 0


@inline
def singular_row(bodies: Any, q: Any, pivots: Any, eps: Any) -> int:
    """The last row whose D is NaN or at most n eps times a bound on its composite inertia; 0 if there is none.

    The bound grows with the distances that prismatic, helical, planar and floating joints below the first have moved.
    """
    n = len(bodies) - 1
    travel = 0.0
    for i in range(1, n + 1):
        kind, k = bodies[i].kind, bodies[i].q_index
        if kind in SCREWS:
            travel += abs(pitch_of(bodies[i]) * q[k])
        elif bodies[i].parent > 0 or kind in SLIDES:
            for m in range(k, k + LENGTHS[kind]):
                travel += abs(q[m])
    for i in range(n, 0, -1):
        b = bodies[i]
        bound = b.armature + b.inertia_bound.x + travel * (2.0 * b.inertia_bound.y + travel * b.inertia_bound.z)
        if not everywhere(pivots[i - 1] > n * eps * bound):
            return i
    return 0


@inline
def all_finite(x: Any) -> bool:
    """Whether every entry of an array is finite, by a count over a flat view, which LLVM vectorizes."""
    flat = x.ravel()
    not_finite = 0
    for k in range(len(flat)):
        if not abs(flat[k]) <= LARGEST:
            not_finite += 1
    return not_finite == 0

"""What a caller asks of one sample beside the recursion itself: is its input fit, is its answer to be trusted.

These look at values, so they are no recursions: engines run them around one.
"""

from __future__ import annotations

from typing import Any

from ...algebra.scalars import inlined
from ...bodies.joints import norms_within
from ...bodies.table import ANY_NORM, FLOATING, PLANAR, PLANAR_CS, PRISMATIC

UNIT_TOLERANCE = 2e-6  # on the squared norm: a norm within 1e-6 of 1, so that float32 input passes
EPS = 2.220446049250313e-16
LARGEST = 1.7976931348623157e308


@inlined
def unit_norm(bodies: Any, q: Any) -> bool:
    """Whether every quaternion and (cos, sin) pair of q has unit norm, or the table asks for none.

    A NaN is let through, to come out as NaN.
    """
    return bodies[0].kind == ANY_NORM or norms_within(bodies, q, UNIT_TOLERANCE)


@inlined
def apart(x: Any, out: Any) -> bool:
    """Whether an input and the output, in C order, have no memory in common."""
    first = last = x.ctypes.data
    for size, stride in zip(x.shape, x.strides):  # noqa: B905 - Numba has no strict
        reach = (size - 1) * stride
        if reach < 0:
            first += reach
        else:
            last += reach
    start = out.ctypes.data
    return bool(x.size == 0 or last < start or first >= start + out.itemsize * out.size)


@inlined
def sound_pivots(bodies: Any, q: Any, pivots: Any) -> bool:
    """Whether no row is singular to float64; a few that are are no cause for alarm, for a bound stands for the rest."""
    return singular_row(bodies, q, pivots, EPS) == 0


@inlined
def singular_row(bodies: Any, q: Any, pivots: Any, eps: Any) -> int:
    """The last row whose D is not above n eps of a bound on its composite inertia, 0 if there is none.

    The bound grows with how far prismatic, planar and floating joints below the first have moved.
    """
    n = len(bodies) - 1
    travel = 0.0
    for i in range(1, n + 1):
        kind, k = bodies[i].kind, bodies[i].at
        if kind == PRISMATIC:
            travel += abs(q[k])
        elif bodies[i].parent > 0 and kind in (PLANAR, PLANAR_CS, FLOATING):
            travel += abs(q[k]) + abs(q[k + 1])
            if kind == FLOATING:
                travel += abs(q[k + 2])
    for i in range(n, 0, -1):
        b = bodies[i]
        bound = b.armature + b.bound.x + travel * (2.0 * b.bound.y + travel * b.bound.z)
        if not pivots[i - 1] > n * eps * bound:
            return i
    return 0


@inlined
def all_finite(x: Any) -> bool:
    """Whether every entry of an array is finite; counted over a flat view, the form that becomes SIMD code."""
    flat = x.ravel()
    lost = 0
    for k in range(len(flat)):
        if not abs(flat[k]) <= LARGEST:
            lost += 1
    return lost == 0

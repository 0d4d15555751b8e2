"""Iterations of a step's equations until they change by rounding only, and their acceleration.

No function branches on a value: an iteration is a region of ``algebra.regions``. So the same source is compiled and
recorded into a program, which runs samples side by side, each until its own equations are solved.

Source: for slow iterations, Walker, Ni, Anderson acceleration for fixed-point iterations (2011).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ...algebra.regions import when
from ...algebra.scalars import EPS, compiled_as, inline_unoptimized, no_inline, select, sqrt
from ..system import NONFINITE, STALLED, TORQUE, System, set_status

SWEEPS = 100  # at most; reasonable steps take 5 to 20
LARGEST = 1e300
SLOW = 0.25  # ratio of changes above which acceleration is turned on
NEW = 0.01  # least part of the square of a new difference that lies outside the span of the earlier ones
SETTLED = 1e-10  # relative: a change this small that no longer shrinks is rounding
ACCELERATED_SETTLED = 1e-13  # the same for an accelerated iteration


class Sweeps(NamedTuple):
    """The state of an iteration, numbers (1,).

    left    above 0 while it goes on
    change  relative change of the last sweep
    before  relative change of the sweep before
    known   sweeps in the memory of ``anderson_step``, whose rows are 0 at first
    still   1 if the last change is rounding error of the terms that sum to a state, even if the state vanishes; else 0
    """

    left: Any
    change: Any
    before: Any
    known: Any
    still: Any


@inline_unoptimized
def sweeps_of(rows: Any) -> Sweeps:
    """The Sweeps of an iteration that begins."""
    left, change, before, known, still = rows[0][:1], rows[1][:1], rows[2][:1], rows[3][:1], rows[4][:1]
    left[0], change[0], before[0], known[0], still[0] = 1.0, 0.0, math.inf, 0.0, 0.0
    return Sweeps(left, change, before, known, still)


@inline_unoptimized
def judge(system: System, s: Sweeps, change: Any, still: Any) -> Any:
    """Decide whether the iteration goes on: it ends if the relative change is rounding and no longer shrinks, or fails.

    still  1 if the change is rounding, see ``Sweeps``, else 0

    Returns a number above 0 if it goes on but converges so slowly that it should be accelerated. The change of an
    accelerated iteration may grow long before it is rounding.
    """
    rounding = select(change - select(s.known[0], ACCELERATED_SETTLED, SETTLED), still, 1.0)
    ends = select(change - 2.0 * EPS, select(rounding, select(s.before[0] - change, 0.0, 1.0), 0.0), 1.0)
    left = select(ends, 0.0, select(LARGEST - change, 1.0, 0.0))
    if system.status[0] != 0:
        left = 0.0
    slow = select(left, select(s.known[0], 1.0, select(change - SLOW * s.before[0], 1.0, 0.0)), 0.0)
    s.before[0] = select(left, change, s.before[0])
    s.left[0], s.change[0], s.still[0] = left, change, still
    return slow


@inline_unoptimized
def end(system: System, t: float, s: Sweeps, y: Any) -> None:
    """Set the status if an iteration has failed; only recordings use its solution y."""
    if not s.change[0] <= LARGEST:
        set_status(system, NONFINITE, t)
    if s.before[0] <= LARGEST and system.status[0] != 0 and system.status[0] != TORQUE:
        system.status[0], system.status[1], system.status[2] = STALLED, t, s.before[0]  # the iterates diverge
    if s.left[0] > 0.0 and not (s.change[0] <= SETTLED or s.still[0] > 0.0):
        set_status(system, STALLED, t, s.change[0])


@inline_unoptimized
def relative(change: Any, size: Any) -> Any:
    """change / size; 0 if nothing changes, infinite for NaN."""
    return select(LARGEST - change, select(change, change / select(size, size, 1.0), 0.0), math.inf)


@no_inline
def anderson_step(known: Any, f: Any, y: Any, F: Any, U: Any) -> None:
    """One step of Anderson acceleration of y = G(x), f = G(x) - x: y moves to the least f predicted by the last sweeps.

    Terms of size h |v| couple the rotation of a fast body with its translation; they make a plain iteration circle or
    diverge.

    known  (1,)  written: sweeps in the memory
    y      written: next x
    F, U   (1 + memory, n)  written: orthonormal differences of f and the matching differences of y, the newest first;
           f and y in the last row
    """
    n, last = len(f), len(F) - 1
    for j in range(last - 1, 0, -1):
        for i in range(n):
            F[j, i], U[j, i] = F[j - 1, i], U[j - 1, i]
    whole = square = 0.0
    for i in range(n):
        F[0, i], U[0, i] = select(known[0], f[i] - F[last, i], 0.0), select(known[0], y[i] - U[last, i], 0.0)
        whole = whole + F[0, i] * F[0, i]
        F[last, i], U[last, i] = F[0, i], U[0, i]
    for j in range(1, last):
        part = 0.0
        for i in range(n):
            part = part + F[j, i] * F[0, i]
        for i in range(n):
            F[0, i] = F[0, i] - part * F[j, i]
            U[0, i] = U[0, i] - part * U[j, i]
    for i in range(n):
        square = square + F[0, i] * F[0, i]
    dependent = NEW * whole - square  # above 0: drop older differences, the remainder is rounding
    for _ in when(dependent, F, U):
        for i in range(n):
            F[0, i], U[0, i] = F[last, i], U[last, i]
            for j in range(1, last):
                F[j, i] = U[j, i] = 0.0
    square = select(dependent, whole, square)
    size = select(square, 1.0 / sqrt(select(square, square, 1.0)), 0.0)
    for i in range(n):
        F[0, i], U[0, i] = size * F[0, i], size * U[0, i]
        F[last, i], U[last, i] = f[i], y[i]
    for j in range(last):
        part = 0.0
        for i in range(n):
            part = part + F[j, i] * f[i]
        for i in range(n):
            y[i] = y[i] - part * U[j, i]
    known[0] = known[0] + 1.0


def largest(x: Any) -> Any:
    """The largest of some numbers >= 0; infinite if one is NaN or beyond LARGEST."""
    if x.dtype == object:
        found: Any = 0.0
        for y in x:
            found = select(LARGEST - y, select(y - found, y, found), math.inf)
        return found
    values = x.tolist()
    return max(values, default=0.0) if all(y <= LARGEST for y in values) else math.inf


@compiled_as(largest)
def _largest(x):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    def found(x):  # type: ignore[no-untyped-def]
        most = 0.0
        for i in range(len(x)):
            if not x[i] <= LARGEST:
                return math.inf
            most = max(most, x[i])
        return most

    return found

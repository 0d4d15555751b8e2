"""Bilinear interpolation in a table of heights: a lookup for floats, sums of weights for numbers that record.

A program has no addresses to look up, so each height is in it, times a weight that is 0 but in its cell: its length
grows with the table. All other engines read the four heights around the point.
"""

from __future__ import annotations

import math
from functools import singledispatch
from typing import Any

from .scalars import Scalar, compiled_as, select


@singledispatch
def bilinear(x: Scalar, y: Scalar, heights: Any, first: int) -> tuple[Scalar, Scalar, Scalar]:
    """(f, ∂f/∂x, ∂f/∂y) at x, y in cells from the first height; beyond the table it goes on level from its rim.

    heights  rows with the column z, those of one x after another; row 0 is the header, with their numbers nx and ny
    first    row of the first of nx ny heights
    """
    nx, ny = heights[0].nx, heights[0].ny
    if not (x == x and y == y):  # NaN has no cell
        return x + y, x + y, x + y
    i, j = min(max(math.floor(x), 0), nx - 2), min(max(math.floor(y), 0), ny - 2)
    s, t = min(max(x - i, 0), 1), min(max(y - j, 0), 1)
    k = first + i * ny + j
    a, b, c, d = heights[k].z, heights[k + 1].z, heights[k + ny].z, heights[k + ny + 1].z
    level = (1 - s) * ((1 - t) * a + t * b) + s * ((1 - t) * c + t * d)
    along = (1 - t) * (c - a) + t * (d - b) if 0 <= x < nx - 1 else 0.0 * a
    across = (1 - s) * (b - a) + s * (d - c) if 0 <= y < ny - 1 else 0.0 * a
    return level, along, across


@compiled_as(bilinear)
def _bilinear(x, y, heights, first):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    def read(x, y, heights, first):  # type: ignore[no-untyped-def]
        nx, ny = heights[0].nx, heights[0].ny
        if not (abs(x) < 1e15 and abs(y) < 1e15):
            lost = x - x + (y - y)
            return lost, lost, lost
        i, j = min(max(math.floor(x), 0), nx - 2), min(max(math.floor(y), 0), ny - 2)
        s, t = min(max(x - i, 0.0), 1.0), min(max(y - j, 0.0), 1.0)
        k = first + i * ny + j
        a, b, c, d = heights[k].z, heights[k + 1].z, heights[k + ny].z, heights[k + ny + 1].z
        level = (1.0 - s) * ((1.0 - t) * a + t * b) + s * ((1.0 - t) * c + t * d)
        along = (1.0 - t) * (c - a) + t * (d - b) if 0.0 <= x < nx - 1.0 else 0.0
        across = (1.0 - s) * (b - a) + s * (d - c) if 0.0 <= y < ny - 1.0 else 0.0
        return level, along, across

    return read


def by_weights(x: Scalar, y: Scalar, heights: Any, first: int) -> tuple[Scalar, Scalar, Scalar]:
    """``bilinear`` without a branch or an address."""
    ny = heights[0].ny
    (p, dp), (q, dq) = _weights(x, heights[0].nx), _weights(y, ny)
    level: Scalar = 0.0
    along: Scalar = 0.0
    across: Scalar = 0.0
    for j in range(ny):
        line: Scalar = 0.0
        slope: Scalar = 0.0
        for i in range(len(p)):
            z = heights[first + i * ny + j].z
            line = line + z * p[i]
            slope = slope + z * dp[i]
        level, along, across = level + line * q[j], along + slope * q[j], across + line * dq[j]
    return level, along, across


def _weights(x: Scalar, count: int) -> tuple[list[Scalar], list[Scalar]]:
    """The weight of each of ``count`` heights at x, and its derivative."""
    passed: list[Scalar] = [1.0]  # how far of each cell lies behind x
    inside: list[Scalar] = [0.0]  # 1 in its cell
    behind = select(-x, 0.0, 1.0)
    for k in range(count - 1):
        rest = select(x - k, x - k, 0.0)
        passed.append(select(1.0 - rest, rest, 1.0))
        ahead = select(k + 1.0 - x, 0.0, 1.0)
        inside.append(behind - ahead)
        behind = ahead
    passed.append(0.0)
    inside.append(0.0)
    return (
        [passed[k] - passed[k + 1] for k in range(count)],
        [inside[k] - inside[k + 1] for k in range(count)],
    )

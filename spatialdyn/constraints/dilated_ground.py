"""Heights of the ground dilated by the radius of a sphere: the heights of its centre when it touches the ground.

A sphere of radius r with its centre above a point x of the ground's plane touches heights f at the x + d with the
largest f(x + d) + √(r² - |d|²): no part of the ground is then nearer than r. The slope of these largest values at x is
the slope of the ground at x + d, so the sphere's centre over the dilated heights has the gap and the normal of the
sphere over the ground.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..bodies.contact_table import HEIGHTS
from ..bodies.static_table import StaticTable

Array = NDArray[np.float64]
STEPS = 20  # limit of Newton steps in a cell; two to five suffice
CLOSEST = 1e-9  # of the radius: lower bound of the height √(r² - |d|²), at which the sphere's side is nearly vertical


def heights_table(levels: list[Array], spacing: float, origin: tuple[float, float]) -> StaticTable:
    """The table of several arrays of heights (nx, ny), one after another."""
    nx, ny = levels[0].shape
    rows = np.zeros(1 + len(levels) * nx * ny, HEIGHTS)
    rows[0]["last_row"], rows[0]["nx"], rows[0]["ny"] = len(rows) - 1, nx, ny
    rows[0]["x"], rows[0]["y"], rows[0]["spacing"] = *origin, spacing
    rows["z"][1:] = np.concatenate([z.ravel() for z in levels])
    return StaticTable(rows, ())


def dilated(z: Array, spacing: float, radius: float) -> Array:
    """Heights (nx, ny) of a sphere's centre above each grid point when the sphere touches the heights z.

    First the grid point within the radius that supports the sphere highest is found, then Newton's steps follow on the
    parabola through it and its neighbours: exact on planes, spheres and parabolas to the order of spacing².
    """
    if radius == 0.0:
        return z
    best, at = _highest_of_grid(z, spacing, radius)
    first, second = _slopes(z, spacing)
    g, H = first[:, at[0], at[1]], second[:, at[0], at[1]]
    grid = np.indices(z.shape)
    start: Array = np.asarray(spacing * (at - grid), np.float64)  # d of the chosen grid point
    e: Array = np.zeros(start.shape)
    best = z[at[0], at[1]] + np.sqrt(radius**2 - (start**2).sum(axis=0))
    for _ in range(STEPS):
        d = start + e
        side = np.sqrt(np.maximum(radius**2 - (d**2).sum(axis=0), (CLOSEST * radius) ** 2))
        slope = g + np.stack([H[0] * e[0] + H[1] * e[1], H[1] * e[0] + H[2] * e[1]]) - d / side
        a, b, c = (x - y for x, y in zip(H, _bend(d, side, radius), strict=True))
        det = a * c - b * b
        concave = (a < 0.0) & (det > 0.0)
        det = np.where(concave, det, 1.0)
        step = np.where(
            concave,
            -np.stack([c * slope[0] - b * slope[1], a * slope[1] - b * slope[0]]) / det,
            slope * spacing / np.maximum(np.sqrt((slope**2).sum(axis=0)), 1.0),
        )
        e = _within(start, np.asarray(np.clip(e + step, -0.5 * spacing, 0.5 * spacing), np.float64), radius)
    d = start + e
    level = z[at[0], at[1]] + (g * e).sum(axis=0) + 0.5 * (H[0] * e[0] ** 2 + 2 * H[1] * e[0] * e[1] + H[2] * e[1] ** 2)
    found = level + np.sqrt(np.maximum(radius**2 - (d**2).sum(axis=0), 0.0))
    made: Array = np.maximum(best, found)
    return made


def _highest_of_grid(z: Array, spacing: float, radius: float) -> tuple[Array, NDArray[np.intp]]:
    """For each grid point the highest centre of a sphere on grid points, and the index (2, nx, ny) of its support."""
    reach = math.ceil(radius / spacing) - 1
    best, at = z + radius, np.array(np.indices(z.shape))
    nx, ny = z.shape
    for i in range(-min(reach, nx - 1), min(reach, nx - 1) + 1):
        for j in range(-min(reach, ny - 1), min(reach, ny - 1) + 1):
            rest = radius**2 - spacing**2 * (i * i + j * j)
            if rest <= 0.0:
                continue
            here = slice(max(0, -i), nx - max(0, i)), slice(max(0, -j), ny - max(0, j))
            there = slice(max(0, i), nx + min(0, i)), slice(max(0, j), ny + min(0, j))
            higher = z[there] + math.sqrt(rest)
            more = higher > best[here]
            best[here] = np.where(more, higher, best[here])
            for axis, offset in enumerate((i, j)):
                at[axis][here] = np.where(more, np.indices(z.shape)[axis][here] + offset, at[axis][here])
    return best, at


def _slopes(z: Array, spacing: float) -> tuple[Array, Array]:
    """First derivatives (2, nx, ny) and second ones (3, nx, ny), xx, xy, yy, of parabolas through neighbours."""
    first = np.array([np.gradient(z, spacing, axis=k) for k in (0, 1)])
    second = np.zeros((3, *z.shape))
    second[0, 1:-1] = (z[2:] - 2.0 * z[1:-1] + z[:-2]) / spacing**2
    second[2, :, 1:-1] = (z[:, 2:] - 2.0 * z[:, 1:-1] + z[:, :-2]) / spacing**2
    second[1] = np.gradient(first[0], spacing, axis=1)
    return first, second


def _bend(d: Array, side: Array, radius: float) -> tuple[Array, Array, Array]:
    """Minus the second derivatives of √(r² - |d|²)."""
    cube = side**3
    return (side**2 + d[0] ** 2) / cube, d[0] * d[1] / cube, (side**2 + d[1] ** 2) / cube


def _within(start: Array, e: Array, radius: float) -> Array:
    """e, shortened if start + e leaves the disc of the radius."""
    d = start + e
    size = np.sqrt((d**2).sum(axis=0))
    made: Array = d * np.minimum(1.0, (1.0 - CLOSEST) * radius / np.maximum(size, CLOSEST * radius)) - start
    return made

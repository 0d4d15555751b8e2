"""The delay between torque and motion: by whole samples from one factor, then by Gauss-Newton between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .equations import Equations, Rows
from .least_squares import Factors, added, factors_of, solve, triangle

Array = NDArray[np.float64]
MOST = 25  # samples, in either direction
ROWS = 1 << 15  # rows of each freedom in the search for whole samples
TURNS = 8
SETTLED = 1e-3  # of a sample: a smaller step ends the search


def whole_delay(equations: Sequence[Equations], columns: NDArray[np.intp], most: int = MOST, look: int = ROWS) -> int:
    """The delay in samples, -most .. most, at which the torques fit best.

    One factor of [W, y of each delay] gives the residuals of all delays.
    """
    count, shifts = len(columns), range(-most, most + 1)
    kept: list[Array] = []
    for one in equations:
        found = [*one.left_sides(look)]
        W, known, keep = (np.concatenate(x)[:look] for x in zip(*found, strict=True))
        first, tau = one.motion.first, one.torques[:, : known.shape[1]]
        k = np.arange(len(W))
        k = k[(first + k - most >= 0) & (first + k + most < len(tau))]
        if not len(k):
            continue
        Y = np.stack([tau[first + k - s] for s in shifts], -1) - known[k, :, None]
        for i in range(known.shape[1]):
            use = keep[k, i]
            R = triangle(np.concatenate([W[k][:, i][:, columns], Y[:, i]], 1)[use])
            if len(kept) <= i:
                kept.append(R)
            else:
                kept[i] = triangle(np.concatenate([kept[i], R]))
    if not kept:
        return 0
    sigma, best = np.array([max(np.sqrt(np.mean(R[:, count:] ** 2)), 1e-300) for R in kept]), most
    for _ in range(3):
        R = triangle(np.concatenate([x / s for x, s in zip(kept, sigma, strict=True)]))
        beta = np.linalg.lstsq(R[:count, :count], R[:count, count:], rcond=None)[0]
        squares = np.array([((x[:, :count] @ beta - x[:, count:]) ** 2).sum(0) for x in kept])
        best = int(np.log(np.maximum(squares, 1e-300)).sum(0).argmin())
        sigma = np.sqrt(np.maximum(squares[:, best], 1e-300))
    return best - most


def fitted_delay(equations: Sequence[Equations], columns: NDArray[np.intp], weighted: bool) -> tuple[float, Factors]:
    """The delay [s] that fits best, and its factors, with the column of the delay before y."""
    dt = equations[0].recording.dt
    delay = whole_delay(equations, columns) * dt
    factors = merged([factors_of(one.rows(delay), columns) for one in equations])
    for _ in range(TURNS):
        beta = solve(factors, weighted).beta[: len(columns)]

        def slope(rows: Rows, beta: Array = beta) -> Array:
            torque = rows.W[:, :, columns] @ beta + rows.tau - rows.y
            return np.asarray(np.gradient(torque, rows.t[1] - rows.t[0], axis=0) if len(rows.t) > 1 else 0.0 * torque)

        factors = merged([factors_of(one.rows(delay), columns, slope) for one in equations])
        step = float(np.clip(solve(factors, weighted).beta[-1], -dt, dt))
        if abs(step) < SETTLED * dt:
            break
        delay += step
        factors = merged([factors_of(one.rows(delay), columns) for one in equations])
    return delay, factors


def merged(parts: Sequence[Factors]) -> Factors:
    """Factors of the rows of all parts."""
    total = parts[0]
    for one in parts[1:]:
        total = added(total, one)
    return total

"""The range of a path: extremes of its polynomials, and the check against limits of joints."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SpatialDynError
from ..model.model import Model

Array = NDArray[np.float64]
ROUNDING = 1e-9  # relative tolerance at limits, which a path may touch


def extremes(c: Array, h: Array) -> Array:
    """(3, 2, ...): least and largest value of Σ_m c_m s^m and its first two derivatives, over all segments.

    c  (..., segments, powers)
    h  (..., segments)  lengths of segments, s from 0 to h
    """
    found = np.empty((3, 2, *c.shape[:-2]))
    for order in range(3):
        least, most = _cubic(c, h, order) if c.shape[-1] <= 4 else _general(c, h, order)
        found[order] = least.min(-1), most.max(-1)
    return found


def _cubic(c: Array, h: Array, order: int) -> tuple[Array, Array]:
    """Extremes of each segment, for powers up to 3: at its ends and where the derivative, a parabola, is 0."""
    powers = [c[..., m] if m < c.shape[-1] else np.zeros(c.shape[:-1]) for m in range(4)]
    for _ in range(order):
        powers = [(m + 1) * x for m, x in enumerate(powers[1:])] + [np.zeros(c.shape[:-1])]
    slope, bend, jerk = powers[1], 2.0 * powers[2], 3.0 * powers[3]  # of the derivative, slope + bend s + jerk s²
    with np.errstate(all="ignore"):
        half = -0.5 * (bend + np.copysign(np.sqrt(bend * bend - 4.0 * jerk * slope), bend))
        roots = half / jerk, slope / half
    places = [np.zeros_like(slope), np.broadcast_to(h, slope.shape)]
    places += [np.where((x > 0.0) & (x < h), x, 0.0) for x in roots]
    values = [powers[0] + s * (powers[1] + s * (powers[2] + s * powers[3])) for s in places]
    return np.minimum.reduce(values), np.maximum.reduce(values)


def _general(c: Array, h: Array, order: int) -> tuple[Array, Array]:
    """Extremes of each segment, from the roots of a polynomial."""
    least, most = np.empty(c.shape[:-1]), np.empty(c.shape[:-1])
    lengths = np.broadcast_to(h, c.shape[:-1])
    for at in np.ndindex(c.shape[:-1]):
        p, end = np.polynomial.Polynomial(c[at]), float(lengths[at])
        p = p.deriv(order) if order else p
        roots = p.deriv().roots() if p.degree() > 1 else np.empty(0)
        inside = [float(x.real) for x in np.atleast_1d(roots) if abs(x.imag) < 1e-9 * end and 0.0 < x.real < end]
        values = p(np.array([0.0, end, *inside]))
        least[at], most[at] = values.min(), values.max()
    return least, most


def check_limits(model: Model, peaks: Any) -> None:
    """Raise SpatialDynError, naming the joint, if peaks (..., n) are beyond position or velocity limits."""
    lowest, highest, fastest = (x.reshape(-1, x.shape[-1]) for x in (peaks.lowest, peaks.highest, peaks.v))
    which = [""] if len(lowest) == 1 else [f" {b}" for b in range(len(lowest))]
    for joint in model.joints[1:]:
        for k in range(joint.idx_q, joint.idx_q + joint.nq):
            low, high = model.lower[k], model.upper[k]
            room = ROUNDING * max(1.0, *(abs(x) for x in (low, high) if math.isfinite(x)), 1.0)
            for x, far in ((lowest[:, k], low - lowest[:, k]), (highest[:, k], highest[:, k] - high)):
                b = int(far.argmax())
                if far[b] > room:
                    raise SpatialDynError(
                        f'path{which[b]} moves joint "{joint.name}" to {x[b]:.6g}, expected its limits, {low:.6g} '
                        f"to {high:.6g}"
                    )
        for k in range(joint.idx_v, joint.idx_v + joint.nv):
            most, b = model.velocity_limit[k], int(fastest[:, k].argmax())
            if fastest[b, k] > most * (1.0 + ROUNDING):
                raise SpatialDynError(
                    f'path{which[b]} moves joint "{joint.name}" at {fastest[b, k]:.6g}, expected at most {most:.6g}, '
                    "its limit"
                )

"""The remaining rotation to a target, as a vector."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def turning(R: Array) -> Array:
    """Rotation vectors (..., 3) of rotations (..., 3, 3), with angles up to π."""
    R = np.asarray(R)
    if R.ndim == 2:
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R.tolist()
        x, y, z, cos = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy), 0.5 * (xx + yy + zz - 1.0)
        sin = math.sqrt(x * x + y * y + z * z)
        if cos > 0.0 or sin > 0.1:  # as below, faster
            by = math.atan2(sin, cos) / sin if sin > 0.0 else 1.0
            return np.array([by * x, by * y, by * z])
    odd = 0.5 * np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], -1)
    s, c = np.linalg.norm(odd, axis=-1), 0.5 * (np.trace(R, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(s, c)
    # near a half turn ``odd`` vanishes: u uᵀ = (R + Rᵀ - 2 c 1) / (2 - 2 c), of which the longest column is u
    even = 0.5 * (R + np.swapaxes(R, -1, -2)) - c[..., None, None] * np.eye(3)
    longest = np.argmax(np.diagonal(even, axis1=-2, axis2=-1), -1)
    u = np.take_along_axis(even, longest[..., None, None], -1)[..., 0]
    size = np.linalg.norm(u, axis=-1)
    u = u / np.where(size > 0.0, size, 1.0)[..., None]
    u = np.where((u * odd).sum(-1, keepdims=True) < 0.0, -u, u)
    close = s > 0.1
    ratio = np.where(close | (c > 0.0), angle / np.where(s > 0.0, s, 1.0), 0.0)
    ratio = np.where(s == 0.0, np.where(c > 0.0, 1.0, 0.0), ratio)
    found: Array = np.where(((~close) & (c < 0.0))[..., None], angle[..., None] * u, ratio[..., None] * odd)
    return found

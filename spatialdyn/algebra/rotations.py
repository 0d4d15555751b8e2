"""Rotation matrices of an axis and an angle, and of a quaternion; tolerances of rotations and unit vectors."""

from __future__ import annotations

from .euclidean import Mat3, Vec
from .scalars import Scalar, inline

NORM_TOLERANCE = 1e-6  # quaternions and (cos, sin) pairs are of unit norm within it, so that float32 input passes
UNIT_TOLERANCE = 2.0 * NORM_TOLERANCE  # the same of the squared norm
NORM_ROUNDING = 1e-12  # a squared norm that differs from 1 by less does so by rounding: exact formulas hold
ROTATION_ZERO = 1e-15  # entries of a rotation that are less are rounding errors of 0
UNIT_AXIS = 4e-16  # an axis whose norm is 1 within it is taken as it is


@inline
def turn(u: Vec, c: Scalar, s: Scalar) -> Mat3:
    """Rotation by the angle of cosine c and sine s about the unit vector u (Rodrigues)."""
    t = 1.0 - c
    x, y, z = u.x * s, u.y * s, u.z * s
    xy, xz, yz = u.x * u.y * t, u.x * u.z * t, u.y * u.z * t
    return Mat3(
        u.x * u.x * t + c, xy - z, xz + y,
        xy + z, u.y * u.y * t + c, yz - x,
        xz - y, yz + x, u.z * u.z * t + c,
    )  # fmt: skip


@inline
def blend(c: Scalar, A: Mat3, s: Scalar, B: Mat3) -> Mat3:
    """c A + s B."""
    return Mat3(
        c * A.xx + s * B.xx, c * A.xy + s * B.xy, c * A.xz + s * B.xz,
        c * A.yx + s * B.yx, c * A.yy + s * B.yy, c * A.yz + s * B.yz,
        c * A.zx + s * B.zx, c * A.zy + s * B.zy, c * A.zz + s * B.zz,
    )  # fmt: skip


@inline
def rotation(x: Scalar, y: Scalar, z: Scalar, w: Scalar) -> Mat3:
    """Rotation matrix of a quaternion, used as given: nothing is normalised."""
    x2, y2, z2 = x + x, y + y, z + z
    xx, xy, xz = x * x2, x * y2, x * z2
    yy, yz, zz = y * y2, y * z2, z * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    return Mat3(
        1.0 - (yy + zz), xy - wz, xz + wy,
        xy + wz, 1.0 - (xx + zz), yz - wx,
        xz - wy, yz + wx, 1.0 - (xx + yy),
    )  # fmt: skip

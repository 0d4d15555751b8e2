"""Roll, pitch and yaw: R = R_z(yaw) R_y(pitch) R_x(roll)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...errors import SpatialDynError
from ..native import operators
from .types.arguments import OMITTED, Array, array
from .types.frame import LOCAL, ReferenceFrame
from .types.value import on_values

__all__ = [
    "computeRpyJacobian", "computeRpyJacobianInverse", "computeRpyJacobianTimeDerivative", "matrixToRpy", "rotate",
    "rpyToMatrix",
]  # fmt: skip

matrixToRpy = on_values("matrixToRpy", operators.rpy_of_rotation,
    "vec", "Roll in ±π, pitch in ±π/2, yaw in ±π (3,) [rad] of a rotation matrix (3, 3).", R="rot")  # fmt: skip
_of_array = on_values("rpyToMatrix", operators.rotation_of_rpy, "rot", rpy="vec")
_of_angles = on_values("rpyToMatrix", operators.rotation_of_angles, "rot", roll="number", pitch="number", yaw="number")


def rpyToMatrix(roll: Any, pitch: Any = OMITTED, yaw: Any = OMITTED) -> Array:
    """The rotation matrix (3, 3) of three angles, or of one array (3,) of them [rad]."""
    if pitch is OMITTED and yaw is OMITTED:
        return _of_array(roll)  # type: ignore[no-any-return]
    return _of_angles(roll, pitch, yaw)  # type: ignore[no-any-return]


def rotate(axis: str, angle: float) -> Array:
    """The rotation (3, 3) by an angle [rad] about an axis, "x", "y" or "z"."""
    if axis == "x":
        return _of_angles(angle, 0.0, 0.0)  # type: ignore[no-any-return]
    if axis == "y":
        return _of_angles(0.0, angle, 0.0)  # type: ignore[no-any-return]
    if axis == "z":
        return _of_angles(0.0, 0.0, angle)  # type: ignore[no-any-return]
    raise SpatialDynError(f'axis is {axis!r}, expected "x", "y" or "z"')


def computeRpyJacobian(rpy: Any, reference_frame: ReferenceFrame = LOCAL) -> Array:
    """The matrix (3, 3) from the angles' rates to the angular velocity, in the body's (LOCAL) or the world's axes."""
    sr, cr, sp, cp, sy, cy = _trigonometry(rpy)
    if reference_frame == LOCAL:
        return np.array([[1.0, 0.0, -sp], [0.0, cr, sr * cp], [0.0, -sr, cr * cp]])
    return np.array([[cy * cp, -sy, 0.0], [sy * cp, cy, 0.0], [-sp, 0.0, 1.0]])


def computeRpyJacobianInverse(rpy: Any, reference_frame: ReferenceFrame = LOCAL) -> Array:
    """The inverse (3, 3) of ``computeRpyJacobian``, which is singular at a pitch of ±π/2."""
    sr, cr, sp, cp, sy, cy = _trigonometry(rpy)
    tp = sp / cp
    if reference_frame == LOCAL:
        return np.array([[1.0, sr * tp, cr * tp], [0.0, cr, -sr], [0.0, sr / cp, cr / cp]])
    return np.array([[cy / cp, sy / cp, 0.0], [-sy, cy, 0.0], [cy * tp, sy * tp, 1.0]])


def computeRpyJacobianTimeDerivative(rpy: Any, rpydot: Any, reference_frame: ReferenceFrame = LOCAL) -> Array:
    """Time derivative (3, 3) of ``computeRpyJacobian`` at these rates (3,) of the angles."""
    sr, cr, sp, cp, sy, cy = _trigonometry(rpy)
    dr, dp, dy = array(rpydot, (3,), "rpydot").tolist()
    if reference_frame == LOCAL:
        sr_cp, cr_cp = cr * cp * dr - sr * sp * dp, -sr * cp * dr - cr * sp * dp  # their rates
        return np.array([[0.0, 0.0, -cp * dp], [0.0, -sr * dr, sr_cp], [0.0, -cr * dr, cr_cp]])
    cy_cp, sy_cp = -sy * cp * dy - cy * sp * dp, cy * cp * dy - sy * sp * dp
    return np.array([[cy_cp, -cy * dy, 0.0], [sy_cp, -sy * dy, 0.0], [-cp * dp, 0.0, 0.0]])


def _trigonometry(rpy: Any) -> tuple[float, ...]:
    """Sine and cosine of each angle."""
    return tuple(f(x) for x in array(rpy, (3,), "rpy").tolist() for f in (math.sin, math.cos))

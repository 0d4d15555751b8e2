"""Exponential and logarithm of rotations and displacements, their derivatives, and displacements as seven numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import ShapeError, SpatialDynError
from ..native import operator_kernels
from .types.arguments import ArgumentError, array, described, expected
from .types.motion import Motion
from .types.rotations import Quaternion
from .types.se3 import SE3

__all__ = [
    "Hlog3", "Jexp3", "Jexp6", "Jlog3", "Jlog6", "SE3ToXYZQUAT", "SE3ToXYZQUATtuple", "XYZQUATToSE3",
    "classicAcceleration", "exp", "exp3", "exp3_quat", "exp6", "exp6_quat", "log", "log3", "log6", "log6_quat",
]  # fmt: skip

Array = NDArray[np.float64]


def exp(x: Any) -> Any:
    """``exp6`` of a Motion or an array (6,), ``exp3`` of an array (3,), the exponential of a number."""
    if isinstance(x, Motion):
        return exp6(x)
    if np.isscalar(x):
        return math.exp(x)  # type: ignore[arg-type]
    if isinstance(x, np.ndarray) and x.shape in ((6,), (6, 1)):
        return exp6(x)
    if isinstance(x, np.ndarray) and x.shape in ((3,), (3, 1)):
        return exp3(x)
    raise SpatialDynError(f"x is {described(x)}, expected a number, an array of shape (3,) or (6,), or a Motion")


def log(x: Any) -> Any:
    """``log6`` of an SE3 or an array (4, 4), ``log3`` of an array (3, 3), the logarithm of a number."""
    if isinstance(x, SE3):
        return log6(x)
    if np.isscalar(x):
        return math.log(x)  # type: ignore[arg-type]
    if isinstance(x, np.ndarray) and x.shape == (4, 4):
        return log6(x)
    if isinstance(x, np.ndarray) and x.shape == (3, 3):
        return log3(x)
    raise SpatialDynError(f"x is {described(x)}, expected a number, an array of shape (3, 3) or (4, 4), or an SE3")


# --- rotations -------------------------------------------------------------------------------------------


def exp3(w: Any) -> Array:
    """The rotation (3, 3) by |w| about w (3,) [rad]."""
    out = np.empty((3, 3))
    operator_kernels.exp3(array(w, (3,), "w"), out)
    return out


def exp3_quat(w: Any) -> Array:
    """The quaternion x y z w (4,) of the rotation by |w| about w (3,) [rad]."""
    out = np.empty(4)
    operator_kernels.exp3_quat(array(w, (3,), "w"), out)
    return out


def log3(R: Any, theta: Array | None = None) -> Array:
    """The rotation vector (3,) [rad], of length up to π, of a rotation (3, 3), a Quaternion, or x y z w (4,).

    theta  (1,)  written in place if given: its length
    """
    out = np.empty(3)
    if isinstance(R, Quaternion) and theta is None:
        operator_kernels.log3_quat(R._x, out)
    elif isinstance(R, np.ndarray) and R.shape in ((4,), (4, 1)):
        operator_kernels.log3_quat(array(R, (4,), "quat"), out)
    else:
        operator_kernels.log3(array(R, (3, 3), "R"), out)
    if theta is not None:
        if not isinstance(theta, np.ndarray) or theta.size != 1:
            raise ArgumentError(f"theta is {described(theta)}, expected an array of shape (1,)")
        theta[...] = math.hypot(*out)
    return out


def Jexp3(w: Any) -> Array:
    """The right Jacobian J (3, 3): exp(w + δ) = exp(w) exp(J δ) to first order."""
    out = np.empty((3, 3))
    operator_kernels.exp3_jacobian(array(w, (3,), "w"), out)
    return out


def Jlog3(R: Any) -> Array:
    """The matrix J (3, 3) with log(R exp(δ)) = log R + J δ to first order."""
    out = np.empty((3, 3))
    operator_kernels.log3_jacobian(array(R, (3, 3), "R"), out)
    return out


def Hlog3(R: Any, v: Any) -> Array:
    """The derivative (3, 3) of ``Jlog3(R exp(s v))`` by s, at s = 0."""
    out = np.empty((3, 3))
    operator_kernels.log3_jacobian_derivative(array(R, (3, 3), "R"), array(v, (3,), "v"), out)
    return out


# --- displacements ---------------------------------------------------------------------------------------


def _twist(v: Any) -> Array:
    return v._x if isinstance(v, Motion) else array(v, (6,), "v")


def _pose(M: Any) -> Array:
    return M._x if isinstance(M, SE3) else array(M, (4, 4), "M")


def exp6(v: Any) -> SE3:
    """The exponential of a Motion or an array (6,): the pose reached at this body velocity in unit time."""
    out = np.empty((4, 4))
    operator_kernels.exp6(_twist(v), out)
    return SE3.over(out)


def exp6_quat(v: Any) -> Array:
    """``exp6`` of an array (6,) as x y z and quaternion x y z w (7,)."""
    out = np.empty(7)
    operator_kernels.exp6_xyzquat(array(v, (6,), "v"), out)
    return out


def log6(M: Any) -> Motion:
    """The logarithm of an SE3 or an array (4, 4): the Motion with exp6(v) = M and a rotation up to π."""
    out = np.empty(6)
    operator_kernels.log6(_pose(M), out)
    return Motion.over(out)


def log6_quat(q: Any) -> Motion:
    """``log6`` of x y z and quaternion x y z w (7,)."""
    out = np.empty(6)
    operator_kernels.log6_xyzquat(array(q, (7,), "q"), out)
    return Motion.over(out)


def Jexp6(v: Any) -> Array:
    """The right Jacobian J (6, 6): exp(v + δ) = exp(v) exp(J δ) to first order; v a Motion or an array (6,)."""
    out = np.empty((6, 6))
    operator_kernels.exp6_jacobian(_twist(v), out)
    return out


def Jlog6(M: Any) -> Array:
    """The matrix J (6, 6) with log(M exp(δ)) = log M + J δ to first order; M an SE3."""
    out = np.empty((6, 6))
    operator_kernels.log6_jacobian(expected(M, SE3, "M")._x, out)
    return out


# --- seven numbers ---------------------------------------------------------------------------------------


def SE3ToXYZQUAT(M: SE3) -> Array:
    """Translation x y z and quaternion x y z w (7,) of an SE3."""
    out = np.empty(7)
    operator_kernels.to_xyzquat(expected(M, SE3, "M")._x, out)
    return out


def SE3ToXYZQUATtuple(M: SE3) -> tuple[float, ...]:
    """``SE3ToXYZQUAT`` as a tuple."""
    return tuple(SE3ToXYZQUAT(M).tolist())


def XYZQUATToSE3(x: Any) -> SE3:
    """The SE3 of translation x y z and quaternion x y z w: an array (7,), a list or a tuple."""
    if not isinstance(x, (np.ndarray, list, tuple)):
        raise ArgumentError(f"x is {described(x)}, expected seven numbers")
    given = np.array(x, dtype=float).ravel()
    if given.shape != (7,):
        raise ShapeError(f"x has {given.size} numbers, expected 7")
    out = np.empty((4, 4))
    operator_kernels.from_xyzquat(given, out)
    return SE3.over(out)


def classicAcceleration(spatial_velocity: Motion, spatial_acceleration: Motion, placement: SE3 | None = None) -> Array:
    """Classical acceleration (3,) of the frame's origin [m/s²], in its axes: the linear part plus ω × v.

    placement   pose of the frame in that of the two Motions, the same frame by default
    """
    v = expected(spatial_velocity, Motion, "spatial_velocity")
    a = expected(spatial_acceleration, Motion, "spatial_acceleration")
    if placement is not None:
        v, a = placement.actInv(v), placement.actInv(a)
    made: Array = a._x[:3] + np.cross(v._x[3:], v._x[:3])
    return made

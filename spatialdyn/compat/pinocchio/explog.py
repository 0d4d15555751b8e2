"""Exponential and logarithm of rotations and displacements, their derivatives, and displacements as seven numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...algebra import lie
from ..native import operators
from .types.arguments import OMITTED, ArgumentError, Array, SizeError, array, described, expected, number, of_pinocchio
from .types.motion import Motion
from .types.rotations import Quaternion
from .types.se3 import SE3
from .types.value import on_values

__all__ = [
    "Hlog3", "Jexp3", "Jexp6", "Jlog3", "Jlog6", "SE3ToXYZQUAT", "SE3ToXYZQUATtuple", "XYZQUATToSE3",
    "classicAcceleration", "exp", "exp3", "exp3_quat", "exp6", "exp6_quat", "log", "log3", "log6", "log6_quat",
]  # fmt: skip

NUMBER = int, float, complex, np.number, np.bool_

exp3 = on_values("exp3", operators.exp_matrix, "rot", "The rotation (3, 3) by |w| about w (3,) [rad].", w="vec")
exp3_quat = on_values("exp3_quat", lie.exp_rotation, "quat",
    "The quaternion x y z w (4,) of the rotation by |w| about w (3,) [rad].", w="vec")  # fmt: skip
Jexp3 = on_values("Jexp3", operators.exp_matrix_jacobian, "rot",
    "The right Jacobian J (3, 3): exp(w + δ) = exp(w) exp(J δ) to first order.", w="vec")  # fmt: skip
Jlog3 = on_values("Jlog3", operators.log_matrix_jacobian, "rot",
    "The matrix J (3, 3) with log(R exp(δ)) = log R + J δ to first order.", R="rot")  # fmt: skip
Hlog3 = on_values("Hlog3", operators.log_matrix_jacobian_derivative, "rot",
    "The derivative (3, 3) of ``Jlog3(R exp(s v))`` by s, at s = 0.", R="rot", v="vec")  # fmt: skip
exp6 = on_values(
    "exp6", operators.exp_pose, "Pose",
    "The exponential of a Motion or an array (6,): the pose reached at this body velocity in unit time, an SE3.",
    v="Motion|motion",
)  # fmt: skip
exp6_quat = on_values(
    "exp6_quat", operators.exp_seven, "seven",
    "``exp6`` of an array (6,) as x y z and quaternion x y z w (7,).",
    v="motion",
)  # fmt: skip
log6 = on_values(
    "log6", operators.log_pose, "Motion",
    "The logarithm of an SE3 or an array (4, 4): the Motion with exp6(v) = M and a rotation up to π.",
    M="Pose|pose",
)  # fmt: skip
log6_quat = on_values("log6_quat", operators.log_seven,
    "Motion", "``log6`` of x y z and quaternion x y z w (7,).", q="seven")  # fmt: skip
Jexp6 = on_values(
    "Jexp6", lie.exp_jacobian, "tangent",
    "The right Jacobian J (6, 6): exp(v + δ) = exp(v) exp(J δ) to first order; v a Motion or an array (6,).",
    v="Motion|motion",
)  # fmt: skip
Jlog6 = on_values("Jlog6", operators.log_pose_jacobian, "tangent",
    "The matrix J (6, 6) with log(M exp(δ)) = log M + J δ to first order; M an SE3.", M="Pose")  # fmt: skip
SE3ToXYZQUAT = on_values("SE3ToXYZQUAT", operators.seven_of_pose, "seven",
    "Translation x y z and quaternion x y z w (7,) of an SE3.", M="Pose")  # fmt: skip
_log_of_matrix = on_values("log3", operators.log_matrix, "vec", R="rot")
_log_of_quaternion = on_values("log3", lie.log_rotation, "vec", quat="Quat|quat")
_pose_of_seven = on_values("XYZQUATToSE3", operators.pose_of_seven, "Pose", x="seven")


def exp(x: Any) -> Any:
    """``exp6`` of a Motion or an array (6,), ``exp3`` of an array (3,), the exponential of a number."""
    kinds = {Motion: exp6, (6,): exp6, (6, 1): exp6, (3,): exp3, (3, 1): exp3, float: math.exp}
    return _by_kind(x, kinds, Motion, "shape (3,) or (6,), or a Motion")


def log(x: Any) -> Any:
    """``log6`` of an SE3 or an array (4, 4), ``log3`` of an array (3, 3), the logarithm of a number."""
    kinds = {SE3: log6, (4, 4): log6, (3, 3): log3, float: math.log}
    return _by_kind(x, kinds, SE3, "shape (3, 3) or (4, 4), or an SE3")


def _by_kind(x: Any, kinds: dict[Any, Any], value: type, arrays: str) -> Any:
    kind = value if isinstance(x, value) else float if isinstance(x, NUMBER) else getattr(x, "shape", None)
    if kind not in kinds:
        raise ArgumentError(f"x is {described(x)}, expected a number, an array of {arrays}")
    return kinds[kind](x)


def log3(R: Any, theta: Array = OMITTED) -> Array:
    """The rotation vector (3,) [rad], of length up to π, of a rotation (3, 3), a Quaternion, or x y z w (4,).

    theta  (1,)  written in place if given: its length
    """
    if isinstance(R, np.ndarray):
        four = R.shape in ((4,), (4, 1))
    else:
        R = Quaternion(R) if of_pinocchio(R, "Quaternion") else R
        four = isinstance(R, Quaternion) and theta is OMITTED
    out: Array = (_log_of_quaternion if four else _log_of_matrix)(R)
    if theta is not OMITTED:
        if not isinstance(theta, np.ndarray) or theta.size != 1:
            raise ArgumentError(f"theta is {described(theta)}, expected an array of shape (1,)")
        theta[...] = math.hypot(*out)
    return out


def SE3ToXYZQUATtuple(M: SE3) -> tuple[float, ...]:
    """``SE3ToXYZQUAT`` as a tuple."""
    return tuple(SE3ToXYZQUAT(M).tolist())


def XYZQUATToSE3(x: Any) -> SE3:
    """The SE3 of translation x y z and quaternion x y z w: an array (7,), a list or a tuple."""
    if isinstance(x, (list, tuple)):
        if len(x) != 7:
            raise SizeError(f"x has {len(x)} numbers, expected 7")
        x = np.array([number(each, f"x[{k}]") for k, each in enumerate(x)])
    return _pose_of_seven(array(x, (7,), "x"))  # type: ignore[no-any-return]


def classicAcceleration(spatial_velocity: Motion, spatial_acceleration: Motion, placement: SE3 = OMITTED) -> Array:
    """Classical acceleration (3,) of the frame's origin [m/s²], in its axes: the linear part plus ω × v.

    placement   pose of the frame in that of the two Motions, the same frame by default
    """
    v = expected(spatial_velocity, Motion, "spatial_velocity")
    a = expected(spatial_acceleration, Motion, "spatial_acceleration")
    if placement is not OMITTED:
        expected(placement, SE3, "placement")
        v, a = placement.actInv(v), placement.actInv(a)
    made: Array = a._x[:3] + np.cross(v._x[3:], v._x[:3])
    return made

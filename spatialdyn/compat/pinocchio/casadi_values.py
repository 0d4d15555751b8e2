"""SE3, Motion and Force of expressions of CasADi, and their exponentials and logarithms: for ``pinocchio.casadi``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from ...algebra import lie
from ...algebra.euclidean import Mat3, Vec
from ...algebra.rotations import rotation
from ...algebra.spatial import Motion as Twist
from ...algebra.spatial import Pose
from ...engines.programs.record.program import Program
from ...engines.programs.record.tracer import Tape
from ...errors import ShapeError
from ...interop.casadi import walk
from ...interop.frameworks import framework
from ..native import operators
from .types.arguments import ArgumentError, described
from .types.se3 import SE3 as Placement


def matrix(x: Any) -> Any:
    """Numbers or an expression as a matrix of CasADi."""
    casadi = framework("casadi")
    return x if isinstance(x, (casadi.SX, casadi.MX, casadi.DM)) else casadi.DM(np.asarray(x, float))


def _column(x: Any, size: int, what: str) -> Any:
    x = matrix(x)
    if x.numel() != size:
        raise ShapeError(f"{what} has shape {x.shape}, expected ({size},)")
    return framework("casadi").reshape(x, size, 1)


def skew(x: Any) -> Any:
    """The matrix of x ×."""
    return framework("casadi").skew(matrix(x))


class Placed:
    """Base of what a pose moves, an SE3 of numbers too."""

    @staticmethod
    def _to_parent(placement: Any, x: Any) -> Any:
        return SE3(placement).act(x)

    @staticmethod
    def _to_child(placement: Any, x: Any) -> Any:
        return SE3(placement).actInv(x)


class Moved(Placed):
    """A Motion or Force: ``(vector (6,))``, ``(linear, angular)``, or none of them for zero."""

    def __init__(self, *given: Any) -> None:
        casadi = framework("casadi")
        if len(given) > 2:
            raise ArgumentError(f"{type(self).__name__} got {len(given)} arguments, expected up to 2")
        if len(given) == 2:
            self.vector = casadi.vertcat(_column(given[0], 3, "linear"), _column(given[1], 3, "angular"))
        else:
            x = given[0] if given else np.zeros(6)
            self.vector = _column(getattr(x, "vector", x), 6, "vector")

    linear = property(lambda self: self.vector[:3], doc="The linear part (3,).")
    angular = property(lambda self: self.vector[3:], doc="The angular part (3,).")
    np = property(lambda self: self.vector, doc="``vector``.")

    @classmethod
    def Zero(cls) -> Any:
        """Zero."""
        return cls()

    def __add__(self, other: Any) -> Any:
        return type(self)(self.vector + type(self)(other).vector)

    def __sub__(self, other: Any) -> Any:
        return type(self)(self.vector - type(self)(other).vector)

    def __neg__(self) -> Any:
        return type(self)(-self.vector)

    def __mul__(self, scale: Any) -> Any:
        return type(self)(self.vector * scale)

    __radd__ = __add__

    def __rmul__(self, other: Any) -> Any:
        return self._to_parent(other, self) if isinstance(other, Placement) else self * other


class Motion(Moved):
    """Linear and angular velocity or acceleration, as expressions."""


class Force(Moved):
    """Force and moment, as expressions."""


class SE3(Placed):
    """A pose: ``(rotation (3, 3), translation (3,))``, ``(homogeneous (4, 4))``, an SE3 of either kind, or none."""

    def __init__(self, *given: Any) -> None:
        casadi = framework("casadi")
        if len(given) > 2:
            raise ArgumentError(f"SE3 got {len(given)} arguments, expected up to 2")
        if len(given) == 2:
            self.rotation, self.translation = matrix(given[0]), _column(given[1], 3, "translation")
        else:
            x = given[0] if given else np.eye(4)
            x = matrix(getattr(x, "homogeneous", x))
            if x.shape != (4, 4):
                raise ShapeError(f"homogeneous matrix has shape {x.shape}, expected (4, 4)")
            self.rotation, self.translation = x[:3, :3], x[:3, 3]
        self._last = casadi.DM([[0.0, 0.0, 0.0, 1.0]])

    @classmethod
    def Identity(cls) -> SE3:
        """The identity."""
        return cls()

    @property
    def homogeneous(self) -> Any:
        """The homogeneous matrix (4, 4)."""
        casadi = framework("casadi")
        return casadi.vertcat(casadi.horzcat(self.rotation, self.translation), self._last)

    np = homogeneous

    def inverse(self) -> SE3:
        """The inverse."""
        return SE3(self.rotation.T, -self.rotation.T @ self.translation)

    def act(self, other: Any) -> Any:
        """A point (3,), Motion, Force or SE3 from the frame to the reference frame."""
        R, p = self.rotation, self.translation
        if isinstance(other, (SE3, Placement)):
            other = SE3(other)
            return SE3(R @ other.rotation, R @ other.translation + p)
        if isinstance(other, Motion):
            angular = R @ other.angular
            return Motion(R @ other.linear + framework("casadi").cross(p, angular), angular)
        if isinstance(other, Force):
            linear = R @ other.linear
            return Force(linear, R @ other.angular + framework("casadi").cross(p, linear))
        return R @ _column(other, 3, "point") + p

    def actInv(self, other: Any) -> Any:
        """The same from the reference frame to the frame."""
        return self.inverse().act(other)

    __mul__ = act

    def __rmul__(self, other: Any) -> Any:
        return SE3(other).act(self)

    def toActionMatrix(self) -> Any:
        """The matrix (6, 6) that takes Motion vectors from the frame to the reference frame."""
        casadi, R = framework("casadi"), self.rotation
        return casadi.vertcat(casadi.horzcat(R, skew(self.translation) @ R), casadi.horzcat(casadi.DM.zeros(3, 3), R))

    action = property(toActionMatrix, doc="``toActionMatrix``.")


# --- exponential and logarithm -----------------------------------------------------------------------------


@cache
def _operator(name: str) -> Any:
    """A function of CasADi from one of the operators below; matrices are taken and given row by row."""
    casadi, (size, formula) = framework("casadi"), OPERATORS[name]
    tape, x = Tape(), casadi.SX.sym("x", size)
    found = formula([tape.input(k) for k in range(size)])
    lines = walk(casadi, Program(tape, found, size), [x[k] for k in range(size)])
    return casadi.Function(name, [x], [casadi.vertcat(*lines)])


def _pose(X: Pose) -> list[Any]:
    return [*X.R, *X.p]


def _linear_first(m: Twist) -> list[Any]:
    return [*m.v, *m.w]


def _seven(x: Sequence[Any]) -> tuple[Vec, lie.Quat]:
    return Vec(*x[:3]), lie.Quat(*x[3:])


def _log_seven(x: Sequence[Any]) -> list[Any]:
    p, q = _seven(x)
    return _linear_first(operators.log_placed(p, lie.log_rotation(q)))


OPERATORS: dict[str, tuple[int, Callable[[Sequence[Any]], Any]]] = {
    "exp3": (3, lambda x: [*rotation(*lie.exp_rotation(Vec(*x)))]),
    "exp3_quat": (3, lambda x: [*lie.exp_rotation(Vec(*x))]),
    "log3": (9, lambda x: [*operators.log_matrix(Mat3(*x))]),
    "log3_of_quaternion": (4, lambda x: [*lie.log_rotation(lie.Quat(*x))]),
    "exp6": (6, lambda x: _pose(operators.exp_pose(Twist(Vec(*x[3:]), Vec(*x[:3]))))),
    "log6": (12, lambda x: _linear_first(operators.log_pose(Pose(Mat3(*x[:9]), Vec(*x[9:]))))),
    "log6_quat": (7, _log_seven),
}


def _by_rows(x: Any) -> Any:
    return framework("casadi").reshape(matrix(x).T, -1, 1)


def exp3(v: Any) -> Any:
    """The rotation (3, 3) by |v| about v (3,) [rad]."""
    return framework("casadi").reshape(_operator("exp3")(_column(v, 3, "v")), 3, 3).T


def exp3_quat(v: Any) -> Any:
    """The quaternion x y z w (4,) of the rotation by |v| about v (3,) [rad]."""
    return _operator("exp3_quat")(_column(v, 3, "v"))


def log3(R: Any) -> Any:
    """The rotation vector (3,) [rad], of length up to π, of a rotation (3, 3) or a quaternion x y z w (4,)."""
    R = matrix(R)
    return _operator("log3_of_quaternion")(_column(R, 4, "quat")) if R.numel() == 4 else _operator("log3")(_by_rows(R))


def exp6(v: Any) -> SE3:
    """The pose reached at a body velocity, a Motion or an array (6,), in unit time."""
    x = _operator("exp6")(Motion(v).vector)
    return SE3(framework("casadi").reshape(x[:9], 3, 3).T, x[9:])


def log6(M: Any) -> Motion:
    """The Motion with exp6(v) = M of an SE3 or a matrix (4, 4)."""
    M = SE3(M)
    return Motion(_operator("log6")(framework("casadi").vertcat(_by_rows(M.rotation), M.translation)))


def log6_quat(q: Any) -> Motion:
    """``log6`` of x y z and quaternion x y z w (7,)."""
    if matrix(q).numel() != 7:
        raise ArgumentError(f"q is {described(q)}, expected seven numbers")
    return Motion(_operator("log6_quat")(_column(q, 7, "q")))

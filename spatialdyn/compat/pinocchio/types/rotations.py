"""Quaternion and AngleAxis, and the matrices of cross products."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ....algebra import lie
from ....algebra.euclidean import Vec, cross
from ....algebra.scalars import EPS
from ....errors import SpatialDynError
from ...native import operators
from .arguments import ArgumentError, Array, ValueRuntimeError, array, described, expected, number, of_pinocchio, row
from .value import Value, on_values, own_value, part, preset

__all__ = ["AngleAxis", "Quaternion", "XAxis", "YAxis", "ZAxis", "skew", "skewSquare", "unSkew"]

OPPOSITE = 1e-12  # directions with a cosine this near -1 define no plane
XAxis, YAxis, ZAxis = (np.array([float(i == k) for i in range(3)]) for k in range(3))

skew = on_values("skew", operators.skew, "rot", "The matrix (3, 3) of u × for u (3,).", u="vec")
unSkew = on_values("unSkew", operators.unskew,
    "vec", "The vector u (3,) whose ``skew`` is the antisymmetric part of a matrix (3, 3).", U="rot")  # fmt: skip
skewSquare = on_values("skewSquare", operators.skew_product, "rot",
    "The matrix (3, 3) of u × (v × ·) for u, v (3,).", u="vec", v="vec")  # fmt: skip
_of_matrix = on_values("coefficients", operators.quaternion_of_matrix, "quat", rotation="rot")


class Rotation(Value):
    """Base of Quaternion and AngleAxis: each has a ``matrix()`` and rotates vectors."""

    def _transformVector(self, vector: Any) -> Array:
        """The rotated vector (3,)."""
        turned: Array = self.matrix() @ array(vector, (3,), "vector")  # type: ignore[attr-defined]
        return turned

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray) and other.shape in ((3,), (3, 1)):
            return self._transformVector(other)
        if not isinstance(other, Rotation):
            mine = own_value(other)
            return self._product(mine) if isinstance(mine, Rotation) else NotImplemented
        return self._product(other)

    def _product(self, other: Rotation) -> Any:
        return _product(Quaternion(self), Quaternion(other))

    def id(self) -> int:
        """The identity of this object."""
        return id(self)


class Quaternion(Rotation, kind="Quat"):
    """A quaternion: ``Quaternion(w, x, y, z)``, ``Quaternion(coefficients x y z w (4,))``,
    ``Quaternion(rotation (3, 3))``, ``Quaternion(angle_axis)``, ``Quaternion(u, v)`` that rotates u
    to v, ``Quaternion(other)``.

    ``q * p`` is the rotation p followed by q, ``q * x`` rotates a vector (3,). ``Quaternion()`` is the identity.
    """

    _arguments = ("_x",)

    def __init__(self, *arguments: Any, **named: Any) -> None:
        if named:
            arguments = (*arguments, *(named[key] for key in ("w", "x", "y", "z") if key in named)) or (None,)
            if len(arguments) != 4:
                arguments = tuple(named.values())
        if len(arguments) == 1:
            self._x = _coefficients(arguments[0])
        elif len(arguments) == 4:
            w, x, y, z = (number(a, "coefficient") for a in arguments)
            self._x = np.array([x, y, z, w])
        elif len(arguments) in (0, 2):
            self._x = np.array([0.0, 0.0, 0.0, 1.0])
            if arguments:
                self.setFromTwoVectors(*arguments)
        else:
            raise ArgumentError(f"Quaternion got {len(arguments)} arguments, expected 0, 1, 2 or 4")

    Identity, _ = preset(lambda: (0.0, 0.0, 0.0, 1.0), "the identity rotation")

    def setIdentity(self) -> Quaternion:
        """Set it to the identity; returns self."""
        return self._write((0.0, 0.0, 0.0, 1.0))

    @staticmethod
    def FromTwoVectors(a: Any, b: Any) -> Quaternion:
        """The shortest rotation from direction a (3,) to b (3,)."""
        return Quaternion().setFromTwoVectors(a, b)

    def setFromTwoVectors(self, a: Any, b: Any) -> Quaternion:
        """Set it to the shortest rotation from direction a (3,) to b (3,); returns self."""
        a, b = array(a, (3,), "a"), array(b, (3,), "b")
        a, b = _direction(a, "a"), _direction(b, "b")
        c = float(a @ b)
        if c < OPPOSITE - 1.0:  # half a turn about any normal
            axis, w = np.array(cross(Vec(*a), Vec(*np.eye(3)[np.argmin(abs(a))]))), 0.5 * (1.0 + max(c, -1.0))
            return self._write([*(math.sqrt(1.0 - w) / math.hypot(*axis) * axis), math.sqrt(w)])
        s = math.sqrt(2.0 * (1.0 + c))
        return self._write([*(np.array(cross(Vec(*a), Vec(*b))) / s), 0.5 * s])

    x, y, z, w = (part("coefficient", k, f"The {'xyzw'[k]} coefficient.") for k in range(4))

    def __getitem__(self, k: int) -> float:
        return float(self._x[self._index(k)])

    def __setitem__(self, k: int, value: float) -> None:
        setattr(self, "xyzw"[self._index(k)], value)

    def _index(self, k: int) -> int:
        if not 0 <= k <= 3:
            raise ValueRuntimeError(f"index is {k}, expected 0 to 3")
        return k

    def coeffs(self) -> Array:
        """The coefficients x y z w (4,), a view that is read-only."""
        x = self._x.view()
        x.flags.writeable = False
        return x

    def vec(self) -> Array:
        """The coefficients x y z (3,), a copy."""
        return self._x[:3].copy()

    matrix = on_values("matrix", lie.matrix, "rot",
        "The rotation matrix (3, 3); a rotation only if the norm is 1.", self="Quat")  # fmt: skip
    conjugate = on_values("conjugate", lie.conjugate,
        "Quat", "The conjugate: the inverse rotation, of the same norm.", self="Quat")  # fmt: skip
    dot = on_values("dot", operators.dot_quats, "number", "Dot product of the coefficients.", self="Quat", other="Quat")
    toRotationMatrix = matrix

    def squaredNorm(self) -> float:
        """Squared norm."""
        return self.dot(self)  # type: ignore[no-any-return]

    def norm(self) -> float:
        """Euclidean norm."""
        return math.sqrt(self.dot(self))

    __abs__ = norm

    def _product(self, other: Rotation) -> Any:
        return _product(self, other) if isinstance(other, Quaternion) else NotImplemented

    def __imul__(self, other: Any) -> Any:
        product = self * other
        if not isinstance(product, Quaternion):  # a vector would take the name of the quaternion
            raise ArgumentError(f"other is {described(other)}, expected Quaternion")
        return self._write(product._x)

    def inverse(self) -> Quaternion:
        """The inverse quaternion; zero for zero."""
        return Quaternion.over(self.conjugate()._x / (self.squaredNorm() or 1.0))

    def normalize(self) -> Quaternion:
        """Set its norm to 1; returns self."""
        return self._write(self.normalized()._x)

    def normalized(self) -> Quaternion:
        """The quaternion divided by its norm."""
        return Quaternion.over(self._x / (self.norm() or 1.0))

    def angularDistance(self, other: Quaternion) -> float:
        """Angle between two rotations [rad]."""
        *v, w = (self * expected(other, Quaternion, "other").conjugate())._x.tolist()
        return 2.0 * math.atan2(math.hypot(*v), abs(w))

    def slerp(self, t: float, other: Quaternion) -> Quaternion:
        """Spherical interpolation from this rotation (t = 0) to the other (t = 1) by the shorter way."""
        d = self.dot(other)
        if abs(d) >= 1.0 - EPS:
            a, b = 1.0 - t, t
        else:
            angle = math.acos(abs(d))
            a, b = math.sin((1.0 - t) * angle) / math.sin(angle), math.sin(t * angle) / math.sin(angle)
        return Quaternion.over(a * self._x + (b if d >= 0.0 else -b) * other._x)

    def assign(self, other: Any) -> Quaternion:
        """Set it to a Quaternion or AngleAxis; returns self."""
        if not isinstance(other, Rotation):
            raise ArgumentError(f"other is {described(other)}, expected Quaternion or AngleAxis")
        return self._write(_coefficients(other))

    def __repr__(self) -> str:
        return f"(x,y,z,w) = {row(self._x)}\n"


_product = on_values("__mul__", lie.product, "Quat", self="Quat", other="Quat")


class AngleAxis(Rotation):
    """A rotation by an angle [rad] about a unit axis: ``AngleAxis(angle, axis (3,))``, ``AngleAxis(rotation (3, 3))``,
    ``AngleAxis(quaternion)``, ``AngleAxis(other)``.

    Products are Quaternions; ``a * x`` rotates a vector (3,). ``AngleAxis()`` is the rotation by 0 about x.
    """

    _arguments = ("angle", "axis")
    _compared = (np.s_[:1], np.s_[1:])
    angle = part("angle", 0, "The angle [rad].")
    axis = part("axis", np.s_[1:], "The axis (3,), a view.")

    def __init__(self, *arguments: Any, **named: Any) -> None:
        arguments = (*arguments, *named.values())
        self._x = np.array([0.0, 1.0, 0.0, 0.0])
        if len(arguments) == 2:
            self.angle, self.axis = arguments
        elif len(arguments) == 1:
            one = arguments[0]
            if of_pinocchio(one, "AngleAxis"):
                self.angle, self.axis = one.angle, np.array(one.axis)
            else:
                self._x[:] = one._x if isinstance(one, AngleAxis) else _angle_axis(_coefficients(one, (3, 3)))
        elif arguments:
            raise ArgumentError(f"AngleAxis got {len(arguments)} arguments, expected 0, 1 or 2")

    def matrix(self) -> Array:
        """The rotation matrix (3, 3); a rotation only if the axis has norm 1."""
        s, c, a = math.sin(self.angle), math.cos(self.angle), self._x[1:]
        turned: Array = c * np.eye(3) + s * skew(a) + np.outer((1.0 - c) * a, a)
        return turned

    toRotationMatrix = matrix

    def fromRotationMatrix(self, R: Any) -> AngleAxis:
        """Set it to the rotation of a matrix (3, 3); returns self."""
        return self._write(_angle_axis(_of_matrix(R)))

    def inverse(self) -> AngleAxis:
        """The inverse rotation."""
        return AngleAxis.over(self._x * (-1.0, 1.0, 1.0, 1.0))

    def __repr__(self) -> str:
        return f"angle: {self.angle:g}\naxis: {row(self._x[1:])}\n"


def _coefficients(x: Any, *shapes: tuple[int, ...]) -> Any:
    """New coefficients x y z w of a rotation in any form; arrays may have these shapes, by default (3, 3) and (4,)."""
    if isinstance(x, np.ndarray):
        if x.ndim == 2 and (shapes or x.shape != (4, 1)):
            return _of_matrix(x)
        return array(x, (3, 3) if shapes else (4,), "rotation")
    if isinstance(x, Quaternion):
        return x._x.copy()
    if of_pinocchio(x, "Quaternion"):
        return np.array(x.coeffs(), float)
    if of_pinocchio(x, "AngleAxis"):
        x = AngleAxis(x)
    if isinstance(x, AngleAxis):
        return np.array([*(math.sin(0.5 * x.angle) * x._x[1:]), math.cos(0.5 * x.angle)])
    return _of_matrix(x)


def _direction(x: Array, what: str) -> Array:
    size = math.hypot(*x)
    if not 0.0 < size < math.inf:
        raise SpatialDynError(f"{what} is {x.tolist()}, expected a finite vector that is not null")
    return x / size


def _angle_axis(coefficients: Any) -> list[float]:
    """Angle and axis of a quaternion, the angle in [0, π]."""
    x, y, z, w = (float(c) for c in coefficients)
    n = math.hypot(x, y, z)
    if n == 0.0:
        return [0.0, 1.0, 0.0, 0.0]
    angle = 2.0 * math.atan2(n, abs(w))
    n = math.copysign(n, w) if w else n
    return [angle, x / n, y / n, z / n]

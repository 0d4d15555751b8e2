"""Quaternion and AngleAxis, and the matrices of cross products."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....algebra.euclidean import Vec, cross
from ....algebra.scalars import EPS
from ....errors import SpatialDynError
from ...native import operator_kernels
from .arguments import ArgumentError, ValueRuntimeError, array, described, expected, near, number, row
from .tracked_array import Value

__all__ = ["AngleAxis", "Quaternion", "XAxis", "YAxis", "ZAxis", "skew", "skewSquare", "unSkew"]

Array = NDArray[np.float64]
OPPOSITE = 1e-12  # directions with a cosine this near -1 define no plane
XAxis, YAxis, ZAxis = (np.array([float(i == k) for i in range(3)]) for k in range(3))


class Quaternion(Value):
    """A quaternion: ``Quaternion(w, x, y, z)``, ``Quaternion(coefficients x y z w (4,))``,
    ``Quaternion(rotation (3, 3))``, ``Quaternion(angle_axis)``, ``Quaternion(u, v)`` that rotates u
    to v, ``Quaternion(other)``.

    ``q * p`` is the rotation p followed by q, ``q * x`` rotates a vector (3,). ``Quaternion()`` is the identity.
    """

    __slots__ = ()

    def __init__(self, *arguments: Any, **named: Any) -> None:
        self._x = np.array([0.0, 0.0, 0.0, 1.0])
        if named:
            arguments = (*arguments, *(named[key] for key in ("w", "x", "y", "z") if key in named)) or (None,)
            if len(arguments) != 4:
                arguments = tuple(named.values())
        if len(arguments) == 4:
            w, x, y, z = (number(a, "coefficient") for a in arguments)
            self._x[:] = x, y, z, w
        elif len(arguments) == 2:
            self.setFromTwoVectors(*arguments)
        elif len(arguments) == 1:
            self._x[:] = _coefficients(arguments[0])
        elif arguments:
            raise ArgumentError(f"Quaternion got {len(arguments)} arguments, expected 0, 1, 2 or 4")

    @classmethod
    def Identity(cls) -> Quaternion:
        """The identity rotation."""
        return Quaternion()

    @staticmethod
    def FromTwoVectors(a: Any, b: Any) -> Quaternion:
        """The shortest rotation from direction a (3,) to b (3,)."""
        return Quaternion().setFromTwoVectors(a, b)

    def setFromTwoVectors(self, a: Any, b: Any) -> Quaternion:
        """Set it to the shortest rotation from direction a (3,) to b (3,); returns self."""
        a, b = _direction(a, "a"), _direction(b, "b")
        c = float(a @ b)
        if c < OPPOSITE - 1.0:  # half a turn about any normal
            axis, w = np.array(cross(Vec(*a), Vec(*np.eye(3)[np.argmin(abs(a))]))), 0.5 * (1.0 + max(c, -1.0))
            self._write([*(math.sqrt(1.0 - w) / math.hypot(*axis) * axis), math.sqrt(w)])
        else:
            s = math.sqrt(2.0 * (1.0 + c))
            self._write([*(np.array(cross(Vec(*a), Vec(*b))) / s), 0.5 * s])
        return self

    # --- parts ---------------------------------------------------------------------------------------------

    def _get(self, k: int) -> float:
        return float(self._x[k])

    def _set(self, k: int, value: float) -> None:
        self._x[k] = number(value, "coefficient")
        self.changed()

    x = property(lambda self: self._get(0), lambda self, value: self._set(0, value), doc="The x coefficient.")
    y = property(lambda self: self._get(1), lambda self, value: self._set(1, value), doc="The y coefficient.")
    z = property(lambda self: self._get(2), lambda self, value: self._set(2, value), doc="The z coefficient.")
    w = property(lambda self: self._get(3), lambda self, value: self._set(3, value), doc="The w coefficient.")

    def __getitem__(self, k: int) -> float:
        return self._get(self._index(k))

    def __setitem__(self, k: int, value: float) -> None:
        self._set(self._index(k), value)

    def _index(self, k: int) -> int:
        if not 0 <= k <= 3:
            raise ValueRuntimeError(f"index is {k}, expected 0 to 3")
        return k

    def __len__(self) -> int:
        return 4

    def coeffs(self) -> Array:
        """The coefficients x y z w (4,), a copy."""
        return self._x.copy()

    def vec(self) -> Array:
        """The coefficients x y z (3,), a copy."""
        return self._x[:3].copy()

    def matrix(self) -> Array:
        """The rotation matrix (3, 3); a rotation only if the norm is 1."""
        out = np.empty((3, 3))
        operator_kernels.quat_matrix(self._x, out)
        return out

    toRotationMatrix = matrix

    # --- products ------------------------------------------------------------------------------------------

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Quaternion):
            out = np.empty(4)
            operator_kernels.quat_product(self._x, other._x, out)
            return Quaternion.over(out)
        if isinstance(other, np.ndarray) and other.shape in ((3,), (3, 1)):
            return self._transformVector(other)
        return NotImplemented

    def __imul__(self, other: Any) -> Any:
        product = self * other
        if not isinstance(product, Quaternion):
            return NotImplemented
        self._write(product._x)
        return self

    def _transformVector(self, vector: Any) -> Array:
        """The rotated vector (3,)."""
        return self.matrix() @ array(vector, (3,), "vector")

    def conjugate(self) -> Quaternion:
        """The conjugate: the inverse rotation, of the same norm."""
        return Quaternion.over(self._x * (-1.0, -1.0, -1.0, 1.0))

    def inverse(self) -> Quaternion:
        """The inverse quaternion; zero for zero."""
        n = self.squaredNorm()
        return Quaternion.over(self.conjugate()._x / n if n > 0.0 else np.zeros(4))

    def dot(self, other: Quaternion) -> float:
        """Dot product of the coefficients."""
        return float(self._x @ expected(other, Quaternion, "other")._x)

    def squaredNorm(self) -> float:
        """Squared norm."""
        return float(self._x @ self._x)

    def norm(self) -> float:
        """Euclidean norm."""
        return math.sqrt(self._x @ self._x)

    __abs__ = norm

    def normalize(self) -> Quaternion:
        """Set its norm to 1; returns self."""
        self._write(self.normalized()._x)
        return self

    def normalized(self) -> Quaternion:
        """The quaternion divided by its norm."""
        n = self.norm()
        return Quaternion.over(self._x / n if n > 0.0 else self._x.copy())

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

    # --- the whole -----------------------------------------------------------------------------------------

    def assign(self, other: Any) -> Quaternion:
        """Set it to a Quaternion or AngleAxis; returns self."""
        if not isinstance(other, (Quaternion, AngleAxis)):
            raise ArgumentError(f"other is {described(other)}, expected Quaternion or AngleAxis")
        self._write(_coefficients(other))
        return self

    def setIdentity(self) -> Quaternion:
        """Set it to the identity; returns self."""
        self._write((0.0, 0.0, 0.0, 1.0))
        return self

    def isApprox(self, other: Quaternion, prec: float = 1e-12) -> bool:
        """Whether the coefficients agree to prec of their norms; q and -q do not."""
        return near(self._x, expected(other, Quaternion, "other")._x, prec)

    def id(self) -> int:
        """The identity of this object."""
        return id(self)

    def __getinitargs__(self) -> tuple[Array]:
        return (self._x.copy(),)

    def __repr__(self) -> str:
        return f"(x,y,z,w) = {row(self._x)}\n"


class AngleAxis(Value):
    """A rotation by an angle [rad] about a unit axis: ``AngleAxis(angle, axis (3,))``, ``AngleAxis(rotation (3, 3))``,
    ``AngleAxis(quaternion)``, ``AngleAxis(other)``.

    Products are Quaternions; ``a * x`` rotates a vector (3,). ``AngleAxis()`` is the rotation by 0 about x.
    """

    __slots__ = ()

    def __init__(self, *arguments: Any, **named: Any) -> None:
        arguments = (*arguments, *named.values())
        self._x = np.array([0.0, 1.0, 0.0, 0.0])
        if len(arguments) == 2:
            self._x[0], self._x[1:] = number(arguments[0], "angle"), array(arguments[1], (3,), "axis")
        elif len(arguments) == 1:
            given = arguments[0]
            self._x[:] = given._x if isinstance(given, AngleAxis) else _angle_axis(_coefficients(given, (3, 3)))
        elif arguments:
            raise ArgumentError(f"AngleAxis got {len(arguments)} arguments, expected 0, 1 or 2")

    @property
    def angle(self) -> float:
        """The angle [rad]."""
        return float(self._x[0])

    @angle.setter
    def angle(self, value: float) -> None:
        self._x[0] = number(value, "angle")
        self.changed()

    @property
    def axis(self) -> Array:
        """The axis (3,), a view."""
        return self._view(self._x[1:])

    @axis.setter
    def axis(self, value: Any) -> None:
        self._x[1:] = array(value, (3,), "axis")
        self.changed()

    def matrix(self) -> Array:
        """The rotation matrix (3, 3); a rotation only if the axis has norm 1."""
        s, c, a = math.sin(self.angle), math.cos(self.angle), self._x[1:]
        return c * np.eye(3) + s * skew(a) + np.outer((1.0 - c) * a, a)

    toRotationMatrix = matrix

    def fromRotationMatrix(self, R: Any) -> AngleAxis:
        """Set it to the rotation of a matrix (3, 3); returns self."""
        self._write(_angle_axis(_coefficients(array(R, (3, 3), "rotation"))))
        return self

    def inverse(self) -> AngleAxis:
        """The inverse rotation."""
        return AngleAxis.over(self._x * (-1.0, 1.0, 1.0, 1.0))

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, (AngleAxis, Quaternion)):
            return Quaternion(self) * Quaternion(other)
        if isinstance(other, np.ndarray) and other.shape in ((3,), (3, 1)):
            return self.matrix() @ array(other, (3,), "vector")
        return NotImplemented

    def isApprox(self, other: AngleAxis, prec: float = 1e-12) -> bool:
        """Whether angles and axes each agree to prec of their norms."""
        a, b = self._x, expected(other, AngleAxis, "other")._x
        return near(a[:1], b[:1], prec) and near(a[1:], b[1:], prec)

    def id(self) -> int:
        """The identity of this object."""
        return id(self)

    def __getinitargs__(self) -> tuple[float, Array]:
        return self.angle, self._x[1:].copy()

    def __repr__(self) -> str:
        return f"angle: {self.angle:g}\naxis: {row(self._x[1:])}\n"


def _coefficients(given: Any, *shapes: tuple[int, ...]) -> Any:
    """Coefficients x y z w of a rotation in any form; arrays may have these shapes, by default (3, 3) and (4,)."""
    if isinstance(given, Quaternion):
        return given._x
    if isinstance(given, AngleAxis):
        s = math.sin(0.5 * given.angle)
        return [*(s * given._x[1:]), math.cos(0.5 * given.angle)]
    shapes = shapes or ((3, 3), (4,))
    if isinstance(given, np.ndarray) and given.ndim == 1 and (given.shape not in shapes):
        raise ValueRuntimeError(f"rotation is {described(given)}, expected shape {' or '.join(map(str, shapes))}")
    if (4,) in shapes and isinstance(given, np.ndarray) and given.shape in ((4,), (4, 1)):
        return array(given, (4,), "coefficients")
    out = np.empty(4)
    operator_kernels.matrix_quat(array(given, (3, 3), "rotation"), out)
    return out


def _direction(value: Any, what: str) -> Array:
    x = array(value, (3,), what)
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


def skew(u: Any) -> Array:
    """The matrix (3, 3) of u × for u (3,)."""
    out = np.empty((3, 3))
    operator_kernels.cross_matrix(array(u, (3,), "u"), out)
    return out


def unSkew(U: Any) -> Array:
    """The vector u (3,) whose ``skew`` is the antisymmetric part of a matrix (3, 3)."""
    M = array(U, (3, 3), "U")
    return 0.5 * np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]])


def skewSquare(u: Any, v: Any) -> Array:
    """The matrix (3, 3) of u × (v × ·) for u, v (3,)."""
    u, v = array(u, (3,), "u"), array(v, (3,), "v")
    made: Array = np.outer(v, u) - (u @ v) * np.eye(3)
    return made

"""Motion and Force: spatial vectors, linear part first."""

from __future__ import annotations

from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...native import operator_kernels
from .arguments import ArgumentError, array, described, near, row
from .random import uniform
from .se3 import SE3
from .tracked_array import Value

__all__ = ["Force", "Motion"]

Array = NDArray[np.float64]
Vector = TypeVar("Vector", bound="Spatial")

FLOAT = np.dtype(np.float64)
_empty, _vector, _power = np.empty, operator_kernels.write_vector, operator_kernels.power
_cross_motion, _cross_force = operator_kernels.cross_motion, operator_kernels.cross_force


class Spatial(Value):
    """Base of Motion and Force: six numbers, sums and multiples."""

    __slots__ = ()
    _letters: ClassVar[tuple[str, str]] = ("", "")
    _up: ClassVar[operator_kernels.Operation]
    _down: ClassVar[operator_kernels.Operation]

    def __init__(self, linear: Any = None, angular: Any = None, *, array: Any = None, clone: Any = None) -> None:
        self._x = x = _empty(6)
        if angular is not None:
            try:
                if not _vector()(x, linear, angular):
                    return
            except TypeError:
                pass  # not arrays of float64: check and convert below
        elif type(linear) is np.ndarray and linear.shape == (6,) and linear.dtype == FLOAT:
            x[:] = linear
            return
        given = [x for x in (linear, array, clone) if x is not None]
        x[:] = self._made(given[0] if given else None, angular)

    @classmethod
    def _made(cls, first: Any, angular: Any) -> Any:
        if angular is not None:
            return np.concatenate([array(first, (3,), "linear"), array(angular, (3,), "angular")])
        if isinstance(first, cls):
            return first._x
        if first is None:
            return 0.0
        return array(first, (6,), cls.__name__)

    @classmethod
    def Zero(cls: type[Vector]) -> Vector:
        """Zero."""
        return cls.over(np.zeros(6))

    @classmethod
    def Random(cls: type[Vector]) -> Vector:
        """Six random numbers in ±1."""
        return cls.over(uniform(6))

    # --- parts ---------------------------------------------------------------------------------------------

    @property
    def linear(self) -> Array:
        """The linear part (3,), a view."""
        return self._view(self._x[:3])

    @linear.setter
    def linear(self, value: Any) -> None:
        self._x[:3] = array(value, (3,), "linear")
        self.changed()

    @property
    def angular(self) -> Array:
        """The angular part (3,), a view."""
        return self._view(self._x[3:])

    @angular.setter
    def angular(self, value: Any) -> None:
        self._x[3:] = array(value, (3,), "angular")
        self.changed()

    @property
    def vector(self) -> Array:
        """All six numbers, linear first, a view."""
        return self._view(self._x[:])

    @vector.setter
    def vector(self, value: Any) -> None:
        self._write(array(value, (6,), "vector"))

    @property
    def np(self) -> Array:
        """As ``vector``."""
        return self._view(self._x[:])

    def __array__(self, dtype: Any = None, copy: Any = None) -> Array:
        return self._x.copy() if dtype is None else self._x.astype(dtype)

    # --- sums and multiples ----------------------------------------------------------------------------------

    def __add__(self: Vector, other: Any) -> Vector:
        kind = type(self)
        if type(other) is not kind:
            return NotImplemented
        made = kind.__new__(kind)
        made._x = self._x + other._x
        return made

    def __sub__(self: Vector, other: Any) -> Vector:
        kind = type(self)
        if type(other) is not kind:
            return NotImplemented
        made = kind.__new__(kind)
        made._x = self._x - other._x
        return made

    def __iadd__(self: Vector, other: Any) -> Vector:
        if type(other) is not type(self):
            return NotImplemented
        self._x += other._x
        self.changed()
        return self

    def __isub__(self: Vector, other: Any) -> Vector:
        if type(other) is not type(self):
            return NotImplemented
        self._x -= other._x
        self.changed()
        return self

    def __neg__(self: Vector) -> Vector:
        return self.over(-self._x)

    def __mul__(self: Vector, scale: Any) -> Vector:
        if not isinstance(scale, (float, int)):
            return NotImplemented
        kind = type(self)
        made = kind.__new__(kind)
        made._x = self._x * scale
        return made

    __rmul__ = __mul__

    def __truediv__(self: Vector, scale: Any) -> Vector:
        if not isinstance(scale, (float, int)):
            return NotImplemented
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.over(self._x / scale)

    # --- frames --------------------------------------------------------------------------------------------

    def _to_parent(self: Vector, x: Array) -> Vector:
        kind = type(self)
        made = kind.__new__(kind)
        made._x = out = _empty(6)
        kind._up(x, self._x, out)
        return made

    def _to_child(self: Vector, x: Array) -> Vector:
        kind = type(self)
        made = kind.__new__(kind)
        made._x = out = _empty(6)
        kind._down(x, self._x, out)
        return made

    def se3Action(self: Vector, M: SE3) -> Vector:
        """The vector from the frame M in M's reference frame: ``M.act(self)``."""
        if not isinstance(M, SE3):
            raise ArgumentError(f"M is {described(M)}, expected SE3")
        return self._to_parent(M._x)

    def se3ActionInverse(self: Vector, M: SE3) -> Vector:
        """The vector from M's reference frame in the frame M: ``M.actInv(self)``."""
        if not isinstance(M, SE3):
            raise ArgumentError(f"M is {described(M)}, expected SE3")
        return self._to_child(M._x)

    # --- the whole -----------------------------------------------------------------------------------------

    def setZero(self) -> None:
        """Set it to zero."""
        self._write(0.0)

    def setRandom(self) -> None:
        """Set it to six random numbers in ±1."""
        self._write(uniform(6))

    def isApprox(self: Vector, other: Vector, prec: float = 1e-12) -> bool:
        """Whether both agree to prec of their norms."""
        if not isinstance(other, type(self)):
            raise ArgumentError(f"other is {described(other)}, expected {type(self).__name__}")
        return near(self._x, other._x, prec)

    def isZero(self, prec: float = 1e-12) -> bool:
        """Whether no entry exceeds prec."""
        return bool((abs(self._x) <= prec).all())

    def __getinitargs__(self) -> tuple[Array, Array]:
        return self._x[:3].copy(), self._x[3:].copy()

    def __repr__(self) -> str:
        linear, angular = self._letters
        return f"{linear} = {row(self._x[:3])}\n{angular} = {row(self._x[3:])}\n"


class Force(Spatial):
    """A spatial force: ``Force(linear (3,), angular (3,))`` or ``Force(vector (6,))`` [N, N m about the origin]."""

    __slots__ = ()
    _letters = ("  f", "tau")
    _up = staticmethod(operator_kernels.force_to_parent)
    _down = staticmethod(operator_kernels.force_to_child)

    def dot(self, m: Motion) -> float:
        """The power along a Motion [W]."""
        if not isinstance(m, Motion):
            raise ArgumentError(f"m is {described(m)}, expected Motion")
        return _power(m._x, self._x)  # type: ignore[no-any-return]


class Motion(Spatial):
    """A spatial velocity: ``Motion(linear (3,), angular (3,))`` or ``Motion(vector (6,))`` [m/s, rad/s].

    ``v ^ w`` and ``v.cross(w)`` are v × w for a Motion w, v ×* w for a Force.
    """

    __slots__ = ()
    _letters = ("  v", "  w")
    _up = staticmethod(operator_kernels.motion_to_parent)
    _down = staticmethod(operator_kernels.motion_to_child)

    def __xor__(self, other: Any) -> Any:
        kind = type(other)
        if kind is not Motion and kind is not Force:
            return NotImplemented
        out = _empty(6)
        (_cross_motion if kind is Motion else _cross_force)(self._x, other._x, out)
        return kind.over(out)

    def cross(self, other: Any) -> Any:
        """self × other for a Motion, self ×* other for a Force."""
        made = self ^ other if isinstance(other, Spatial) else NotImplemented
        if made is NotImplemented:
            raise ArgumentError(f"other is {described(other)}, expected Motion or Force")
        return made

    def dot(self, f: Force) -> float:
        """The power of a Force along it [W]."""
        if not isinstance(f, Force):
            raise ArgumentError(f"f is {described(f)}, expected Force")
        return _power(self._x, f._x)  # type: ignore[no-any-return]

    @property
    def action(self) -> Array:
        """The matrix (6, 6) of self × on Motion vectors."""
        out = _empty((6, 6))
        operator_kernels.motion_action(self._x, out)
        return out

    @property
    def dualAction(self) -> Array:
        """The matrix (6, 6) of self ×* on Force vectors."""
        return -self.action.T

    @property
    def homogeneous(self) -> Array:
        """[ω̃ v; 0 0] (4, 4)."""
        vx, vy, vz, x, y, z = self._x.tolist()
        return np.array([[0.0, -z, y, vx], [z, 0.0, -x, vy], [-y, x, 0.0, vz], [0.0, 0.0, 0.0, 0.0]])

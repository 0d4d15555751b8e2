"""SE3: a rigid displacement, stored as its 4 x 4 homogeneous matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...native import operator_kernels
from .arguments import ArgumentError, array, described, near, row, rows
from .random import direction, uniform
from .rotations import Quaternion
from .tracked_array import Value

__all__ = ["SE3"]

Array = NDArray[np.float64]
IDENTITY = np.eye(4)

_compose, _inverse, _relative = operator_kernels.compose, operator_kernels.inverse, operator_kernels.relative
_frame, _point_to_parent, _point_to_child = (
    operator_kernels.write_pose,
    operator_kernels.point_to_parent,
    operator_kernels.point_to_child,
)
_empty, _ndarray = np.empty, np.ndarray


class SE3(Value):
    """The pose of a frame in a reference frame: ``SE3(rotation (3, 3), translation (3,))``,
    ``SE3(quaternion, translation)``, ``SE3(homogeneous (4, 4))``, ``SE3(other)``, ``SE3(1)`` for the identity.

    ``A * B`` composes, ``A * x`` takes a point (3,), Motion, Force or Inertia from the frame to the reference frame,
    ``A.actInv(x)`` takes it back. ``rotation`` and ``translation`` are writable views. ``SE3()`` is the identity.
    """

    __slots__ = ()

    def __init__(
        self,
        rotation: Any = None,
        translation: Any = None,
        *,
        quat: Any = None,
        array: Any = None,
        clone: Any = None,
    ) -> None:
        if translation is not None:
            self._x = x = _empty((4, 4))
            try:
                if not _frame()(x, rotation, translation):
                    return
            except TypeError:
                pass  # not arrays of float64: check and convert below
        given = [x for x in (rotation, quat, array, clone) if x is not None]
        self._x = _made(given[0] if given else None, translation)

    @classmethod
    def Identity(cls) -> SE3:
        """The identity."""
        return SE3.over(IDENTITY.copy())

    @classmethod
    def Random(cls) -> SE3:
        """A uniform random rotation and a random translation within ±1 m."""
        made = SE3.over(_empty((4, 4)))
        made.setRandom()
        return made

    @staticmethod
    def Interpolate(A: SE3, B: SE3, alpha: float) -> SE3:
        """A exp(alpha log(A⁻¹ B)): from A (alpha = 0) to B (alpha = 1) at a constant motion."""
        made, twist = _empty((4, 4)), _empty(6)
        _relative(A._x, B._x, made)
        operator_kernels.log6(made, twist)
        operator_kernels.exp6(twist * alpha, made)
        _compose(A._x, made, made)
        return SE3.over(made)

    # --- parts ---------------------------------------------------------------------------------------------

    @property
    def rotation(self) -> Array:
        """The rotation matrix (3, 3), a view."""
        return self._view(self._x[:3, :3])

    @rotation.setter
    def rotation(self, value: Any) -> None:
        self._x[:3, :3] = array(value, (3, 3), "rotation")
        self.changed()

    @property
    def translation(self) -> Array:
        """The translation (3,) [m], a view."""
        return self._view(self._x[:3, 3])

    @translation.setter
    def translation(self, value: Any) -> None:
        self._x[:3, 3] = array(value, (3,), "translation")
        self.changed()

    @property
    def homogeneous(self) -> Array:
        """The homogeneous matrix (4, 4), a copy."""
        return self._x.copy()

    np = homogeneous

    def __array__(self, dtype: Any = None, copy: Any = None) -> Array:
        return self._x.copy() if dtype is None else self._x.astype(dtype)

    @property
    def action(self) -> Array:
        """The matrix (6, 6) that takes Motion vectors from the frame to the reference frame."""
        out = _empty((6, 6))
        operator_kernels.action(self._x, out)
        return out

    @property
    def actionInverse(self) -> Array:
        """The inverse of ``action``."""
        out = _empty((6, 6))
        operator_kernels.action_inverse(self._x, out)
        return out

    @property
    def dualAction(self) -> Array:
        """The matrix (6, 6) that takes Force vectors from the frame to the reference frame."""
        return self.actionInverse.T.copy()

    def toActionMatrix(self) -> Array:
        """As ``action``."""
        return self.action

    def toActionMatrixInverse(self) -> Array:
        """As ``actionInverse``."""
        return self.actionInverse

    def toDualActionMatrix(self) -> Array:
        """As ``dualAction``."""
        return self.dualAction

    # --- products ------------------------------------------------------------------------------------------

    def __mul__(self, other: Any) -> Any:
        kind = type(other)
        if kind is SE3:
            out = _empty((4, 4))
            _compose(self._x, other._x, out)
            made = _new(SE3)
            made._x = out
            return made
        move = getattr(kind, "_to_parent", None)
        if move is not None:
            return move(other, self._x)
        if isinstance(other, _ndarray) and (other.shape == (3,) or other.shape == (3, 1)):
            return self.act(other)
        return NotImplemented

    def _to_parent(self, x: Array) -> SE3:
        out = _empty((4, 4))
        _compose(x, self._x, out)
        return SE3.over(out)

    def _to_child(self, x: Array) -> SE3:
        out = _empty((4, 4))
        _relative(x, self._x, out)
        return SE3.over(out)

    def act(self, other: Any) -> Any:
        """A point (3,), SE3, Motion, Force or Inertia from the frame to the reference frame."""
        move = getattr(type(other), "_to_parent", None)
        if move is not None:
            return move(other, self._x)
        out = _empty(3)
        try:
            if not _point_to_parent()(out, self._x, other):
                return out
        except TypeError:
            pass  # no array of float64: check and convert below
        _point_to_parent()(out, self._x, array(other, (3,), "point"))
        return out

    def actInv(self, other: Any) -> Any:
        """A point (3,), SE3, Motion, Force or Inertia from the reference frame to the frame."""
        move = getattr(type(other), "_to_child", None)
        if move is not None:
            return move(other, self._x)
        out = _empty(3)
        try:
            if not _point_to_child()(out, self._x, other):
                return out
        except TypeError:
            pass  # no array of float64: check and convert below
        _point_to_child()(out, self._x, array(other, (3,), "point"))
        return out

    def inverse(self) -> SE3:
        """The pose of the reference frame in the frame."""
        out = _empty((4, 4))
        _inverse(self._x, out)
        made = _new(SE3)
        made._x = out
        return made

    __invert__ = inverse

    # --- the whole -----------------------------------------------------------------------------------------

    def setIdentity(self) -> None:
        """Set it to the identity."""
        self._write(IDENTITY)

    def setRandom(self) -> None:
        """Set it to a random pose; see ``Random``."""
        out = _empty((4, 4))
        operator_kernels.from_xyzquat(np.concatenate([uniform(3), direction(4)]), out)
        self._write(out)

    def isApprox(self, other: SE3, prec: float = 1e-12) -> bool:
        """Whether rotations and translations each agree to prec of their norms."""
        if not isinstance(other, SE3):
            raise ArgumentError(f"other is {described(other)}, expected SE3")
        a, b = self._x, other._x
        return near(a[:3, :3], b[:3, :3], prec) and near(a[:3, 3], b[:3, 3], prec)

    def isIdentity(self, prec: float = 1e-12) -> bool:
        """Whether no entry differs from the identity's by more than prec."""
        return bool((abs(self._x - IDENTITY) <= prec).all())

    def __getinitargs__(self) -> tuple[Array, Array]:
        return self._x[:3, :3].copy(), self._x[:3, 3].copy()

    def __str__(self) -> str:
        return f"  R =\n{rows(self._x[:3, :3])}\n  p = {row(self._x[:3, 3])}\n"

    def __repr__(self) -> str:
        text = np.array2string(self._x, separator=", ").replace("\n", "").replace("], [", "],[").replace(",  [", ",[")
        return f"SE3(array({text}))"


_new = SE3.__new__


def _made(first: Any, translation: Any) -> Array:
    """The homogeneous matrix of the constructor's arguments."""
    x = IDENTITY.copy()
    if translation is not None:
        p = array(translation, (3,), "translation")
        if isinstance(first, Quaternion):
            operator_kernels.from_xyzquat(np.concatenate([p, first._x]), x)
        else:
            x[:3, :3], x[:3, 3] = array(first, (3, 3), "rotation"), p
    elif isinstance(first, SE3):
        x[...] = first._x
    elif isinstance(first, np.ndarray):
        x[:3] = array(first, (4, 4), "homogeneous matrix")[:3]
    elif first is not None and not isinstance(first, int):
        raise ArgumentError(f"SE3 got {described(first)}, expected a rotation and a translation, a matrix or an SE3")
    return x

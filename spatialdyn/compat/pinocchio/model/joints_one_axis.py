"""Joint models of one axis: rotations about it, with limits or without, translations along it, and both as a screw."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....algebra.rotations import UNIT_AXIS
from ....errors import ModelError
from ..types.arguments import ArgumentError, number
from .joint import JointModel, Step, Vector, X, Y, Z

__all__ = [
    "JointModelHX", "JointModelHY", "JointModelHZ", "JointModelHelicalUnaligned", "JointModelPX", "JointModelPY",
    "JointModelPZ", "JointModelPrismaticUnaligned", "JointModelRUBX", "JointModelRUBY", "JointModelRUBZ",
    "JointModelRX", "JointModelRY", "JointModelRZ", "JointModelRevoluteUnaligned",
    "JointModelRevoluteUnboundedUnaligned",
]  # fmt: skip

Array = NDArray[np.float64]


def unit(what: str, axis: Any) -> Vector:
    """An axis, an array or three numbers, as a unit vector. Raises ModelError, a ValueError, for the null vector."""
    given = axis[0] if len(axis) == 1 else axis
    if len(axis) == 1 and not isinstance(given, np.ndarray):
        raise ArgumentError(f"axis of {what} is a {type(given).__name__}, expected an array or three numbers")
    u = np.asarray(given, dtype=float).ravel()
    if u.shape != (3,) or not np.isfinite(u).all() or not u.any():
        raise ModelError(f"axis of {what} is {u.tolist()}, expected three finite numbers, not all 0")
    norm = math.hypot(*u)
    if abs(norm - 1.0) > UNIT_AXIS:
        u = u / norm
    return float(u[0]) + 0.0, float(u[1]) + 0.0, float(u[2]) + 0.0


class _Aligned(JointModel):
    """A joint along or about a coordinate axis."""

    __slots__ = ()
    _step = Step("revolute", X)

    def steps(self) -> tuple[Step, ...]:
        return (self._step,)

    def getMotionAxis(self) -> Array:
        """The axis (3,)."""
        return np.array(self._step.axis)


class _Unaligned(JointModel):
    """A joint along or about any axis."""

    __slots__ = ("_axis",)
    _kind = "revolute"

    def __init__(self, *axis: Any) -> None:
        super().__init__()
        self._axis = unit(type(self).__name__, axis) if axis else X

    @property
    def axis(self) -> Array:
        """The unit axis (3,), a copy: assign to change it."""
        return np.array(self._axis)

    @axis.setter
    def axis(self, value: Any) -> None:
        self._axis = unit(self.shortname(), (np.asarray(value),))
        self.changed()

    def steps(self) -> tuple[Step, ...]:
        return (Step(self._kind, self._axis),)

    def parameters(self) -> tuple[Any, ...]:
        return self._axis


def _pitch_of(joint: Any) -> float:
    """Travel along the axis per radian [m/rad]."""
    pitch: float = joint._pitch
    return pitch


def _set_pitch(joint: Any, value: Any) -> None:
    joint._pitch = number(value, "pitch")
    joint.changed()


class _AlignedHelical(_Aligned):
    """A screw about a fixed axis of its frame: ``(pitch)`` [m/rad], 0 if left out."""

    __slots__ = ("_pitch",)
    pitch = property(_pitch_of, _set_pitch)

    def __init__(self, pitch: float = 0.0) -> None:
        super().__init__()
        self._pitch = number(pitch, "pitch")

    def steps(self) -> tuple[Step, ...]:
        return (self._step._replace(pitch=self._pitch),)

    def parameters(self) -> tuple[Any, ...]:
        return (self._pitch,)


class JointModelRX(_Aligned):
    """A rotation about x."""

    __slots__ = ()
    _step = Step("revolute", X)


class JointModelRY(_Aligned):
    """A rotation about y."""

    __slots__ = ()
    _step = Step("revolute", Y)


class JointModelRZ(_Aligned):
    """A rotation about z."""

    __slots__ = ()
    _step = Step("revolute", Z)


class JointModelPX(_Aligned):
    """A translation along x."""

    __slots__ = ()
    _step = Step("prismatic", X)


class JointModelPY(_Aligned):
    """A translation along y."""

    __slots__ = ()
    _step = Step("prismatic", Y)


class JointModelPZ(_Aligned):
    """A translation along z."""

    __slots__ = ()
    _step = Step("prismatic", Z)


class JointModelRUBX(_Aligned):
    """A rotation without limits about x: q = [cos, sin]."""

    __slots__ = ()
    _nq, _unlimited, _step = 2, (0, 0), Step("continuous", X)


class JointModelRUBY(_Aligned):
    """A rotation without limits about y: q = [cos, sin]."""

    __slots__ = ()
    _nq, _unlimited, _step = 2, (0, 0), Step("continuous", Y)


class JointModelRUBZ(_Aligned):
    """A rotation without limits about z: q = [cos, sin]."""

    __slots__ = ()
    _nq, _unlimited, _step = 2, (0, 0), Step("continuous", Z)


class JointModelRevoluteUnaligned(_Unaligned):
    """A rotation about an axis: ``(x, y, z)`` or ``(axis (3,))``."""

    __slots__ = ()


class JointModelPrismaticUnaligned(_Unaligned):
    """A translation along an axis: ``(x, y, z)`` or ``(axis (3,))``."""

    __slots__ = ()
    _kind = "prismatic"


class JointModelRevoluteUnboundedUnaligned(_Unaligned):
    """A rotation without limits about an axis: ``(x, y, z)`` or ``(axis (3,))``; q = [cos, sin]."""

    __slots__ = ()
    _kind, _nq, _unlimited = "continuous", 2, (0, 0)


class JointModelHX(_AlignedHelical):
    """A screw about x: ``(pitch)`` [m/rad]."""

    __slots__ = ()
    _step = Step("helical", X)


class JointModelHY(_AlignedHelical):
    """A screw about y: ``(pitch)`` [m/rad]."""

    __slots__ = ()
    _step = Step("helical", Y)


class JointModelHZ(_AlignedHelical):
    """A screw about z: ``(pitch)`` [m/rad]."""

    __slots__ = ()
    _step = Step("helical", Z)


class JointModelHelicalUnaligned(_Unaligned):
    """A screw about an axis: ``(x, y, z, pitch)`` or ``(axis (3,), pitch)``, the pitch in m/rad."""

    __slots__ = ("_pitch",)
    _kind = "helical"
    pitch = property(_pitch_of, _set_pitch)

    def __init__(self, *arguments: Any) -> None:
        if len(arguments) not in (0, 2, 4):
            raise ArgumentError(
                f"JointModelHelicalUnaligned got {len(arguments)} arguments, expected an axis or three numbers, and a "
                "pitch"
            )
        super().__init__(*arguments[:-1])
        self._pitch = number(arguments[-1], "pitch") if arguments else 0.0

    def steps(self) -> tuple[Step, ...]:
        return (Step(self._kind, self._axis, pitch=self._pitch),)

    def parameters(self) -> tuple[Any, ...]:
        return *self._axis, self._pitch

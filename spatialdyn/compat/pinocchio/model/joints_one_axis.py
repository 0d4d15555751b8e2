"""Joint models of one axis: rotations about it, with limits or without, translations along it, and both as a screw."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ....algebra.rotations import UNIT_AXIS
from ....errors import ModelError
from ..types.arguments import ArgumentError, number
from .joint import JointModel, Step, Vector, X, Y, Z, joint_kind

__all__ = [
    "JointModelHX", "JointModelHY", "JointModelHZ", "JointModelHelicalUnaligned", "JointModelPX", "JointModelPY",
    "JointModelPZ", "JointModelPrismaticUnaligned", "JointModelRUBX", "JointModelRUBY", "JointModelRUBZ",
    "JointModelRX", "JointModelRY", "JointModelRZ", "JointModelRevoluteUnaligned",
    "JointModelRevoluteUnboundedUnaligned",
]  # fmt: skip


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


def axis_property(slot: str, doc: str) -> Any:
    """A property for an axis of a joint: read as a copy, checked and normalised when it is assigned."""

    def assign(joint: Any, value: Any) -> None:
        setattr(joint, slot, unit(joint.shortname(), (np.asarray(value),)))
        joint.changed()

    return property(lambda joint: np.array(getattr(joint, slot)), assign, doc=doc)


class OneAxis(JointModel):
    """A joint along or about an axis."""

    __slots__ = ("_axis", "_pitch")
    _kind = "revolute"
    _along: Vector | None = None  # the axis, where it is fixed

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__()
        screw = self._kind == "helical"
        if screw and {*named} == {"pitch"}:
            given, named = (*given, named["pitch"]), {}
        wanted = [] if self._along else ["an axis or three numbers"]
        if named or len(given) not in ((0, int(screw)) if self._along else (0, 1 + screw, 3 + screw)):
            what = ", and ".join([*wanted, *["a pitch"] * screw]) or "nothing"
            raise ArgumentError(f"{self._name} got {len(given) + len(named)} arguments, expected {what}")
        axis = given[: len(given) - screw]
        self._axis: Vector = self._along or (unit(self._name, axis) if axis else X)
        self._pitch = number(given[-1], "pitch") if screw and given else 0.0

    def steps(self) -> tuple[Step, ...]:
        return (Step(self._kind, self._axis, pitch=self._pitch),)

    def parameters(self) -> tuple[Any, ...]:
        return *(() if self._along else self._axis), *([self._pitch] if self._kind == "helical" else [])


def _set_pitch(joint: Any, value: Any) -> None:
    joint._pitch = number(value, "pitch")
    joint.changed()


_PITCH = property(lambda joint: joint._pitch, _set_pitch, doc="Travel along the axis per radian [m/rad].")
_AXIS = axis_property("_axis", "The unit axis (3,), a copy: assign to change it.")


def _motion_axis(joint: Any) -> Any:
    """The axis (3,)."""
    return np.array(joint._axis)


def _one_axis(name: str, kind: str, doc: str, along: Vector | None = None) -> Any:
    own: dict[str, Any] = {"_kind": kind, "_along": along}
    own |= {"getMotionAxis": _motion_axis} if along else {"axis": _AXIS}
    own |= {"_nq": 2, "_unlimited": (0, 0)} if kind == "continuous" else {}
    own |= {"pitch": _PITCH} if kind == "helical" else {}
    return joint_kind(f"JointModel{name}", OneAxis, doc, **own)


def _about_xyz(name: str, kind: str, doc: str) -> Any:
    axes = {"X": X, "Y": Y, "Z": Z}
    return (_one_axis(f"{name}{at}", kind, doc.format(at.lower()), axis) for at, axis in axes.items())


JointModelRX, JointModelRY, JointModelRZ = _about_xyz("R", "revolute", "A rotation about {}.")
JointModelPX, JointModelPY, JointModelPZ = _about_xyz("P", "prismatic", "A translation along {}.")
JointModelRUBX, JointModelRUBY, JointModelRUBZ = _about_xyz(
    "RUB", "continuous", "A rotation without limits about {}: q = [cos, sin]."
)
JointModelHX, JointModelHY, JointModelHZ = _about_xyz(
    "H", "helical", "A screw about {}: ``(pitch)`` [m/rad], 0 if left out."
)
JointModelRevoluteUnaligned = _one_axis(
    "RevoluteUnaligned", "revolute", "A rotation about an axis: ``(x, y, z)`` or ``(axis (3,))``."
)
JointModelPrismaticUnaligned = _one_axis(
    "PrismaticUnaligned", "prismatic", "A translation along an axis: ``(x, y, z)`` or ``(axis (3,))``."
)
JointModelRevoluteUnboundedUnaligned = _one_axis(
    "RevoluteUnboundedUnaligned",
    "continuous",
    "A rotation without limits about an axis: ``(x, y, z)`` or ``(axis (3,))``; q = [cos, sin].",
)
JointModelHelicalUnaligned = _one_axis(
    "HelicalUnaligned",
    "helical",
    "A screw about an axis: ``(x, y, z, pitch)`` or ``(axis (3,), pitch)``, the pitch in m/rad.",
)
